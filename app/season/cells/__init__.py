"""What a season says of each cell: its history and its trends."""
