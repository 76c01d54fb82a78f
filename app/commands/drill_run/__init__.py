"""What `voltwall drill` is made of."""
