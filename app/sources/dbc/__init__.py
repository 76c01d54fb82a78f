"""Batteries that speak by a DBC: message definitions, extraction of signals, and frames into cells."""
