"""The actions of `voltwall battery`."""
