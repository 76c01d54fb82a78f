"""What each command takes: imported for `--help` and completion, too, so none of it imports what the work needs."""
