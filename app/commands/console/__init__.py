"""What several commands have in common at a console: numbers on their line, a running service to talk to."""
