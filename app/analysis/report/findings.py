"""What a person would say after a run: how it went, what limited, what to look at. Numbers in, sentences out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from app.analysis.black_box.excerpt import place
from app.analysis.survey import Survey
from app.analysis.totals import number
from app.estimation.arrays import FloatArray

MAD_TO_SIGMA: Final = 1.4826
ODD_SIGMAS: Final = 5.0  # beyond so many robust standard deviations a cell is unlike the others
ODD_NAMED: Final = 3  # of the oddest cells, by name
LEAST_SAG_V: Final = 0.005
LEAST_GROWTH: Final = 0.1  # of the resistance, against the median
LEAST_HEAT_K: Final = 4.0
LOWEST_SHARE: Final = 0.3  # of the driving: more is one cell's, not chance
SPREAD_SOC: Final = 0.03
MISSING_SHARE: Final = 0.001
NEAR: Final = {"v_min": 0.2, "v_max": 0.02, "t_max": 5.0, "i_max": 15.0, "i_min": 10.0}  # closer counts as limiting
_UNITS: Final = {"v_min": "V", "v_max": "V", "t_max": "degC", "i_max": "A", "i_min": "A"}
_NAMES: Final = {
    "v_min": "low cell voltage",
    "v_max": "high cell voltage",
    "t_max": "cell temperature",
    "i_max": "discharge current",
    "i_min": "regeneration current",
}


@dataclass(frozen=True)
class Margin:
    """How near the recording came to one limit; `margin` in the unit, negative = beyond."""

    limit: str
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

    cell: int
    what: str  # sag, resistance, temperature, lowest, missing
    value: float
    usual: float
    unit: str
    text: str


def margins(survey: Survey, limits: dict[str, float]) -> list[Margin]:
    """Return how near every known limit came, the nearest first, by what counts as near."""
    found = []

    def add(limit: str, key: str, seen: float, cell: int | None = None, at_s: float | None = None) -> None:
        if key in limits and np.isfinite(seen):
            allowed = limits[key]
            margin = seen - allowed if limit in ("v_min", "i_min") else allowed - seen
            found.append(Margin(limit, _NAMES[limit], _UNITS[limit], seen, allowed, margin, cell, at_s))

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
    return sorted(found, key=lambda each: each.margin / NEAR[each.limit])


def odd_cells(survey: Survey) -> list[Odd]:
    """Return the cells that stand out, the oddest of each kind first."""
    found: list[Odd] = []
    for cell, value, usual in _outliers(survey.sag_v, LEAST_SAG_V):
        text = f"sags {1000 * (value - usual):.0f} mV more than the others above 50 A"
        found.append(Odd(cell, "sag", value, usual, "V", text))
    for cell, value, usual in _outliers(survey.resistance_ohm, LEAST_GROWTH * _median(survey.resistance_ohm)):
        text = f"has {1000 * value:.2f} m\u03a9 with its joint, the others {1000 * usual:.2f}"
        found.append(Odd(cell, "resistance", value, usual, "ohm", text))
    for cell, value, usual in _outliers(survey.temperature_max_degc, LEAST_HEAT_K):
        text = f"came to {value:.0f} \u00b0C, the median cell to {usual:.0f}"
        found.append(Odd(cell, "temperature", value, usual, "degC", text))
    if survey.driving_s > 60.0:
        cell = int(survey.lowest_s.argmax())
        share = float(survey.lowest_s[cell] / survey.driving_s)
        if share > LOWEST_SHARE:
            text = f"was the lowest cell for {100 * share:.0f} % of the driving"
            found.append(Odd(cell, "lowest", share, 1.0 / survey.n_cells, "1", text))
    for cell in np.flatnonzero(survey.missing > MISSING_SHARE * max(survey.samples, 1))[:ODD_NAMED].tolist():
        share = float(survey.missing[cell]) / max(survey.samples, 1)
        found.append(Odd(cell, "missing", share, 0.0, "1", f"had no voltage in {100 * share:.1f} % of the samples"))
    return found


def headline(survey: Survey, n_laps: int) -> str:
    """Return the run in one sentence."""
    if not survey.samples:
        return "Nothing was measured."
    length = _span(survey.end_s - survey.start_s)
    driven = f", {_span(survey.driving_s)} of it with current" if survey.driving_s >= 30 else ""
    laps = f", {n_laps} laps" if n_laps else ""
    said = [f"{length}{driven}{laps}: {survey.energy_out_wh / 1000:.2f} kWh out"]
    if survey.energy_in_wh >= 1.0:
        share = 100 * survey.energy_in_wh / survey.energy_out_wh if survey.energy_out_wh > 1.0 else None
        said.append(f"{survey.energy_in_wh / 1000:.2f} kWh in" + ("" if share is None else f" ({share:.0f} %)"))
    first, last = _mean(survey.soc_first), _mean(survey.soc_last)
    if first is not None and last is not None:
        said.append(f"charge from {100 * first:.0f} to {100 * last:.0f} %")
    hottest = _extreme(survey.temperature_max_degc, lowest=False)
    if hottest is not None:
        said.append(f"hottest cell {survey.temperature_max_degc[hottest]:.0f} \u00b0C")
    return ", ".join(said) + "."


def what_limited(found: Sequence[Margin], trips: Sequence[str]) -> list[str]:
    """Return what ended or held back the run: trips, limits that came near, else the one that was nearest."""
    said = [f"Tripped: {text}." for text in trips]
    near = [each for each in found if each.margin < NEAR[each.limit]]
    for each in near or found[:1]:
        where = f" in {place(each.cell)}" if each.cell is not None else ""
        amount = f"{abs(each.margin):.3g} {each.unit}".replace("degC", "K")
        seen = f"{each.seen:.4g} {each.unit}".replace("degC", "\u00b0C")
        how = f"{amount} beyond the limit" if each.margin < 0 else f"{amount} from the limit"
        lead = f"{'Beyond' if each.margin < 0 else 'Near'} its limit was {each.name}"
        if not near:
            lead = f"Nothing came near a limit; nearest was {each.name}"
        said.append(f"{lead}{where}: {seen}, {how} of {each.allowed:g}.".replace("-", "\u2212"))
    return said or ["No limits were heard, so nothing can be said of them."]


def what_to_look_at(survey: Survey, odd: Sequence[Odd], warnings: Sequence[str], bad_frames: int) -> list[str]:
    """Return what deserves a look before the next run."""
    said = []
    by_kind: dict[str, list[Odd]] = {}
    for each in odd:
        by_kind.setdefault(each.what, []).append(each)
    for kind in by_kind.values():
        said += [f"{_capital(place(each.cell))} {each.text}." for each in kind[:ODD_NAMED]]
        if len(kind) > ODD_NAMED:
            said[-1] = said[-1][:-1] + f", and {len(kind) - ODD_NAMED} more cells stand out likewise."
    known = survey.soc_last[np.isfinite(survey.soc_last)]
    if known.size and float(np.ptp(known)) > SPREAD_SOC:
        low = _extreme(survey.soc_last, lowest=True)
        began = survey.soc_first[np.isfinite(survey.soc_first)]
        apart, before = float(np.ptp(known)), float(np.ptp(began)) if began.size else float("nan")
        advice = f", having begun {100 * before:.1f} % apart" if before < apart - SPREAD_SOC else ": balance them"
        said.append(f"The cells ended {100 * apart:.1f} % apart in charge, {place(low)} lowest{advice}.")
    said += [f"{_capital(text)}." for text in dict.fromkeys(warnings)]
    if survey.gap_s > 0.0:
        said.append(f"Nothing was received for {survey.gap_s:.0f} s in all.")
    if bad_frames:
        said.append(f"{bad_frames} frames arrived damaged: look at the cable.")
    return said or ["Nothing stands out."]


def key_figures(survey: Survey) -> dict[str, float | None]:
    """Return what two recordings are compared by; names carry the unit, None where not measured."""
    lowest, hottest = (
        _extreme(survey.voltage_min_v, lowest=True),
        _extreme(survey.temperature_max_degc, lowest=False),
    )
    known = survey.soc_last[np.isfinite(survey.soc_last)]
    first, last = _mean(survey.soc_first), _mean(survey.soc_last)
    return {
        "duration_s": survey.end_s - survey.start_s if survey.samples else None,
        "driving_s": survey.driving_s,
        "energy_out_wh": survey.energy_out_wh,
        "energy_in_wh": survey.energy_in_wh,
        "charge_out_ah": survey.charge_out_ah,
        "power_max_w": number(survey.power_max_w),
        "current_max_a": number(survey.current_max_a),
        "current_min_a": number(survey.current_min_a),
        "voltage_min_v": None if lowest is None else float(survey.voltage_min_v[lowest]),
        "temperature_max_degc": None if hottest is None else float(survey.temperature_max_degc[hottest]),
        "soc_first": first,
        "soc_last": last,
        "soc_spread_last": float(np.ptp(known)) if known.size else None,
        "resistance_median_ohm": number(_median(survey.resistance_ohm)),
        "resistance_max_ohm": _max(survey.resistance_ohm),
    }


def compare_cells(first: Survey, second: Survey, most: int = 10) -> list[dict[str, Any]]:
    """Return the cells whose resistance changed the most between two recordings, against the others' change."""
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = second.resistance_ohm / first.resistance_ohm
    usual = _median(ratio)
    if not np.isfinite(usual):
        return []
    change = ratio / usual - 1.0
    order = np.argsort(-np.abs(np.nan_to_num(change)))[:most]
    return [
        {
            "cell": int(cell),
            "change": float(change[cell]),
            "resistance_a_ohm": float(first.resistance_ohm[cell]),
            "resistance_b_ohm": float(second.resistance_ohm[cell]),
        }
        for cell in order
        if np.isfinite(change[cell])
    ]


def _outliers(values: FloatArray, least: float) -> list[tuple[int, float, float]]:
    """Cells far above the others: (cell, value, median), the farthest first."""
    usual = _median(values)
    if not np.isfinite(usual):
        return []
    sigma = MAD_TO_SIGMA * _median(np.abs(values - usual))
    far = np.flatnonzero(np.nan_to_num(values - usual, nan=-1.0) > max(ODD_SIGMAS * sigma, least))
    ordered = sorted(far.tolist(), key=lambda cell: -values[cell])
    return [(cell, float(values[cell]), usual) for cell in ordered]


def _median(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else float("nan")


def _mean(values: FloatArray) -> float | None:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else None


def _max(values: FloatArray) -> float | None:
    known = values[np.isfinite(values)]
    return float(known.max()) if known.size else None


def _extreme(values: FloatArray, *, lowest: bool) -> int | None:
    known = np.flatnonzero(np.isfinite(values))
    if not known.size:
        return None
    return int(known[values[known].argmin() if lowest else values[known].argmax()])


def _span(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 90 else f"{seconds / 60:.0f} min"


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
