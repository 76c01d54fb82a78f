"""Summary of a run: result, limits reached, recommended checks. Numbers in, findings out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from app.analysis.survey import Survey
from app.analysis.totals import number
from app.estimation.arrays import FloatArray, median, robust_sigma
from app.words import Argument, Cell, Message, Quantity, RenderedMessage, render, rendered

ODD_SIGMAS: Final = 5.0  # beyond so many robust standard deviations a cell is unlike the others
ODD_NAMED: Final = 3  # the oddest cells with their values; the others by name alone
LEAST_SAG_V: Final = 0.005
LEAST_HEAT_K: Final = 4.0
LOWEST_SHARE: Final = 0.3  # share of the driving; more is one cell's, not chance
SPREAD_SOC: Final = 0.03
LimitName = Literal["v_min", "v_max", "t_max", "i_max", "i_min"]
NEAR: Final[dict[LimitName, float]] = {
    "v_min": 0.2,
    "v_max": 0.02,
    "t_max": 5.0,
    "i_max": 15.0,
    "i_min": 10.0,
}  # closer counts as limiting
LOWEST_ALLOWED: Final[tuple[LimitName, ...]] = ("v_min", "i_min")  # the others are the highest allowed
_UNITS: Final[dict[LimitName, str]] = {"v_min": "V", "v_max": "V", "t_max": "degC", "i_max": "A", "i_min": "A"}
_LIMITS: Final[dict[LimitName, Message]] = {
    "v_min": Message("limit-v-min"),
    "v_max": Message("limit-v-max"),
    "t_max": Message("limit-t-max"),
    "i_max": Message("limit-i-max"),
    "i_min": Message("limit-i-min"),
}
_DIGITS: Final = {"V": 3, "degC": 1, "A": 1, "K": 1}


@dataclass(frozen=True)
class Margin:
    """The least distance of a recording to one limit; `margin` in the unit, negative = beyond."""

    limit: LimitName
    name: str
    unit: str
    seen: float
    allowed: float
    margin: float
    cell: int | None
    at_s: float | None


@dataclass(frozen=True)
class Odd:
    """A cell that is unlike the others in one respect."""

    message: RenderedMessage
    cell: int
    what: Literal["sag", "temperature", "lowest"]
    value: float
    usual: float
    unit: str


@dataclass(frozen=True)
class CellChange:
    """A cell whose resistance changed against the others' change."""

    cell: int
    change: float
    resistance_a_ohm: float
    resistance_b_ohm: float


def margins(survey: Survey, limits: dict[str, float]) -> list[Margin]:
    """Return how near every known limit came, the nearest first, by what counts as near."""
    ranked = []

    def add(limit: LimitName, key: str, seen: float, cell: int | None = None, at_s: float | None = None) -> None:
        if key in limits and np.isfinite(seen):
            ranked.append(margin_of(limit, seen, limits[key], cell, at_s))

    lowest, highest, hottest = (
        _extreme(survey.voltage_min_v, lowest=True),
        _extreme(survey.voltage_max_v, lowest=False),
        _extreme(survey.temperature_max_degc, lowest=False),
    )
    if lowest is not None:
        add("v_min", "v_cell_min", float(survey.voltage_min_v[lowest]), lowest, float(survey.voltage_min_at_s[lowest]))
    if highest is not None:
        add("v_max", "v_cell_max", float(survey.voltage_max_v[highest]), highest)
    if hottest is not None:
        degrees = float(survey.temperature_max_degc[hottest])
        add("t_max", "t_cell_max", degrees, hottest, float(survey.temperature_max_at_s[hottest]))
    add("i_max", "i_disc_max", survey.current_max_a)
    add("i_min", "i_disc_min", survey.current_min_a)
    return sorted(ranked, key=lambda margin: margin.margin / NEAR[margin.limit])


def margin_of(limit: LimitName, seen: float, allowed: float, cell: int | None, at_s: float | None) -> Margin:
    """Return how far a value is from its limit."""
    margin = seen - allowed if limit in LOWEST_ALLOWED else allowed - seen
    return Margin(limit, render(_LIMITS[limit]), _UNITS[limit], seen, allowed, margin, cell, at_s)


