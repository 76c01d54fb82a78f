"""Open-circuit voltage over state of charge: three ways to draw a curve through the same points.

A curve is built once from points; afterwards it answers value, slope and inverse for whole arrays.
Outside the range that was measured it continues as a straight line, so that a filter that strays there
is pulled back; `soc_at` never leaves -0.05..1.05.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, Literal, cast, get_args

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike

from app.estimation.arrays import FloatArray
from app.estimation.errors import ModelError

OcvMethod = Literal["interpolation", "polynomial", "smoothed"]

OCV_METHODS: Final = get_args(OcvMethod)
POLYNOMIAL_DEGREE: Final = 10
SLOPE_MIN_V: Final = 0.02  # V per unit of SOC: the least slope beyond the ends, so that the inverse exists
SLOPE_MAX_V: Final = 5.0  # the steepest continuation beyond the ends
OVERSHOOT: Final = 0.05  # how far past 0 and 1 the inverse may answer
SMOOTHING_CUTOFF: Final = 0.06  # share of the Nyquist rate of a grid of 501 points: features narrower than 3 % SOC go
_SMOOTHING_POINTS: Final = 501


@dataclass(frozen=True, eq=False)
class OcvCurve:
    """OCV(SOC) through measured points.

    Attributes:
        soc: (n,) SOC of the points, rising strictly, inside -0.05..1.05.
        voltage_v: (n,) rested voltage of the points [V], never falling.
        method: "interpolation" is monotone cubic (Fritsch-Carlson), "polynomial" a weighted fit of degree 10,
            "smoothed" straight lines for the value and a zero-phase low-passed derivative for the slope.

    Raises:
        ModelError: fewer than two points, points not rising, a value not finite, an unknown method.
    """

    soc: FloatArray
    voltage_v: FloatArray
    method: OcvMethod = "interpolation"
    _knots: FloatArray = field(init=False, repr=False)  # knot slopes, polynomial or smoothed slope
    _edges: tuple[FloatArray, FloatArray] = field(init=False, repr=False)  # value and slope at both ends
    _inverse: tuple[FloatArray, FloatArray] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        soc = np.array(self.soc, dtype=np.float64)
        voltage = np.array(self.voltage_v, dtype=np.float64)
        _check_points(soc, voltage, self.method)
        object.__setattr__(self, "soc", soc)
        object.__setattr__(self, "voltage_v", voltage)
        if self.method == "interpolation":
            knots = monotone_slopes(soc, voltage)
        elif self.method == "polynomial":
            knots = _polynomial(soc, voltage)
        else:
            knots = _smoothed_slope(soc, voltage)
        object.__setattr__(self, "_knots", knots)
        ends = soc[[0, -1]]
        edges = self._value(ends), np.clip(self._slope(ends), SLOPE_MIN_V, SLOPE_MAX_V)
        object.__setattr__(self, "_edges", edges)
        fine = np.linspace(-OVERSHOOT, 1.0 + OVERSHOOT, 1101)
        values = np.maximum.accumulate(self.voltage(fine)) + 1e-9 * np.arange(fine.size)
        object.__setattr__(self, "_inverse", (values, fine))

    @property
    def soc_range(self) -> tuple[float, float]:
        """Lowest and highest SOC that was measured; outside, the curve is a straight line."""
        return float(self.soc[0]), float(self.soc[-1])

    def voltage(self, soc: ArrayLike) -> FloatArray:
        """Return the OCV [V] at each SOC, any shape."""
        x = np.asarray(soc, dtype=np.float64)
        low, high = self.soc_range
        value = self._value(np.minimum(np.maximum(x, low), high))
        edge_value, edge_slope = self._edges
        if (below := x < low).any():
            value = np.where(below, edge_value[0] + edge_slope[0] * (x - low), value)
        if (above := x > high).any():
            value = np.where(above, edge_value[1] + edge_slope[1] * (x - high), value)
        return np.asarray(value)

    def slope(self, soc: ArrayLike) -> FloatArray:
        """Return dOCV/dSOC [V] at each SOC, any shape."""
        x = np.asarray(soc, dtype=np.float64)
        low, high = self.soc_range
        slope = self._slope(np.minimum(np.maximum(x, low), high))
        _, edge_slope = self._edges
        return np.where(x < low, edge_slope[0], np.where(x > high, edge_slope[1], slope))

    def soc_at(self, voltage_v: ArrayLike) -> FloatArray:
        """Return the SOC whose OCV is the given voltage [V]; held at -0.05 and 1.05 beyond the curve, NaN for NaN."""
        v = np.asarray(voltage_v, dtype=np.float64)
        values, fine = self._inverse
        return np.where(np.isnan(v), np.nan, np.interp(v, values, fine))

    def _value(self, soc: FloatArray) -> FloatArray:
        if self.method == "polynomial":
            return np.asarray(self._fitted()(soc))
        if self.method == "smoothed":
            return np.asarray(np.interp(soc, self.soc, self.voltage_v))
        y0, t, m0, c2, c3, _ = _cubics(soc, self.soc, self.voltage_v, self._knots)
        return y0 + t * (m0 + t * (c2 + t * c3))

    def _slope(self, soc: FloatArray) -> FloatArray:
        if self.method == "polynomial":
            return np.asarray(self._fitted().deriv()(soc))
        if self.method == "smoothed":
            return np.asarray(np.interp(soc, np.linspace(*self.soc_range, _SMOOTHING_POINTS), self._knots))
        _, t, m0, c2, c3, h = _cubics(soc, self.soc, self.voltage_v, self._knots)
        return (m0 + t * (2 * c2 + 3 * t * c3)) / h

    def _fitted(self) -> Polynomial:
        return Polynomial(self._knots, domain=list(self.soc_range))


def from_rests(soc: ArrayLike, voltage_v: ArrayLike, method: OcvMethod = "interpolation") -> OcvCurve:
    """Return the curve through rested points (n,) of a pulse test; points closer than 0.1 % SOC are averaged.

    Raises:
        ModelError: fewer than two distinct points.
    """
    s, v = _branch(soc, voltage_v, "rests")
    bins = np.round(s * 1000.0).astype(np.int64)
    kept = np.unique(bins)
    mean_soc = np.array([s[bins == b].mean() for b in kept])
    mean_v = np.array([v[bins == b].mean() for b in kept])
    return OcvCurve(mean_soc, np.maximum.accumulate(mean_v), method)


def from_two_currents(
    soc: ArrayLike,
    low_current_v: ArrayLike,
    high_current_v: ArrayLike,
    low_current_a: float,
    high_current_a: float,
    method: OcvMethod = "interpolation",
) -> OcvCurve:
    """Return the curve at no current, extrapolated linearly from two discharge curves.

    OCV = v_low + (v_low - v_high) i_low / (i_high - i_low): the drop is taken as proportional to the current,
    which holds at equal SOC and temperature only.

    Args:
        soc: (n,) SOC of both curves.
        low_current_v: (n,) terminal voltage at the lower current [V].
        high_current_v: (n,) terminal voltage at the higher current [V].
        low_current_a: the lower current, positive on discharge [A].
        high_current_a: the higher current [A].
        method: how the curve is drawn.

    Raises:
        ModelError: equal currents or fewer than two points.
    """
    if high_current_a == low_current_a:
        raise ModelError("ocv", "two discharge curves at the same current say nothing about the curve at none")
    low_v = np.asarray(low_current_v, dtype=np.float64)
    drop = (low_v - np.asarray(high_current_v, dtype=np.float64)) / (high_current_a - low_current_a)
    s, v = _branch(soc, low_v + drop * low_current_a, "curves")
    return OcvCurve(s, np.maximum.accumulate(v), method)


def monotone_slopes(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the (n,) knot slopes of the monotone cubic through (x, y).

    Source: Fritsch and Carlson 1980; inside, the weighted harmonic mean of Fritsch and Butland 1984.
    """
    h = np.diff(x)
    d = np.diff(y) / h
    if d.size == 1:
        return np.repeat(d, 2)
    w1, w2 = 2 * h[1:] + h[:-1], h[1:] + 2 * h[:-1]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        inner = np.where(d[:-1] * d[1:] > 0, (w1 + w2) / (w1 / d[:-1] + w2 / d[1:]), 0.0)
    first = _end_slope(h[0], h[1], d[0], d[1])
    last = _end_slope(h[-1], h[-2], d[-1], d[-2])
    return np.concatenate(([first], inner, [last]))


