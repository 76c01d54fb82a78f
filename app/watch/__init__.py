"""Limits and alarms: what the crew must be told."""
