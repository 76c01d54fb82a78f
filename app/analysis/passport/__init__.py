"""The life of every cell across sessions."""
