"""The judge of the cells over a stretch that is over: what each cell had at an instant, also what began just before.

The watch (`cell_watch.py`) judges from sample to sample and waits until it is sure; this looks back from an instant,
a trip for one, and weighs each condition by its likelihood against nothing being wrong.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray, row_median
from app.estimation.cell_model.circuit import CellModel
from app.estimation.health.cell_finding import SURE, CellFinding, FindingCode
from app.estimation.health.cell_fits import CORRELATED, MOST_INDEPENDENT, CellFit, Law, fit_cell
from app.estimation.health.cell_voltages import CellVoltages
from app.estimation.health.stretch import Stretch

LOOKED_AT: Final = 4  # number of the oddest cells in each respect, with those that were reported
JUMP_K: Final = 6.0  # between two readings: no cell with its mass does that
JUMP_S: Final = 3.0
CELL_J_PER_K: Final = 450.0  # ten 18650, by weight
LOSS_W_PER_K: Final = 1.2  # to neighbours and air
HEAT_SIGMA_K: Final = 0.8  # whole degrees, and places in the air
HEAT_SHARE: Final = 0.3  # by which a heat that follows from a size is uncertain
WARMER_K: Final = 3.0
HEATED_W: Final = 8.0
FREE: Final = 2.0  # what a heat that may have any size has to gain
LEAK_LASTS_S: Final = 15.0
LEAST_GAIN: Final = 2.0  # gain of the voltage's likelihood
LEAK_V: Final = 3.6
NOISE_V: Final = 5e-3
NOISE_TIMES: Final = 6.0  # the usual cell's
STILL_A: Final = 1.5  # from sample to sample
STILL_SAMPLES: Final = 4
LEAST: Final[dict[Law, float]] = {
    "joint": 4e-4,
    "resistance": 4e-4,
    "capacity": 0.08,
    "leak": 3.0,
    "stuck": 0.0,
    "warm": 0.0,
    "lower": 0.03,
}
CODES: Final[dict[Law, tuple[FindingCode, str]]] = {  # with the unit of the size
    "joint": ("joint-resistance-high", "ohm"),
    "resistance": ("cell-resistance-high", "ohm"),
    "capacity": ("capacity-low", "1"),
    "leak": ("self-discharge-high", "A"),
    "stuck": ("cell-voltage-stuck", "V"),
    "lower": ("cell-imbalance", "1"),
}
CERTAIN: Final = 60.0  # log odds of what is missing
NAN: Final = float("nan")


@dataclass(frozen=True)
class Warmth:
    """Excess temperature of one cell over the median cell, once a second, 0 at the beginning."""

    time_s: FloatArray
    warmer_k: FloatArray

    @property
    def now_k(self) -> float:
        """Return the excess temperature at the end [K]."""
        return float(self.warmer_k[-5:].mean())

    def response(self, onset_s: float) -> FloatArray:
        """Return the response to one watt since an onset [K/W]: one lump loses heat to its neighbours and the air."""
        ago_s = np.maximum(self.time_s - onset_s, 0.0)
        return np.asarray(-np.expm1(-LOSS_W_PER_K / CELL_J_PER_K * ago_s) / LOSS_W_PER_K)

    def gained(self, watts: float | FloatArray, onset_s: float) -> FloatArray:
        """Log of the likelihood of constant heats since an onset, against none."""
        share = min(CORRELATED, MOST_INDEPENDENT / len(self.time_s))
        expected = np.multiply.outer(watts, self.response(onset_s))
        variance = HEAT_SIGMA_K**2 + (HEAT_SHARE * expected) ** 2
        with_it = (self.warmer_k - expected) ** 2 / variance + np.log(variance / HEAT_SIGMA_K**2)
        return np.asarray(0.5 * share * ((self.warmer_k / HEAT_SIGMA_K) ** 2 - with_it).sum(axis=-1))

    def best(self) -> tuple[float, float, float]:
        """Log of the likelihood, heat [W] and onset of what fits best."""
        fits = []
        for onset_s in np.linspace(self.time_s[0], self.time_s[-1], 40)[:-1].tolist():
            response = self.response(onset_s)
            watts = float((response * self.warmer_k).sum() / max((response**2).sum(), 1e-9))
            fits.append((float(self.gained(watts, onset_s)), watts, onset_s))
        return max(fits)


def judge_stretch(stretch: Stretch, model: CellModel, at_s: float, reported: Sequence[int] = ()) -> list[CellFinding]:
    """Return what single cells may have, each with its log odds.

    Args:
        stretch: the samples.
        model: of every cell.
        at_s: the instant that is asked about, unix time [s].
        reported: cells that are looked at in any case.
    """
    if stretch.time_s.size < 20:
        return []
    lost = list(_open_wires(stretch))
    no_temperature = [] if lost else list(_open_sensors(stretch))
    stuck = [] if lost else list(_false_temperatures(stretch))
    if lost or not stretch.is_together:
        return [*lost, *no_temperature, *stuck]
    jumped = {finding.cell for finding in stuck}
    voltages = CellVoltages(stretch, model, at_s)
    findings: list[CellFinding] = []
    for cell in _suspects(stretch, reported):
        warmth = None if cell in jumped else _warmth(stretch, cell)
        findings += _of_cell(stretch, model, voltages, cell, warmth)
    return [*no_temperature, *stuck, *_warmest_of_pack(stretch, findings)]


def _suspects(stretch: Stretch, reported: Sequence[int]) -> list[int]:
    """The cells that were reported, and those furthest from the others in voltage, noise or temperature."""
    with np.errstate(invalid="ignore"):
        apart = stretch.deviation_v
        swing = np.nanmax(apart, axis=0, initial=-9.0) - np.nanmin(apart, axis=0, initial=9.0)
        warm = _ends(stretch.temperature_degc - stretch.median_degc[:, None])
        odd = [np.argsort(-np.nan_to_num(np.abs(swings)))[:LOOKED_AT] for swings in (swing, _ends(apart), warm)]
    oddest = [int(cell) for cells in odd for cell in cells]
    return list(dict.fromkeys([*reported, *oddest]))


def _ends(values: FloatArray) -> FloatArray:
    """(n_cells,) the last tenth against the first."""
    part = max(len(values) // 10, 5)
    return row_median(values[-part:].T) - row_median(values[:part].T)


def _of_cell(
    stretch: Stretch, model: CellModel, voltages: CellVoltages, cell: int, warmth: Warmth | None
) -> Iterator[CellFinding]:
    noise = _noise(stretch, cell)
    if noise is not None:
        yield noise
        return
    series = voltages.of(cell)
    if series is None:
        return
    gained, watts, since_s = (0.0, 0.0, stretch.start_s) if warmth is None else warmth.best()
    is_warm = warmth is not None and warmth.now_k >= WARMER_K
    warmer_k = warmth.now_k if warmth is not None else NAN

    def leak_heat(sizes_a: FloatArray, onset_s: float) -> FloatArray:
        return np.zeros(sizes_a.size) if warmth is None else warmth.gained(LEAK_V * sizes_a, onset_s)

    fits = {fit.law: fit for fit in fit_cell(series, model, leak_heat)}
    lower = fits["lower"].log_likelihood
    for law, fit in fits.items():
        if law == "warm":
            continue
        log_odds = fit.log_likelihood
        if warmth is not None:
            log_odds += float(warmth.gained(_heat_of(law, fit, stretch), fit.onset_s))
        if law in ("capacity", "leak") and fit.log_likelihood < lower + LEAST_GAIN:
            continue  # that it began with less charge explains as much
        if law == "leak" and stretch.end_s - fit.onset_s < LEAK_LASTS_S:
            continue
        if fit.size >= LEAST[law] and fit.log_likelihood > LEAST_GAIN:
            size, sigma, (code, unit) = fit.size, fit.sigma, CODES[law]
            if law == "capacity":
                size, sigma = size / (1.0 + size), sigma / (1.0 + size) ** 2
            finding = _found(stretch, code, cell, fit.onset_s, log_odds, size, unit, sigma=sigma)
            yield replace(finding, warmer_k=warmer_k, heat_w=watts) if is_warm else finding
    if is_warm and watts > HEATED_W:
        log_odds = fits["warm"].log_likelihood + gained - FREE
        finding = _found(stretch, "external-heating", cell, since_s, log_odds, watts, "W", sigma=HEAT_SHARE * watts)
        yield replace(finding, warmer_k=warmer_k, heat_w=watts)


def _found(
    stretch: Stretch,
    code: FindingCode,
    cell: int,
    since_s: float,
    log_odds: float,
    size: float = NAN,
    unit: str = "",
    value: float = NAN,
    usual: float = NAN,
    neighbours: tuple[int, ...] = (),
    sigma: float = NAN,
) -> CellFinding:
    return CellFinding(
        code,
        cell,
        size,
        sigma,
        unit,
        since_s,
        stretch.end_s,
        stretch.end_s - since_s,
        NAN,
        value,
        usual,
        neighbours,
        min(1.0 / (1.0 + float(np.exp(-min(log_odds, 50.0)))), SURE),
        log_odds,
    )


def _heat_of(law: Law, fit: CellFit, stretch: Stretch) -> float:
    """What the fault gives to the cell on average since its onset [W]."""
    since = stretch.time_s >= fit.onset_s
    if law in ("joint", "resistance"):
        return fit.size * float(np.nanmean(stretch.steady_a[since] ** 2)) if since.any() else 0.0
    return LEAK_V * fit.size if law == "leak" else 0.0


def _warmest_of_pack(stretch: Stretch, findings: list[CellFinding]) -> Iterator[CellFinding]:
    """A hot cell warms its neighbours: of each pack only the likeliest is taken for heated from outside."""
    likeliest: dict[int, float] = {}
    for finding in findings:
        pack = stretch.pack_of(finding.cell)
        likeliest[pack] = max(likeliest.get(pack, -np.inf), finding.log_odds)
    for finding in findings:
        if finding.code != "external-heating" or finding.log_odds >= 0.3 * likeliest[stretch.pack_of(finding.cell)]:
            yield finding


def _warmth(stretch: Stretch, cell: int) -> Warmth | None:
    seconds = np.flatnonzero(np.diff(np.floor(stretch.time_s), prepend=-1.0) > 0)
    warmer = stretch.temperature_degc[seconds, cell] - stretch.median_degc[seconds]
    is_finite = np.isfinite(warmer)
    if is_finite.sum() < 20:
        return None
    warmer = warmer[is_finite]
    return Warmth(stretch.time_s[seconds][is_finite], warmer - np.median(warmer[: max(len(warmer) // 10, 5)]))


def _noise(stretch: Stretch, cell: int) -> CellFinding | None:
    """Deviations that neither stay nor follow the current."""
    steps = np.diff(stretch.deviation_v, axis=0)
    amps = np.abs(np.diff(stretch.steady_a))
    is_finite = np.isfinite(steps[:, cell])
    # a grown resistance moves with the current; noise is there while the current stands still
    restless = np.convolve(np.nan_to_num(amps, nan=99.0) > STILL_A, np.ones(2 * STILL_SAMPLES + 1), "same") > 0.5
    quiet = np.flatnonzero(is_finite & ~restless)
    if quiet.size < 20:
        return None
    usual = 1.4826 * float(np.nanmedian(np.abs(steps[quiet])))
    loud = np.abs(steps[quiet, cell]) > max(NOISE_V, NOISE_TIMES * usual)
    tail = loud[-max(20, len(loud) // 10) :]
    if loud.sum() < 8 or max(tail.mean(), loud.mean()) < 0.15:
        return None
    since_s = float(stretch.time_s[int(quiet[np.flatnonzero(loud)[0]])])
    size = float(np.std(steps[quiet][loud, cell])) / float(np.sqrt(2))
    sigma = size / float(np.sqrt(2 * loud.sum()))
    return _found(stretch, "cell-voltage-noisy", cell, since_s, 5.0 * float(loud.sum()), size, "V", sigma=sigma)


def _open_wires(stretch: Stretch) -> Iterator[CellFinding]:
    """One or two neighbours without a voltage while the rest of the pack has one."""
    missing = np.isnan(stretch.voltage_v)
    starts = stretch.pack_starts
    n_missing = np.add.reduceat(missing, starts, axis=1, dtype=np.int64)
    partly = (n_missing > 0) & (n_missing <= 2) & (n_missing < np.array(stretch.segments))
    for pack in np.flatnonzero(partly.sum(axis=0) >= 3):
        rows = np.flatnonzero(partly[:, pack])
        of_pack = slice(starts[pack], starts[pack] + stretch.segments[pack])
        cells = tuple(int(cell) + starts[pack] for cell in np.flatnonzero(missing[rows[len(rows) // 2], of_pack]))
        since_s = float(stretch.time_s[rows[0]])
        yield _found(stretch, "sense-wire-open", cells[0], since_s, CERTAIN, neighbours=cells)


def _open_sensors(stretch: Stretch) -> Iterator[CellFinding]:
    """A temperature is missing where the voltage is there."""
    missing = np.isnan(stretch.temperature_degc) & np.isfinite(stretch.voltage_v)
    whole = np.logical_and.reduceat(missing, stretch.pack_starts, axis=1)
    missing &= ~np.repeat(whole, stretch.segments, axis=1)
    for cell in np.flatnonzero(missing[-1] | (missing.sum(axis=0) >= 10)).tolist():
        since_s = float(stretch.time_s[np.flatnonzero(missing[:, cell])[0]])
        yield _found(stretch, "temperature-sensor-open", cell, since_s, CERTAIN, unit="K")


def _false_temperatures(stretch: Stretch) -> Iterator[CellFinding]:
    """A temperature jumps as no mass of a cell can, and stands still after that."""
    table = stretch.temperature_degc
    step = max(int(JUMP_S / max(float(np.median(np.diff(stretch.time_s))), 1e-2)), 1)
    if len(table) <= 2 * step:
        return
    with np.errstate(invalid="ignore"):
        jumps = np.abs(table[step:] - table[:-step]) >= JUMP_K
    for cell in np.flatnonzero(jumps.any(axis=0)).tolist():
        row = int(np.flatnonzero(jumps[:, cell])[0])
        after = table[row + 2 * step :, cell]
        after = after[np.isfinite(after)]
        if after.size < 5:
            after = table[row + step :, cell]
            after = after[np.isfinite(after)]
        if after.size >= 5 and np.ptp(after) <= 1.0:
            before, now = float(table[row, cell]), float(np.median(after))
            since_s, jump = float(stretch.time_s[row]), abs(now - before)
            yield _found(stretch, "temperature-sensor-fault", cell, since_s, 50.0, jump, "K", now, before)
