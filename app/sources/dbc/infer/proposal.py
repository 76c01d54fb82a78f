"""A proposed mapping of cells or sensors to signals, with its score."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from math import log2

import numpy as np
from numpy.typing import NDArray

from app.battery.source import TEMPERATURE_UNITS, VOLTAGE_UNITS, ZERO_AT, CellSignals
from app.estimation.arrays import FloatArray
from app.sources.dbc.bindings import known_conversion
from app.sources.dbc.definitions import MessageDefinition, SignalDefinition
from app.sources.dbc.infer.bus_survey import (
    CELL,
    NOT_A_CELL,
    TEMPERATURE,
    VOLTAGE,
    BusSurvey,
    ReceivedSignal,
    name_set,
    words,
)
from app.words import Text

CELL_VOLTAGE_V = (1.5, 4.6)  # range of any lithium cell in use
TEMPERATURE_DEGC = (-30.0, 95.0)
_UNITS = {"voltage": VOLTAGE_UNITS, "temperature": TEMPERATURE_UNITS}
_RANGES = {"voltage": CELL_VOLTAGE_V, "temperature": TEMPERATURE_DEGC}
_STILL_S = 45.0  # a temperature that never moves for so long is hardly one
_FEW = 0.02  # share of values that may be out of range: start-up, a sensor off


@dataclass(frozen=True, slots=True)
class Fit:
    """The fit of numbers to a quantity."""

    share: float  # share of the measured values in range, 0..1
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


def fit(kind: str, signals: Iterable[tuple[SignalDefinition, ReceivedSignal]]) -> Fit | None:
    """Return how what was received of signals fits a quantity, in the unit that fits best; None where nothing fits."""
    pairs = list(signals)
    if not pairs:
        return None
    values = np.concatenate([received.values for _, received in pairs])
    raw = np.concatenate([received.raw for _, received in pairs])
    layout, dbc_unit = pairs[0][0].layout, pairs[0][0].unit
    codes = _codes(raw, layout.length, layout.is_signed)
    measured = ~np.isin(raw, codes) if codes else np.ones(len(raw), np.bool_)
    if not measured.any():
        return None
    low, high = _RANGES[kind]
    best: tuple[float, str, FloatArray] | None = None
    shares: dict[str, float] = {}
    for unit in ("", *_UNITS[kind]):
        in_unit = converted(kind, values[measured], unit, dbc_unit)
        share = shares[unit] = float(np.mean((in_unit >= low) & (in_unit <= high)))
        if best is None or share > best[0] + 0.25:  # the DBC's own unit first
            best = share, unit, in_unit
    assert best is not None
    share, unit, in_unit = best
    inside = in_unit[(in_unit >= low) & (in_unit <= high)]
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


def fits(fitted: Fit | None) -> bool:
    """Return whether nearly all values are in range."""
    return fitted is not None and fitted.share >= 1.0 - 10 * _FEW


def declared_fit(kind: str, signal: SignalDefinition) -> float:
    """Return how a signal's declaration fits a quantity: 1 well, 0 unknown, -1 it cannot be one."""
    conversion = known_conversion(kind, signal.unit)
    if signal.unit and conversion is None:
        return -1.0
    if signal.layout.length < (6 if kind == "temperature" else 8) or signal.choices:
        return -1.0
    if kind == "voltage":
        factor = (conversion or (1.0, 0.0))[0]
        span = abs(signal.layout.scale) * factor * 2.0 ** min(signal.layout.length, 40)
        if conversion is not None and not span > 1.0:
            return -1.0
    return 1.0 if conversion is not None else 0.0


Member = tuple[MessageDefinition, SignalDefinition]
_HARD = name_set(
    "min max minimum maximum avg average mean limit limits threshold delta diff sum total motor inverter bal "
    "balance balancing soc soh resist resistance ocv open lowest highest low high over under ov uv ot ut "
    "current"
)
_MANY = 24  # signals of one unit that are hardly anything but cells
_INNER = name_set("afe debug sim simulation test dummy raw request req rx")  # messages that are rather not the car's


@dataclass(frozen=True, slots=True)
class CellProposal:
    """Signals that may carry cell voltages or temperatures."""

    kind: str
    entries: tuple[CellSignals, ...]
    n: int  # cells or sensors
    segments: tuple[int, ...] | None  # cells of each where names or numbers tell
    members: tuple[Member, ...]
    reasons: tuple[Text, ...]
    score: float
    fit: Fit | None  # fit of the received values
    mean: float = float("nan")  # V or degC of all that was received

    def with_reason(self, *reasons: Text) -> "CellProposal":
        """The same with more reasons."""
        return replace(self, reasons=(*self.reasons, *reasons))


def received_signals(survey: BusSurvey, members: tuple[Member, ...]) -> list[tuple[SignalDefinition, ReceivedSignal]]:
    """Return the signals that were received."""
    pairs = [(signal, survey.signal(message, signal.name)) for message, signal in members]
    return [(signal, received) for signal, received in pairs if received is not None]


def judged(survey: BusSurvey, kind: str, members: tuple[Member, ...], n: int) -> tuple[float, Fit | None] | None:
    """Return the proposal that members carry a quantity, with its score; None where they cannot."""
    message, signal = members[0]
    own, around = words(signal.name), words(message.name)
    wanted = VOLTAGE if kind == "voltage" else TEMPERATURE
    other = TEMPERATURE if kind == "voltage" else VOLTAGE
    declared = declared_fit(kind, signal)
    if declared < 0 or own & _HARD:
        return None
    score = log2(max(n, 1)) + 2.0 * declared
    score += 3.0 if own & CELL else (1.5 if around & CELL else 0.0)
    score += 2.5 if own & wanted else (1.5 if around & wanted else 0.0)
    if not (own | around) & (CELL | wanted):
        score -= 3.0 if declared < 1.0 or n < _MANY else 1.5
    if own & other and not own & wanted:
        score -= 4.0
    score -= 2.0 * len(own & NOT_A_CELL) + 1.5 * len(around & NOT_A_CELL & _HARD)
    score -= 0.3 * len(around & _INNER)
    received = received_signals(survey, members)
    fitted = fit(kind, received) if received else None
    if received:
        score += 4.0 if fits(fitted) else -8.0
        score += log2(max(len(received) / len(members), 0.05))
        if kind == "temperature" and fitted is not None and fitted.low == fitted.high and survey.duration_s > _STILL_S:
            score -= 4.0
    elif survey.n_frames:
        score -= 5.0
    return score, fitted
