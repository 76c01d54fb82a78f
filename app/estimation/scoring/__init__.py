"""How good estimates are against a reference."""
