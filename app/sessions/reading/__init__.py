"""Reading sessions, closed or still being recorded. Changes nothing in them."""
