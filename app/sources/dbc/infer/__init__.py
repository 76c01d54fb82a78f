"""A battery's profile inferred from a DBC and from received frames."""
