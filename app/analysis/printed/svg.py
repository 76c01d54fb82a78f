"""Charts as inline SVG for pages that are printed: thin lines, direct labels, gaps as gaps. Text out, nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from itertools import pairwise
from math import floor, log10

import numpy as np

from app.estimation.arrays import FloatArray

WIDTH = 720.0
LEFT, RIGHT, TOP, BOTTOM = 52.0, 92.0, 6.0, 20.0
LABEL_PX = 11.0
POINTS = 700  # buckets across; each keeps its smallest and largest value
X_TICKS, Y_TICKS = 8, 4
SOFT, GRID = "#5d676e", "#d2d7d9"
TEAL, AMBER, VIOLET, RED = "#006d7a", "#9a6400", "#6d3aa8", "#c01921"


@dataclass(frozen=True)
class Line:
    """One signal: (n,) ascending x and y, NaN = gap; the label stands at its end."""

    label: str
    x: FloatArray
    y: FloatArray
    colour: str = TEAL
    width: float = 1.2


@dataclass(frozen=True)
class Band:
    """What many signals do: (n,) lowest and highest."""

    label: str
    x: FloatArray
    low: FloatArray
    high: FloatArray
    colour: str = "#9fb4b8"


@dataclass(frozen=True)
class Rule:
    """A limit: a horizontal line with its name."""

    label: str
    value: float
    colour: str = RED


@dataclass(frozen=True)
class Mark:
    """An instant: a vertical line with its name."""

    label: str
    x: float
    colour: str = RED


@dataclass(frozen=True)
class Bars:
    """A histogram: (n + 1,) rising edges and (n,) heights."""

    edges: FloatArray
    heights: FloatArray
    colour: str = TEAL


def chart(
    unit: str,
    lines: Sequence[Line] = (),
    *,
    bands: Sequence[Band] = (),
    rules: Sequence[Rule] = (),
    marks: Sequence[Mark] = (),
    bars: Sequence[Bars] = (),
    x_unit: str = "s",
    height: float = 150.0,
    width: float = WIDTH,
    include: Sequence[float] = (),
    name: str = "",
) -> str:
    """Return an `<svg>` of signals over x: bands below, lines above.

    `x_unit` is written behind the last number of the x axis; `height` and `width` are CSS pixels; `include` are y
    values that the axis must hold; `name` is for readers who hear the page.
    """
    x_low, x_high = _range(
        [line.x for line in lines] + [band.x for band in bands] + [b.edges for b in bars], [mark.x for mark in marks]
    )
    y_values = [line.y for line in lines] + [part for band in bands for part in (band.low, band.high)]
    y_low, y_high = _range(y_values + [b.heights for b in bars], [rule.value for rule in rules] + list(include))
    margin = 0.06 * (y_high - y_low) or 0.5
    y_low, y_high = (0.0 if bars and y_low >= 0.0 else y_low - margin), y_high + margin
    box = _Box(x_low, x_high or 1.0, y_low, y_high, width, height)
    parts = [f'<svg viewBox="0 0 {width:g} {height:g}" role="img" aria-label="{escape(name or unit)}">']
    parts += _axes(box, unit, x_unit)
    parts += [_polygon(box, band) for band in bands]
    parts += [_bars(box, each) for each in bars]
    parts += [_rule(box, rule) for rule in rules]
    parts += [_mark(box, mark) for mark in marks]
    parts += [_polyline(box, line) for line in lines]
    parts += _labels(box, lines, bands)
    return "".join(parts) + "</svg>"


@dataclass(frozen=True)
class _Box:
    x_low: float
    x_high: float
    y_low: float
    y_high: float
    width: float
    height: float

    @property
    def right(self) -> float:
        return self.width - RIGHT

    @property
    def bottom(self) -> float:
        return self.height - BOTTOM

    def x(self, value: FloatArray | float) -> FloatArray:
        share = (np.asarray(value) - self.x_low) / ((self.x_high - self.x_low) or 1.0)
        return np.asarray(LEFT + share * (self.right - LEFT))

    def y(self, value: FloatArray | float) -> FloatArray:
        share = (np.asarray(value) - self.y_low) / ((self.y_high - self.y_low) or 1.0)
        return np.asarray(self.bottom - share * (self.bottom - TOP))


def _range(arrays: Sequence[FloatArray], more: Sequence[float]) -> tuple[float, float]:
    known = [array[np.isfinite(array)] for array in arrays]
    values = np.concatenate([*known, np.asarray(more, dtype=np.float64)]) if known or more else np.empty(0)
    return (float(values.min()), float(values.max())) if values.size else (0.0, 1.0)


def ticks(low: float, high: float, most: int) -> list[float]:
    """Return at most `most` + 1 round numbers within a range."""
    span = high - low
    if not span > 0.0:
        return [low]
    rough = span / most
    decade = 10.0 ** floor(log10(rough))
    step = next(decade * factor for factor in (1, 2, 5, 10) if decade * factor >= rough * 0.999)
    first = np.ceil(low / step - 1e-9)
    return [float(k * step) for k in np.arange(first, np.floor(high / step + 1e-9) + 1)]


def _number(value: float, step: float) -> str:
    decimals = max(0, -floor(log10(step) + 1e-9)) if step > 0 else 0
    return f"{value + 0.0 if abs(value) > 1e-9 * abs(step) else 0.0:.{decimals}f}".replace("-", "\u2212")


def _text(x: float, y: float, text: str, colour: str = SOFT, anchor: str = "start") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" fill="{colour}" text-anchor="{anchor}">{escape(text)}</text>'


def _axes(box: _Box, unit: str, x_unit: str) -> list[str]:
    parts = []
    levels = ticks(box.y_low, box.y_high, Y_TICKS)
    step = levels[1] - levels[0] if len(levels) > 1 else 1.0
    for value in levels:
        y = float(box.y(value))
        parts.append(f'<path d="M{LEFT:g} {y:.1f}H{box.right:g}" stroke="{GRID}" stroke-width="0.6"/>')
        parts.append(_text(LEFT - 6, y + 3.5, _number(value, step), anchor="end"))
    places = ticks(box.x_low, box.x_high, X_TICKS)
    step = places[1] - places[0] if len(places) > 1 else 1.0
    for k, value in enumerate(places):
        x = float(box.x(value))
        parts.append(f'<path d="M{x:.1f} {box.bottom:g}v4" stroke="{SOFT}" stroke-width="0.6"/>')
        text = _number(value, step) + (f" {x_unit}" if k == len(places) - 1 else "")
        parts.append(_text(x, box.height - 5, text, anchor="middle"))
    parts.append(_text(LEFT - 6, TOP + 5, unit, anchor="end") if not levels or box.y(levels[-1]) > TOP + 16 else "")
    return parts


def _thinned(x: FloatArray, *columns: FloatArray) -> tuple[FloatArray, ...]:
    """At most two points a bucket, so that no dip is lost."""
    if len(x) <= 2 * POINTS:
        return (x, *columns)
    edges = np.linspace(0, len(x), POINTS + 1).astype(int)
    keep = set()
    for low, high in pairwise(edges):
        for column in columns:
            piece = column[low:high]
            if np.isfinite(piece).any():
                keep |= {low + int(np.nanargmin(piece)), low + int(np.nanargmax(piece))}
            else:
                keep.add(low)
    order = np.array(sorted(keep))
    return (x[order], *(column[order] for column in columns))


def _polyline(box: _Box, line: Line) -> str:
    x, y = _thinned(line.x, line.y)
    commands, pen = [], "M"
    for px, py, known in zip(box.x(x), box.y(y), np.isfinite(y), strict=True):
        if not known:
            pen = "M"
            continue
        commands.append(f"{pen}{px:.1f} {py:.1f}")
        pen = "L"
    return f'<path d="{"".join(commands)}" fill="none" stroke="{line.colour}" stroke-width="{line.width:g}"/>'


def _polygon(box: _Box, band: Band) -> str:
    x, low, high = _envelope(band)
    known = np.isfinite(low) & np.isfinite(high)
    upper = [f"{px:.1f} {py:.1f}" for px, py in zip(box.x(x[known]), box.y(high[known]), strict=True)]
    lower = [f"{px:.1f} {py:.1f}" for px, py in zip(box.x(x[known]), box.y(low[known]), strict=True)]
    if not upper:
        return ""
    path = "L".join(upper + lower[::-1])
    return f'<path d="M{path}Z" fill="{band.colour}" fill-opacity="0.45" stroke="{band.colour}" stroke-width="0.4"/>'


def _envelope(band: Band) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Lowest of the low and highest of the high in each bucket."""
    if len(band.x) <= 2 * POINTS:
        return band.x, band.low, band.high
    starts = np.linspace(0, len(band.x), POINTS + 1).astype(int)[:-1]
    return band.x[starts], np.fmin.reduceat(band.low, starts), np.fmax.reduceat(band.high, starts)


