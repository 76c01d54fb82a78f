"""The lake: Parquet files that are made from closed sessions, and made again."""
