"""What a season says of each cell: its history, trends, ageing, comparison of sessions."""
