"""One clean recording of a cell out of columns as users have them."""
