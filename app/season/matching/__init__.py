"""Packs built from measured cells: which in parallel, which where, and what one module costs."""
