"""The session file: its schema, its columns, its errors on the disk. SQLite is known here only."""
