"""What `voltwall evidence` is made of."""
