"""Configuration, profiles, commands, checks against a meter."""
