"""When laps began and what each cost."""
