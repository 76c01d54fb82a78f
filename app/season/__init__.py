"""What many sessions say together. Empty until there is a season."""
