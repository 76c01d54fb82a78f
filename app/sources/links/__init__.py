"""Serial port and CAN bus: bytes in and out, opened again when lost. Nothing here knows what the bytes mean."""
