"""Hypotheses about what all cells share: cold, an empty accumulator, hot or cold air, cooling that fails."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from app.analysis.root_cause.recording import Hypothesis, SessionStretch
from app.estimation.arrays import FloatArray, median, row_mean
from app.estimation.cell_model.circuit import CellModel
from app.words import Message, Quantity

EMPTY_SOC: Final = 0.12
NEAR_V: Final = 0.25  # volts of the median cell above the limit
LOW_V: Final = 0.45
LOW_CELLS: Final = 8  # that near the limit together are an empty accumulator, not a weak cell
COLD_DEGC: Final = 0.0
CELL_J_PER_K: Final = 450.0
AIR_K: Final = 2.5
AIR_WINDOW_S: Final = 90.0
COOLING_FROM_K: Final = 1.5  # duty times kelvin above the air: less shows nothing of the fans
COOLING_LEAST_S: Final = 150.0
COOLING_SOC: Final = 0.3  # below, the reaction itself takes up heat
EMPTY_WEIGHT: Final = 36.0  # an empty pack has large differences of cells from small ones in SOC
HOT_K: Final = 10.0  # below the limit: cooler, nobody needs the fans
COOLING_W_PER_K: Final = 0.6  # cooling of a cell at full fan duty, at least


def pack_hypotheses(recording: SessionStretch, model: CellModel) -> Iterator[Hypothesis]:
    """Yield what all cells do together."""
    if recording.time_s.size < 20:
        return
    for event in recording.events:
        if event.severity != "trip":
            continue
        rows = recording.near(event.at_s - 1.5, event.at_s + 0.1)
        if rows.start == rows.stop:
            continue
        volts = float(np.min(_or_inf(recording.median_v[rows])))
        degc, soc = median(recording.median_degc[rows]), median(recording.soc[rows])
        limit = recording.limits.get("v_cell_min", 2.5)
        condition = event.code.removeprefix("trip-")
        if condition == "cell-undervoltage":
            if degc < COLD_DEGC:
                yield Hypothesis("accumulator-cold", event.at_s - 5.0, 15.0, (_cold(degc),))
            low = int((_or_inf(recording.voltage_v[rows]).min(axis=0) < limit + LOW_V).sum())
            if np.isfinite(soc) and (volts < limit + NEAR_V or (soc < EMPTY_SOC and low >= LOW_CELLS)):
                level = Quantity(100 * float(soc), "%", 0)
                middle = Quantity(float(volts), "V", 2)
                yield Hypothesis(
                    "accumulator-empty",
                    event.at_s - 5.0,
                    EMPTY_WEIGHT,
                    (Message("seen-empty", soc=level, middle=middle),),
                )
        hot_limit = recording.limits.get("t_cell_max", 60.0)
        if condition == "cell-overtemperature" and degc > hot_limit - 4.0:
            evidence = (Message("seen-hot", temperature=Quantity(float(degc), "degC", 0)),)
            yield Hypothesis("accumulator-hot", event.at_s - 5.0, 8.0, evidence)
        if condition == "cell-undertemperature" and degc < recording.limits.get("t_cell_min", -15.0) + 4.0:
            yield Hypothesis("accumulator-cold", event.at_s - 5.0, 15.0, (_cold(degc),))
    yield from _air(recording, model)


def _or_inf(values: FloatArray) -> FloatArray:
    """Values whose missing ones are no minimum."""
    return np.where(np.isnan(values), np.inf, values)


def _cold(degc: float) -> Message:
    return Message("seen-cold", temperature=Quantity(float(degc), "degC", 0))


def _air(recording: SessionStretch, model: CellModel) -> Iterator[Hypothesis]:
    """The boards are light and follow the air; the cells follow their own heat."""
    boards = recording.boards
    own = row_mean(boards.own_degc)
    is_finite = np.isfinite(own)
    if is_finite.sum() < 20:
        return
    times, own = boards.time_s[is_finite], own[is_finite]
    cells = np.interp(times, recording.time_s, recording.mean_degc)
    before = np.searchsorted(times, times - AIR_WINDOW_S)
    rows = np.flatnonzero(times - times[0] >= 0.5 * AIR_WINDOW_S)
    moved, warmed = own[rows] - own[before[rows]], cells[rows] - cells[before[rows]]
    is_charging = bool((recording.charger_state > 0).any())  # bleeding warms the boards then
    hot = np.flatnonzero((moved - warmed >= AIR_K) & (moved >= AIR_K))
    cold = np.flatnonzero(moved <= -AIR_K)
    for code, at in (("ambient-temperature", hot), ("ambient-temperature", cold)):
        if at.size and not is_charging:
            worst = int(at[np.abs(moved[at]).argmax()])
            at_s = float(times[rows[at[0]]]) - 0.5 * AIR_WINDOW_S
            of_boards, of_cells = Quantity(float(moved[worst]), "K", 1), Quantity(float(warmed[worst]), "K", 1)
            evidence = (Message("seen-boards-moved", boards=of_boards, cells=of_cells),)
            yield Hypothesis(code, at_s, 10.0 + 2.0 * float(np.abs(moved[worst])), evidence)
            return
    yield from _cooling(recording, model, float(min(own[:10].mean(), cells[:10].mean())))


def _cooling(recording: SessionStretch, model: CellModel, air_degc: float) -> Iterator[Hypothesis]:
    """C dT/dt = loss - b duty (T - air): b is what the fans take away; loss = i (OCV - v) of the median cell."""
    ocv = model.ocv.voltage(np.clip(recording.soc, -0.05, 1.05))
    loss_w = recording.steady_a * (ocv - recording.median_v)
    degc = recording.mean_degc
    is_known = np.isfinite(loss_w) & np.isfinite(degc) & np.isfinite(recording.fan_duty)
    known_at = np.flatnonzero(is_known & (recording.soc > COOLING_SOC))
    if known_at.size < 200:
        return
    dt_s = np.clip(np.diff(recording.time_s[known_at], prepend=recording.time_s[known_at[0]]), 0.0, 5.0)
    warm = recording.fan_duty[known_at] * (degc[known_at] - air_degc)
    far = warm >= COOLING_FROM_K
    if (dt_s * far).sum() < COOLING_LEAST_S:
        return
    first, last = int(np.flatnonzero(far)[0]), int(np.flatnonzero(far)[-1])
    part = slice(first, last + 1)
    start = float(recording.time_s[known_at[first]])
    given = float((dt_s[part] * loss_w[known_at][part]).sum())
    taken = float((dt_s[part] * warm[part]).sum())
    edge = min(100, (last - first) // 3)
    moved = float(degc[known_at][last - edge : last + 1].mean() - degc[known_at][first : first + edge + 1].mean())
    lasted = float(dt_s[part].sum())
    moved *= lasted / max(lasted - float(dt_s[first : first + edge].sum()), 1.0)
    watts = (given - CELL_J_PER_K * moved) / max(taken, 1.0)
    if degc[known_at].max() < recording.limits.get("t_cell_max", 60.0) - HOT_K:
        return
    if watts < COOLING_W_PER_K:
        duty = Quantity(100 * float(np.nanmax(recording.fan_duty)), "%", 0)
        evidence = (Message("seen-cooling", cooling=Quantity(max(watts, 0.0), "W/K", 2), duty=duty),)
        yield Hypothesis("cooling-failed", start, 20.0 * (1.0 - watts / COOLING_W_PER_K) + 6.0, evidence)
