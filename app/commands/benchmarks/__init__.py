"""Measurements that a team can repeat on its own machine: `voltwall bench`."""
