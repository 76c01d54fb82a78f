"""Sessions: list, record, read, analyse, transfer."""
