"""The team's master: its memory as the service knows it, its answers and its events."""
