"""Whether numbers can be cell voltages or temperatures, and in which unit."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.battery.source import TEMPERATURE_UNITS, VOLTAGE_UNITS, ZERO_AT
from app.estimation.arrays import FloatArray
from app.sources.dbc.definitions import Signal
from app.sources.dbc.learn.survey import Heard
from app.sources.dbc.units import known_conversion

CELL_VOLTAGE_V = (1.5, 4.6)  # of any lithium cell in use
TEMPERATURE_DEGC = (-30.0, 95.0)
_UNITS = {"voltage": VOLTAGE_UNITS, "temperature": TEMPERATURE_UNITS}
_RANGES = {"voltage": CELL_VOLTAGE_V, "temperature": TEMPERATURE_DEGC}
_FEW = 0.02  # of the values may be out of range: start-up, a sensor off


@dataclass(frozen=True, slots=True)
class Fit:
    """How numbers fit a quantity."""

    share: float  # of the measured values that are in range, 0..1
    unit: str  # for the profile; "" = the DBC's own unit is right
    low: float  # V or degC
    high: float
    invalid: tuple[int, ...]  # raw numbers out of range that mean: not measured
    n: int  # values
    others: tuple[str, ...] = ()  # units that fit as well, where `unit` is a guess


def converted(kind: str, values: FloatArray, unit: str, dbc_unit: str) -> FloatArray:
    """Return values in V or degC; `unit` of the profile, "" = as the DBC says."""
    if unit:
        return np.asarray(values * _UNITS[kind][unit] + ZERO_AT.get(unit, 0.0), np.float64)
    factor, zero = known_conversion(kind, dbc_unit) or (1.0, 0.0)
    return np.asarray(values * factor + zero, np.float64)


def fit(kind: str, signals: Iterable[tuple[Signal, Heard]]) -> Fit | None:
    """Return how what was heard of signals fits a quantity, in the unit that fits best; None where nothing fits."""
    pairs = list(signals)
    if not pairs:
        return None
    values = np.concatenate([heard.values for _, heard in pairs])
    raw = np.concatenate([heard.raw for _, heard in pairs])
    layout, dbc_unit = pairs[0][0].layout, pairs[0][0].unit
    codes = _codes(raw, layout.length, layout.is_signed)
    measured = ~np.isin(raw, codes) if codes else np.ones(len(raw), np.bool_)
    if not measured.any():
        return None
    low, high = _RANGES[kind]
    best: tuple[float, str, FloatArray] | None = None
    shares: dict[str, float] = {}
    for unit in ("", *_UNITS[kind]):
        found = converted(kind, values[measured], unit, dbc_unit)
        share = shares[unit] = float(np.mean((found >= low) & (found <= high)))
        if best is None or share > best[0] + 0.25:  # the DBC's own unit first
            best = share, unit, found
    assert best is not None
    share, unit, found = best
    inside = found[(found >= low) & (found <= high)]
    if not len(inside):
        return None
    outside = converted(kind, values, unit, dbc_unit)
    invalid = tuple(c for c in codes if not _all_in(outside[raw == c], low, high))
    others = tuple(other for other, of in shares.items() if unit and other not in ("", unit) and of >= share)
    return Fit(share, unit, float(inside.min()), float(inside.max()), invalid, int(measured.sum()), others)


def _all_in(values: FloatArray, low: float, high: float) -> bool:
    return bool(np.all((values >= low) & (values <= high)))


def _codes(raw: NDArray[np.int64], bits: int, is_signed: bool) -> tuple[int, ...]:
    """Raw numbers that batteries use for a value that was not measured, of those that are there."""
    ends = [0]
    if bits >= 8:
        ends += [-1, -(1 << (bits - 1)), (1 << (bits - 1)) - 1] if is_signed else [(1 << min(bits, 62)) - 1]
    return tuple(code for code in ends if np.any(raw == code))


def fits(found: Fit | None) -> bool:
    """Whether nearly all values are in range."""
    return found is not None and found.share >= 1.0 - 10 * _FEW


def declared_fit(kind: str, signal: Signal) -> float:
    """Return how a signal's declaration fits a quantity: 1 well, 0 unknown, -1 it cannot be one."""
    known = known_conversion(kind, signal.unit)
    if signal.unit and known is None:
        return -1.0
    if signal.layout.length < (6 if kind == "temperature" else 8) or signal.choices:
        return -1.0
    if kind == "voltage":
        factor = (known or (1.0, 0.0))[0]
        span = abs(signal.layout.scale) * factor * 2.0 ** min(signal.layout.length, 40)
        if known is not None and not span > 1.0:
            return -1.0
    return 1.0 if known is not None else 0.0
