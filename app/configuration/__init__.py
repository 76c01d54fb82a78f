"""The master's configuration: rules, safe write, profiles, history, calibration."""
