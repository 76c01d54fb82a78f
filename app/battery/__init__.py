"""The battery as a value: its shape and what each cell is."""
