"""Prediction: power, energy, the driver's number."""
