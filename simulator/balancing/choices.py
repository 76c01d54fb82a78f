"""Choices of a balancing study: circuits by name, limits of its numbers."""

from typing import Final

METHODS: Final = ("passive", "switched-capacitor", "transformer")
CIRCUITS: Final = (*METHODS, "none")
LIMITS: Final = {  # limits of a study's numbers
    "rate_c": (0.05, 6.0),
    "hours": (0.1, 100.0),
    "soc": (0.0, 1.0),
    "spread": (0.0, 0.5),
    "ambient_degc": (-20.0, 60.0),
    "resistor_ohm": (1.0, 1000.0),
    "threshold_v": (1e-5, 0.1),
    "until": (1e-4, 0.1),
}
