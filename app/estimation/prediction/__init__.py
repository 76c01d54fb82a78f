"""What lies ahead: power, energy, the driver's number."""
