"""Analysis of recordings: pure functions over arrays. No file, no clock, no page."""