def _end_slope(h0: float, h1: float, d0: float, d1: float) -> float:
    slope = ((2 * h0 + h1) * d0 - h0 * d1) / (h0 + h1)
    if slope * d0 <= 0:
        return 0.0
    return 3 * d0 if d0 * d1 < 0 and abs(slope) > abs(3 * d0) else slope


def _cubics(x: FloatArray, knots: FloatArray, y: FloatArray, m: FloatArray) -> tuple[FloatArray, ...]:
    """Return for each x its Hermite cubic y0 + t (m0 + t (c2 + t c3)): y0, t, m0, c2, c3, and h by which t is x."""
    j = np.minimum(np.maximum(knots.searchsorted(x, side="right") - 1, 0), knots.size - 2)
    k = j + 1
    start = knots.take(j)
    h = knots.take(k) - start
    y0, y1, m0, m1 = y.take(j), y.take(k), m.take(j) * h, m.take(k) * h
    return y0, (x - start) / h, m0, 3 * (y1 - y0) - 2 * m0 - m1, 2 * (y0 - y1) + m0 + m1, h


def _polynomial(soc: FloatArray, voltage: FloatArray) -> FloatArray:
    """Fit with a fivefold weight in the middle of the range, where the cell is used and the ends would rule."""
    weight = np.where((soc > 0.1) & (soc < 0.9), 5.0, 1.0)
    degree = min(POLYNOMIAL_DEGREE, soc.size - 1)
    fit = Polynomial.fit(soc, voltage, degree, domain=[soc[0], soc[-1]], w=weight)
    return cast(FloatArray, fit.coef)


