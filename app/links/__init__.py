"""Bytes in, items out; requests in, bytes out. Nothing here knows what bytes mean."""
