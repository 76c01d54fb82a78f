"""Ageing: capacity, resistance, joints, and the current sensor's offset."""
