"""What is plugged into this machine, and what arrives on it."""
