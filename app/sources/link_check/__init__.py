"""Ports and adapters of this machine, and their check."""
