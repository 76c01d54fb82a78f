"""Recording, reading, replaying and exporting sessions, and the event log: the only package that knows SQLite."""
