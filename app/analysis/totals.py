"""The accumulator as a whole over time, as analysis wants it: arrays of one length, NaN where not measured."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from app.estimation.arrays import FloatArray

MAX_STEP_S = 10.0  # what flowed in a longer gap is not known, and not made up
SECONDS_PER_HOUR = 3600.0


@dataclass(frozen=True)
class Totals:
    """(n,) arrays over a recording.

    Attributes:
        time_s: rising [s].
        current_a: positive on discharge [A].
        voltage_v: of all cells together [V].
        v_min_v, v_min_cell: lowest cell voltage [V] and whose it is.
        v_max_v: highest cell voltage [V].
        t_max_degc, t_max_cell, t_mean_degc: hottest cell, whose it is, and mean [degC].
        soc: mean state of charge, 0..1.
    """

    time_s: FloatArray
    current_a: FloatArray
    voltage_v: FloatArray
    v_min_v: FloatArray
    v_min_cell: FloatArray
    v_max_v: FloatArray
    t_max_degc: FloatArray
    t_max_cell: FloatArray
    t_mean_degc: FloatArray
    soc: FloatArray

    @property
    def power_w(self) -> FloatArray:
        """(n,) power out of the accumulator [W]."""
        return self.voltage_v * self.current_a

    def between(self, start_s: float, end_s: float) -> Totals:
        """Return the samples of a stretch, both ends included."""
        low, high = np.searchsorted(self.time_s, start_s), np.searchsorted(self.time_s, end_s, side="right")
        return Totals(**{field.name: getattr(self, field.name)[low:high] for field in fields(self)})


def energy_wh(time_s: FloatArray, power_w: FloatArray) -> tuple[float, float] | None:
    """Return (out, in) energies of a stretch, both positive [Wh], by the trapezoid over each sign's power.

    None where the power was not known for longer than MAX_STEP_S: the sum over the rest would be too low.
    """
    is_finite = np.isfinite(power_w)
    if not is_finite.any() or np.diff(np.concatenate((time_s[:1], time_s[is_finite], time_s[-1:]))).max() > MAX_STEP_S:
        return None
    dt_s, watts = np.diff(time_s[is_finite]), power_w[is_finite]

    def total(watts: FloatArray) -> float:
        return float((0.5 * (watts[1:] + watts[:-1]) * dt_s).sum() / SECONDS_PER_HOUR)

    return total(np.maximum(watts, 0.0)), total(np.maximum(-watts, 0.0))


def present(values: FloatArray) -> FloatArray:
    """Return the elements that were measured."""
    return values[np.isfinite(values)]


def first_last(values: FloatArray) -> tuple[float | None, float | None]:
    """Return the first and the last measured element, None without any."""
    is_present = present(values)
    return (float(is_present[0]), float(is_present[-1])) if is_present.size else (None, None)


def number(value: float) -> float | None:
    """Return a plain number, None for NaN."""
    return float(value) if np.isfinite(value) else None


def listed(values: FloatArray, decimals: int | None = None) -> list[float | None]:
    """Return plain numbers, None for NaN; rounded where `decimals` are given."""
    rounded = values if decimals is None else np.round(values, decimals)
    return [value if value == value else None for value in rounded.tolist()]
