"""CAN tables and bus."""
