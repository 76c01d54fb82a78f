"""Laps: their starts and their figures."""
