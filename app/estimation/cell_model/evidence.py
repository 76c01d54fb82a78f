"""Evidence of a cell's identification, and its residuals."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from app.estimation.arrays import FloatArray

Pairs = tuple[tuple[float, float], ...]
ERROR_RATIO: Final = (0.5, 5.0)  # smallest and largest error at one place over that of the whole file
PULSE_S: Final = 10.0
HELD_S: Final = (1.0, 3.0, 10.0, 30.0, 100.0)  # for which currents are looked for; after it surfaces deplete no further


@dataclass(frozen=True)
class Evidence:
    """The measurements behind an identification, and their residuals; no voltage is computed from it.

    Attributes:
        has_ocv: whether something measured the OCV: a slow test, or rests. Without, no filter is valid.
        soc: lowest and highest SOC under load.
        lowest: (m, 2) temperature [degC], rising, and the lowest SOC that was seen under load there or colder.
        sigma: of the numbers in `surface`, by name; shares, but for energies [J/mol] and exponents.
        by_degc, by_soc, by_c: (m, 2) temperature [degC], SOC or current [C], and the voltage's RMS error there [V].
        held: (m, 2) seconds, and the largest mean current magnitude over so long [A].
    """

    has_ocv: bool = True
    soc: tuple[float, ...] = ()
    lowest: Pairs = ()
    sigma: tuple[tuple[str, float], ...] = ()
    by_degc: Pairs = ()
    by_soc: Pairs = ()
    by_c: Pairs = ()
    held: Pairs = ()

    def error_v(self, of_all_v: float, soc: ArrayLike, current_c: ArrayLike, temperature_degc: ArrayLike) -> FloatArray:
        """Return the error left at a SOC, current and temperature [V]: that of all times how each changes it."""
        ratio = np.ones(np.broadcast_shapes(*map(np.shape, (soc, current_c, temperature_degc))))
        at = ((self.by_soc, soc), (self.by_c, np.abs(current_c)), (self.by_degc, temperature_degc))
        for pairs, values in at:
            if pairs and of_all_v > 0.0:
                ratio = ratio * np.interp(np.asarray(values, dtype=np.float64), *np.array(pairs).T) / of_all_v
        return of_all_v * np.clip(ratio, *ERROR_RATIO)


def sand_current_a(held: Pairs, time_s: ArrayLike) -> FloatArray:
    """Return the current that depletes in a time what the largest of `held` have depleted in theirs [A].

    A current depletes a surface as far as its square times the time (Sand 1901), a mean over more than PULSE_S less;
    nothing depletes further after HELD_S[-1]. Infinite where none is known.
    """
    seconds = np.clip(time_s, HELD_S[0], HELD_S[-1])
    most_a = np.zeros(seconds.shape)
    for held_s, held_a in held:
        longest = np.inf if held_s <= PULSE_S else 1.0
        most_a = np.maximum(most_a, held_a * np.minimum(np.sqrt(held_s / seconds), longest))
    return most_a if held else np.full(seconds.shape, np.inf)


def held_currents(recordings: Iterable[tuple[FloatArray, FloatArray]]) -> Pairs:
    """Return the pairs `held` of recordings: (n,) rising times [s] and charge drawn since the first [Ah] of each."""
    most_a = np.zeros(len(HELD_S))
    for time_s, charge_ah in recordings:
        before = time_s - np.array(HELD_S)[:, None]
        moved_ah = charge_ah - np.interp(before, time_s, charge_ah)
        most_a = np.maximum(most_a, 3600.0 * np.abs(moved_ah).max(axis=1) / HELD_S)
    return tuple((seconds, float(f"{amps:.4g}")) for seconds, amps in zip(HELD_S, most_a, strict=True))