def odd_cells(survey: Survey) -> list[Odd]:
    """Return the cells that stand out in what no verdict is about, the oddest of each kind first."""
    cells: list[Odd] = []
    for cell, value, usual in _outliers(survey.sag_v, LEAST_SAG_V):
        message = Message("odd-sag", more=Quantity(1000 * (value - usual), "mV", 0))
        cells.append(_odd(message, cell, "sag", value, usual, "V"))
    for cell, value, usual in _outliers(survey.temperature_max_degc, LEAST_HEAT_K):
        message = Message("odd-temperature", temperature=Quantity(value, "degC", 0), usual=Quantity(usual, "degC", 0))
        cells.append(_odd(message, cell, "temperature", value, usual, "degC"))
    if survey.driving_s > 60.0:
        cell = int(survey.lowest_s.argmax())
        share = float(survey.lowest_s[cell] / survey.driving_s)
        if share > LOWEST_SHARE:
            cells.append(
                _odd(Message("odd-lowest", share=percent(share)), cell, "lowest", share, 1 / survey.n_cells, "1")
            )
    return cells


def headline(survey: Survey, n_laps: int) -> Message:
    """Return the run in one sentence."""
    if not survey.samples:
        return Message("report-nothing-measured")
    run: list[Argument] = [_length(survey.end_s - survey.start_s)]
    if survey.driving_s >= 30:
        run.append(Message("report-with-current", length=_length(survey.driving_s)))
    if n_laps:
        run.append(Message("report-laps", n=n_laps))
    out = _kwh(survey.energy_out_wh)
    is_whole = survey.has_energies
    parts: list[Argument] = [
        Message("report-energy-out", energy=out) if is_whole else Message("report-energy-out-at-least", energy=out)
    ]
    if survey.energy_in_wh >= 1.0:
        energy = _kwh(survey.energy_in_wh)
        if not is_whole:
            parts.append(Message("report-energy-in-at-least", energy=energy))
        elif survey.energy_out_wh > 1.0:
            share = percent(survey.energy_in_wh / survey.energy_out_wh)
            parts.append(Message("report-energy-in-share", energy=energy, share=share))
        else:
            parts.append(Message("report-energy-in", energy=energy))
    first, last = _mean(survey.soc_first), _mean(survey.soc_last)
    if first is not None and last is not None:
        parts.append(Message("report-charge", first=Quantity(100 * first, "", 0), last=percent(last)))
    hottest = _extreme(survey.temperature_max_degc, lowest=False)
    if hottest is not None:
        degrees = float(survey.temperature_max_degc[hottest])
        parts.append(Message("report-hottest", temperature=Quantity(degrees, "degC", 0)))
    return Message("report-headline", run=tuple(run), figures=tuple(parts))


def what_limited(margins: Sequence[Margin], trips: Sequence[Argument]) -> list[Message]:
    """Return what ended or held back the run: trips, limits that came near, else the one that was nearest."""
    findings = [Message("report-tripped", event=event) for event in trips]
    near = [margin for margin in margins if margin.margin < NEAR[margin.limit]]
    for limited in near or margins[:1]:
        what = _LIMITS[limited.limit]
        if limited.cell is not None:
            what = Message("limit-of-cell", limit=what, cell=Cell(limited.cell))
        step = "K" if limited.unit == "degC" else limited.unit
        seen = Quantity(limited.seen, limited.unit, _DIGITS[limited.unit])
        margin = Quantity(abs(limited.margin), step, _DIGITS[step])
        allowed = Quantity(limited.allowed, limited.unit)
        if not near:
            findings.append(Message("report-nearest", what=what, seen=seen, margin=margin, allowed=allowed))
        elif limited.margin < 0:
            findings.append(Message("report-beyond", what=what, seen=seen, margin=margin, allowed=allowed))
        else:
            findings.append(Message("report-near", what=what, seen=seen, margin=margin, allowed=allowed))
    return findings or [Message("report-no-limits")]


def recommended_checks(
    survey: Survey, odd: Sequence[Odd], warnings: Sequence[Argument], bad_frames: int
) -> list[Message]:
    """Return what deserves a look before the next run."""
    findings: list[Message] = []
    by_kind: dict[str, list[Odd]] = {}
    for odd_cell in odd:
        by_kind.setdefault(odd_cell.what, []).append(odd_cell)
    for kind in by_kind.values():
        findings += [
            Message("report-odd", cell=Cell(odd_cell.cell), what=odd_cell.message.message)
            for odd_cell in kind[:ODD_NAMED]
        ]
        others = tuple(Cell(odd_cell.cell) for odd_cell in kind[ODD_NAMED:])
        if others:
            findings.append(Message("report-odd-more", n=len(others), cells=others))
    lowest = _extreme(survey.soc_last, lowest=True)
    apart = _spread(survey.soc_last)
    if lowest is not None and apart > SPREAD_SOC:
        before = _spread(survey.soc_first)
        spread, cell = percent(apart, 1), Cell(lowest)
        if before < apart - SPREAD_SOC:
            began = percent(before, 1)
            findings.append(Message("report-spread-grown", spread=spread, cell=cell, before=began))
        else:
            findings.append(Message("report-spread", spread=spread, cell=cell))
    findings += [Message("report-warned", event=event) for event in warnings]
    if survey.gap_s > 0.0:
        findings.append(Message("report-gap", length=Quantity(survey.gap_s, "s", 0)))
    if bad_frames:
        findings.append(Message("report-damaged", n=bad_frames))
    return findings or [Message("report-nothing-odd")]


