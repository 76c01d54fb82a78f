"""Snapshot, live stream, history, events, metrics."""
