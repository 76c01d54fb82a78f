"""Sessions estimated again with a chosen filter and cell file, in parallel, and what that changed."""
