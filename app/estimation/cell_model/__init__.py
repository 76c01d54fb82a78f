"""The equivalent circuit of a cell, its OCV curve and its file."""
