"""Health of the service: checks, probe and watchdog."""
