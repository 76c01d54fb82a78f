"""State of charge of all cells: charge count, sigma-point filters, their fusion."""
