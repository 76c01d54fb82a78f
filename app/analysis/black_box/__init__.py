"""The black box: the record of a trip and its surroundings."""
