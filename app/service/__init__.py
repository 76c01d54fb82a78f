"""Wiring and threads of the running service."""
