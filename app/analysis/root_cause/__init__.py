"""The likeliest cause of what went wrong, from what was recorded."""
