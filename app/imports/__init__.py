"""Recordings of other battery management systems, made into sessions."""
