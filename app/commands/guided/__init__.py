"""What walks through something from its beginning to its end: a reaction test."""
