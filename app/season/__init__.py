"""A season of sessions: estimated again, cells over time, packs built from what was measured."""
