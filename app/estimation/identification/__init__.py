"""Fits a cell model to measurements."""
