"""What happened around a trip."""