def _bars(box: _Box, bars: Bars) -> str:
    zero = float(box.y(0.0))
    x = box.x(bars.edges)
    return "".join(
        f'<rect x="{left:.1f}" y="{top:.1f}" width="{max(right - left - 1, 0.5):.1f}" height="{max(zero - top, 0):.1f}"'
        f' fill="{bars.colour}"/>'
        for left, right, top in zip(x[:-1], x[1:], box.y(bars.heights), strict=True)
    )


def _rule(box: _Box, rule: Rule) -> str:
    y = float(box.y(rule.value))
    path = f'<path d="M{LEFT:g} {y:.1f}H{box.right:g}" stroke="{rule.colour}" stroke-dasharray="5 3"/>'
    return path + _text(box.right + 6, y + 3.5, rule.label, rule.colour)


def _mark(box: _Box, mark: Mark) -> str:
    x = float(box.x(mark.x))
    path = f'<path d="M{x:.1f} {TOP:g}V{box.bottom:g}" stroke="{mark.colour}" stroke-width="0.8"/>'
    return path + _text(x + 3, TOP + 8, mark.label, mark.colour)


def _labels(box: _Box, lines: Sequence[Line], bands: Sequence[Band]) -> list[str]:
    """Names at the right of what they name, pushed apart."""
    wanted = []
    for name, values, colour in [(line.label, line.y, line.colour) for line in lines] + [
        (band.label, 0.5 * (band.low + band.high), SOFT) for band in bands
    ]:
        known = values[np.isfinite(values)]
        if name and known.size:
            wanted.append((float(box.y(float(known[-1]))), name, colour))
    parts, lowest = [], -1e9
    for y, name, colour in sorted(wanted):
        lowest = max(y + 3.5, lowest + LABEL_PX)
        parts.append(_text(box.right + 6, lowest, name, colour))
    return parts
