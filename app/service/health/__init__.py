"""Whether the service does its work, and who is told."""
