"""Balancing as circuits: bleed resistors, switched capacitors, a multi-winding transformer; charges that use them."""
