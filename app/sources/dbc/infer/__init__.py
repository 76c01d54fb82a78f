"""What speaks on a bus, and the profile that it suggests."""
