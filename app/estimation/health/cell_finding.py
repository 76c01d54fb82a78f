"""A finding: what is wrong with one cell, how much, on which evidence, and how sure that is."""

from __future__ import annotations

from dataclasses import dataclass
from math import erf, sqrt
from typing import Final, Literal

FindingCode = Literal[
    "joint-resistance-high",  # its busbar joint resists more than it did, or than the others' do [ohm]
    "cell-resistance-high",  # the cell itself resists more than the others do [ohm]
    "capacity-low",  # it holds less than the others do [1: part of their capacity that is gone]
    "self-discharge-high",  # it loses charge while the others do not [A]
    "temperature-sensor-fault",  # its temperature sensor shows another value than the cell has [K from the others]
    "temperature-sensor-open",  # its temperature sensor shows nothing
    "cell-voltage-stuck",  # its voltage stands still while the others move [V that the others moved by]
    "cell-voltage-missing",  # it has no voltage
    "cell-voltage-noisy",  # its voltage jumps while the current stands still [V]
    "sense-wire-open",  # it, and perhaps its neighbour, has no voltage while the rest of the pack has
    "cell-imbalance",  # it began with less charge than the others [1: of its charge]
    "external-heating",  # heat comes to it from outside [W]
]
SURE: Final = 0.99  # no finding is surer: what was not thought of is not in sigma
BAND_SIGMAS: Final = 2.0


@dataclass(frozen=True)
class CellFinding:
    """A fault of one cell. Times are those that the watch was fed with.

    Attributes:
        code: what it is.
        cell: index from 0.
        size: how much, in `unit`; NaN where it has no size.
        sigma: its standard deviation, in `unit`.
        unit: ohm, 1, A, K or V.
        since_s: when the evidence first sufficed.
        seen_s: the latest evidence; while the car stands it does not move on.
        evidence_s: seconds of samples that the evidence rests on.
        current_a: rms current of that evidence; NaN where current is none of it [A].
        value: what the cell shows: its resistance, capacity, voltage or temperature, NaN where it shows none.
        usual: what its neighbours show of the same.
        neighbours: the cells that it was compared with.
        confidence: probability that the size is beyond what is tolerated, at most `SURE`.
        log_odds: against nothing being wrong, by the judge of a stretch; NaN: by the watch.
        warmer_k: how much warmer than the median cell it has become since it began; NaN: no warmer [K].
        heat_w: and the heat of its own that this takes [W].
    """

    code: FindingCode
    cell: int
    size: float
    sigma: float
    unit: str
    since_s: float
    seen_s: float
    evidence_s: float
    current_a: float
    value: float
    usual: float
    neighbours: tuple[int, ...]
    confidence: float
    log_odds: float = float("nan")
    warmer_k: float = float("nan")
    heat_w: float = float("nan")

    @property
    def band(self) -> tuple[float, float]:
        """Low and high end of the size: BAND_SIGMAS either side, and no lower than nothing."""
        return max(self.size - BAND_SIGMAS * self.sigma, 0.0), self.size + BAND_SIGMAS * self.sigma


def confidence_of(size: float, sigma: float, tolerated: float) -> float:
    """Return the probability that a normal variable lies above `tolerated`, at most SURE; 0 where nothing is known."""
    if not sigma > 0.0 or size != size:
        return 0.0
    return min(0.5 * (1.0 + erf((size - tolerated) / (sigma * sqrt(2.0)))), SURE)
