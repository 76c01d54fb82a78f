"""What a recording tells afterwards: pure functions over arrays. No file, no clock, no page."""
