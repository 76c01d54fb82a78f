"""Recordings of other systems: tables and CAN logs, as columns with a meaning."""
