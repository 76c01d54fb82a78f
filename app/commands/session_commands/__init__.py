"""What `voltwall sessions` is made of."""
