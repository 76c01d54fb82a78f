"""The commands that run the simulator: the only ones that import it."""
