"""Balancing circuits: bleed resistors, switched capacitors, a multi-winding transformer."""
