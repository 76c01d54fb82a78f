"""What `voltwall identify` and `voltwall estimate` share."""
