"""The product's values as JSON."""