def _smoothed_slope(soc: FloatArray, voltage: FloatArray) -> FloatArray:
    grid = np.linspace(soc[0], soc[-1], _SMOOTHING_POINTS)
    return zero_phase_lowpass(np.gradient(np.interp(grid, soc, voltage), grid), SMOOTHING_CUTOFF)


def zero_phase_lowpass(signal: FloatArray, cutoff: float) -> FloatArray:
    """Return the (n,) signal after a second-order Butterworth low-pass run forward and backward: no phase shift.

    Args:
        signal: (n,) evenly spaced samples.
        cutoff: corner as a fraction of the Nyquist rate, 0..1; after two passes the gain there is one half.

    The ends are extended by odd reflection, so that a straight line passes unchanged.
    """
    k = np.tan(0.5 * np.pi * cutoff)
    norm = 1.0 / (1.0 + np.sqrt(2.0) * k + k * k)
    b = np.array([k * k, 2 * k * k, k * k]) * norm
    a1, a2 = 2.0 * (k * k - 1.0) * norm, (1.0 - np.sqrt(2.0) * k + k * k) * norm
    pad = min(signal.size - 1, int(6.0 / cutoff))
    head, tail = 2 * signal[0] - signal[pad:0:-1], 2 * signal[-1] - signal[-2 : -pad - 2 : -1]
    x = np.concatenate((head, signal, tail))
    for _ in range(2):
        x = _biquad(x, b, a1, a2)[::-1]
    return x[pad : pad + signal.size].copy()


def _biquad(x: FloatArray, b: FloatArray, a1: float, a2: float) -> FloatArray:
    """Direct form II transposed, started in the steady state of the first sample."""
    y = np.empty_like(x)
    s1, s2 = (1.0 - b[0]) * x[0], (b[2] - a2) * x[0]
    for n, value in enumerate(x):
        y[n] = b[0] * value + s1
        s1 = b[1] * value - a1 * y[n] + s2
        s2 = b[2] * value - a2 * y[n]
    return y


def _branch(soc: ArrayLike, voltage_v: ArrayLike, name: str) -> tuple[FloatArray, FloatArray]:
    s = np.asarray(soc, dtype=np.float64)
    v = np.asarray(voltage_v, dtype=np.float64)
    if s.shape != v.shape or s.ndim != 1 or s.size < 2:
        raise ModelError("ocv", f"{name}: needs at least two samples, got shapes {s.shape} and {v.shape}")
    order = np.argsort(s, kind="stable")
    return s[order], v[order]


def _check_points(soc: FloatArray, voltage: FloatArray, method: str) -> None:
    if method not in OCV_METHODS:
        raise ModelError("ocv.method", f"{method!r} is none of {', '.join(OCV_METHODS)}")
    if soc.ndim != 1 or soc.shape != voltage.shape or soc.size < 2:
        raise ModelError(
            "ocv.voltage_v", f"needs as many voltages as SOC points, at least 2: {voltage.shape}, {soc.shape}"
        )
    if not (np.isfinite(soc).all() and np.isfinite(voltage).all()):
        raise ModelError("ocv.voltage_v", "holds a value that is not finite")
    if not (np.diff(soc) > 0).all() or soc[0] < -OVERSHOOT or soc[-1] > 1.0 + OVERSHOOT:
        raise ModelError("ocv.soc", "has to rise strictly inside -0.05..1.05")
    if not (np.diff(voltage) >= 0).all() or voltage[-1] <= voltage[0]:
        raise ModelError("ocv.voltage_v", "has to rise with SOC")
