"""Batteries on a serial line by a profile: frames in a stream of bytes, and frames into cells."""
