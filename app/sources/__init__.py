"""Bytes in, measurements out; requests in, bytes out."""
