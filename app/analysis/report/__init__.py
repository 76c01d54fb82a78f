"""What a person concludes from a session."""
