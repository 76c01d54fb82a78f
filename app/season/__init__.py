"""What many sessions say together: estimated again, cells over time, packs built from what was measured."""
