"""Choices for the currents of a recording, for the command line and profiles, which need no numbers yet."""

from typing import Final

CHOICES: Final = ("auto", "yes", "no")  # whether they are means over each row; auto: as the data show