def key_figures(survey: Survey) -> dict[str, float | None]:
    """Return what two recordings are compared by; names carry the unit, None where not measured."""
    lowest, hottest = (
        _extreme(survey.voltage_min_v, lowest=True),
        _extreme(survey.temperature_max_degc, lowest=False),
    )
    spread = _spread(survey.soc_last)
    first, last = _mean(survey.soc_first), _mean(survey.soc_last)
    return {
        "duration_s": survey.end_s - survey.start_s if survey.samples else None,
        "driving_s": survey.driving_s,
        "energy_out_wh": survey.energy_out_wh if survey.has_energies else None,
        "energy_in_wh": survey.energy_in_wh if survey.has_energies else None,
        "charge_out_ah": survey.charge_out_ah,
        "power_max_w": number(survey.power_max_w),
        "current_max_a": number(survey.current_max_a),
        "current_min_a": number(survey.current_min_a),
        "voltage_min_v": None if lowest is None else float(survey.voltage_min_v[lowest]),
        "temperature_max_degc": None if hottest is None else float(survey.temperature_max_degc[hottest]),
        "soc_first": first,
        "soc_last": last,
        "soc_spread_last": number(spread),
        "resistance_median_ohm": number(median(survey.resistance_ohm)),
        "resistance_max_ohm": _max(survey.resistance_ohm),
    }


def compare_cells(first: Survey, second: Survey, most: int = 10) -> list[CellChange]:
    """Return the cells whose resistance changed the most between two recordings, against the others' change."""
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = second.resistance_ohm / first.resistance_ohm
    usual = median(ratio)
    if not np.isfinite(usual):
        return []
    change = ratio / usual - 1.0
    order = np.argsort(-np.abs(np.nan_to_num(change)))[:most]
    return [
        CellChange(
            int(cell), float(change[cell]), float(first.resistance_ohm[cell]), float(second.resistance_ohm[cell])
        )
        for cell in order
        if np.isfinite(change[cell])
    ]


def _outliers(values: FloatArray, least: float) -> list[tuple[int, float, float]]:
    """Cells far above the others: (cell, value, median), the farthest first."""
    usual = median(values)
    if not np.isfinite(usual):
        return []
    sigma = robust_sigma(values)
    far = np.flatnonzero(np.nan_to_num(values - usual, nan=-1.0) > max(ODD_SIGMAS * sigma, least))
    ordered = sorted(far.tolist(), key=lambda cell: -values[cell])
    return [(cell, float(values[cell]), usual) for cell in ordered]


def _mean(values: FloatArray) -> float | None:
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if finite.size else None


def _max(values: FloatArray) -> float | None:
    finite = values[np.isfinite(values)]
    return float(finite.max()) if finite.size else None


def _extreme(values: FloatArray, *, lowest: bool) -> int | None:
    finite_at = np.flatnonzero(np.isfinite(values))
    if not finite_at.size:
        return None
    return int(finite_at[values[finite_at].argmin() if lowest else values[finite_at].argmax()])


def _spread(values: FloatArray) -> float:
    finite = values[np.isfinite(values)]
    return float(np.ptp(finite)) if finite.size else float("nan")


def percent(fraction: float, digits: int = 0) -> Quantity:
    """Return a fraction in percent."""
    return Quantity(100 * fraction, "%", digits)


def _odd(
    message: Message,
    cell: int,
    what: Literal["sag", "temperature", "lowest"],
    value: float,
    usual: float,
    unit: str,
) -> Odd:
    return Odd(rendered(message), cell, what, value, usual, unit)


def _length(seconds: float) -> Quantity:
    return Quantity(seconds, "s", 0) if seconds < 90 else Quantity(seconds / 60, "min", 0)


def _kwh(energy_wh: float) -> Quantity:
    return Quantity(energy_wh / 1000, "kWh", 2)
