"""Writing sessions: when a recording starts and ends, and what goes into it."""
