"""Hypotheses about one cell: its joint, its resistance, its capacity, a leak, heat, and what measures it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from app.analysis.root_cause.cell_fits import CORRELATED, MOST_INDEPENDENT, CellFit, CellVoltages, Law, fit_cell
from app.analysis.root_cause.recording import Recording, Suspicion, pack_of, row_median
from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import CellModel
from app.words import Cell, Message, Quantity

LOOKED_AT: Final = 4  # of the oddest cells in each respect, beside those that were reported
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
LEAST_GAIN: Final = 2.0  # of the voltage's likelihood
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
CODES: Final[dict[Law, str]] = {
    "joint": "joint-resistance-high",
    "resistance": "cell-resistance-high",
    "capacity": "capacity-low",
    "leak": "self-discharge-high",
    "stuck": "cell-voltage-stuck",
    "warm": "external-heating",
    "lower": "cell-imbalance",
}


@dataclass(frozen=True)
class Warmth:
    """How much warmer one cell is than the median cell, once a second; None of it was there at the beginning."""

    time_s: FloatArray
    warmer_k: FloatArray

    @property
    def now_k(self) -> float:
        """At the end."""
        return float(self.warmer_k[-5:].mean())

    def response(self, onset_s: float) -> FloatArray:
        """What one watt since an onset makes [K/W]: one lump that loses heat to its neighbours and the air."""
        ago_s = np.maximum(self.time_s - onset_s, 0.0)
        return np.asarray(-np.expm1(-LOSS_W_PER_K / CELL_J_PER_K * ago_s) / LOSS_W_PER_K)

    def gained(self, watts: float, onset_s: float) -> float:
        """Log of the likelihood of a constant heat since an onset, against none."""
        share = min(CORRELATED, MOST_INDEPENDENT / len(self.time_s))
        expected = watts * self.response(onset_s)
        variance = HEAT_SIGMA_K**2 + (HEAT_SHARE * expected) ** 2
        with_it = (self.warmer_k - expected) ** 2 / variance + np.log(variance / HEAT_SIGMA_K**2)
        return float(0.5 * share * ((self.warmer_k / HEAT_SIGMA_K) ** 2 - with_it).sum())

    def best(self) -> tuple[float, float, float]:
        """Log of the likelihood, heat [W] and onset of what fits best."""
        found = []
        for onset_s in np.linspace(self.time_s[0], self.time_s[-1], 40)[:-1].tolist():
            response = self.response(onset_s)
            watts = float((response * self.warmer_k).sum() / max((response**2).sum(), 1e-9))
            found.append((self.gained(watts, onset_s), watts, onset_s))
        return max(found)


def cell_suspicions(recording: Recording, model: CellModel, at_s: float) -> Iterator[Suspicion]:
    """Yield what may be wrong with single cells; `at_s` is the instant that is asked about, unix time."""
    if recording.time_s.size < 20:
        return
    lost = list(_broken_wires(recording))
    yield from lost
    yield from _unplugged(recording, {each.cell for each in lost})
    stuck = [] if lost else list(_stuck_temperatures(recording))
    yield from stuck
    if lost or not recording.tells_at_once:
        return
    jumped = {each.cell for each in stuck}
    voltages = CellVoltages(recording, model, at_s)
    found: list[Suspicion] = []
    for cell in _suspects(recording):
        warmth = None if cell in jumped else _warmth(recording, cell)
        found += _of_cell(recording, model, voltages, cell, warmth)
    yield from _warmest_of_pack(found, recording.segments)


def _suspects(recording: Recording) -> list[int]:
    """The cells that were reported, and those furthest from the others in voltage, noise or temperature."""
    reported = [event.cell for event in recording.events if event.cell is not None]
    with np.errstate(invalid="ignore"):
        apart = recording.apart_v
        swing = np.nanmax(apart, axis=0, initial=-9.0) - np.nanmin(apart, axis=0, initial=9.0)
        warm = _ends(recording.temperature_degc - recording.middle_degc[:, None])
        odd = [np.argsort(-np.nan_to_num(np.abs(each)))[:LOOKED_AT] for each in (swing, _ends(apart), warm)]
    oddest = [int(cell) for cells in odd for cell in cells]
    return list(dict.fromkeys([*reported, *oddest]))


def _ends(values: FloatArray) -> FloatArray:
    """(n_cells,) the last tenth against the first."""
    part = max(len(values) // 10, 5)
    return row_median(values[-part:].T) - row_median(values[:part].T)


def _of_cell(
    recording: Recording, model: CellModel, voltages: CellVoltages, cell: int, warmth: Warmth | None
) -> Iterator[Suspicion]:
    noise = _noise(recording, cell)
    if noise is not None:
        yield noise
        return
    series = voltages.of(cell)
    if series is None:
        return
    gained, watts, since_s = (0.0, 0.0, recording.start_s) if warmth is None else warmth.best()
    warm: tuple[Message, ...] = ()
    if warmth is not None and warmth.now_k >= WARMER_K:
        warmer, heat = Quantity(warmth.now_k, "K", 0), Quantity(watts, "W", 0)
        warm = (Message("seen-warmer", cell=Cell(cell), warmer=warmer, heat=heat),)

    def leak_heat(size_a: float, onset_s: float) -> float:
        return 0.0 if warmth is None else warmth.gained(LEAK_V * size_a, onset_s)

    fits = {fit.law: fit for fit in fit_cell(series, model, leak_heat)}
    lower = fits["lower"].log_likelihood
    for law, fit in fits.items():
        if law == "warm":
            continue
        weight = fit.log_likelihood
        if warmth is not None:
            weight += warmth.gained(_heat_of(law, fit, recording), fit.onset_s)
        if law in ("capacity", "leak") and fit.log_likelihood < lower + LEAST_GAIN:
            continue  # that it began with less charge explains as much
        if law == "leak" and recording.end_s - fit.onset_s < LEAK_LASTS_S:
            continue
        if fit.size >= LEAST[law] and fit.log_likelihood > LEAST_GAIN:
            evidence = (_seen(law, fit, cell), *warm)
            yield Suspicion(CODES[law], fit.onset_s, weight, evidence, cell)
    if warm and watts > HEATED_W:
        yield Suspicion("external-heating", since_s, fits["warm"].log_likelihood + gained - FREE, warm, cell)


def _heat_of(law: Law, fit: CellFit, recording: Recording) -> float:
    """What the fault gives to the cell on average since its onset [W]."""
    since = recording.time_s >= fit.onset_s
    if law in ("joint", "resistance"):
        return fit.size * float(np.nanmean(recording.steady_a[since] ** 2)) if since.any() else 0.0
    return LEAK_V * fit.size if law == "leak" else 0.0


def _seen(law: Law, fit: CellFit, index: int) -> Message:
    cell = Cell(index)
    match law:
        case "joint":
            return Message("seen-joint", cell=cell, size=Quantity(1000 * fit.size, "mohm", 2))
        case "resistance":
            return Message("seen-resistance", cell=cell, size=Quantity(1000 * fit.size, "mohm", 2))
        case "capacity":
            return Message("seen-capacity", cell=cell, size=Quantity(100 / (1 + fit.size), "%", 0))
        case "lower":
            return Message("seen-lower", cell=cell, size=Quantity(100 * fit.size, "%", 1))
        case "leak":
            return Message("seen-leak", cell=cell, size=Quantity(fit.size, "A", 1))
    return Message("seen-stuck", cell=cell, size=Quantity(fit.size, "V", 3))


def _warmest_of_pack(found: list[Suspicion], segments: Sequence[int]) -> Iterator[Suspicion]:
    """A hot cell warms its neighbours: of each pack only the one that speaks the loudest is taken for heated."""
    loudest: dict[int | None, float] = {}
    for each in found:
        if each.cell is not None:
            pack = pack_of(each.cell, segments)
            loudest[pack] = max(loudest.get(pack, -np.inf), each.weight)
    for each in found:
        if (
            each.code != "external-heating"
            or each.cell is None
            or each.weight >= 0.3 * loudest[pack_of(each.cell, segments)]
        ):
            yield each


def _warmth(recording: Recording, cell: int) -> Warmth | None:
    seconds = np.flatnonzero(np.diff(np.floor(recording.time_s), prepend=-1.0) > 0)
    warmer = recording.temperature_degc[seconds, cell] - recording.middle_degc[seconds]
    known = np.isfinite(warmer)
    if known.sum() < 20:
        return None
    warmer = warmer[known]
    return Warmth(recording.time_s[seconds][known], warmer - np.median(warmer[: max(len(warmer) // 10, 5)]))


def _noise(recording: Recording, cell: int) -> Suspicion | None:
    """Deviations that neither stay nor follow the current."""
    steps = np.diff(recording.apart_v, axis=0)
    amps = np.abs(np.diff(recording.steady_a))
    known = np.isfinite(steps[:, cell])
    # a grown resistance moves with the current; noise is there while the current stands still
    restless = np.convolve(np.nan_to_num(amps, nan=99.0) > STILL_A, np.ones(2 * STILL_SAMPLES + 1), "same") > 0.5
    quiet = np.flatnonzero(known & ~restless)
    if quiet.size < 20:
        return None
    usual = 1.4826 * float(np.nanmedian(np.abs(steps[quiet])))
    loud = np.abs(steps[quiet, cell]) > max(NOISE_V, NOISE_TIMES * usual)
    tail = loud[-max(20, len(loud) // 10) :]
    if loud.sum() < 8 or max(tail.mean(), loud.mean()) < 0.15:
        return None
    first = int(quiet[np.flatnonzero(loud)[0]])
    size = Quantity(1000 * float(np.std(steps[quiet][loud, cell])) / np.sqrt(2), "mV", 0)
    evidence = (Message("seen-noise", cell=Cell(cell), size=size),)
    return Suspicion("cell-voltage-noisy", float(recording.time_s[first]), 5.0 * float(loud.sum()), evidence, cell)


def _broken_wires(recording: Recording) -> Iterator[Suspicion]:
    """One or two neighbours without a voltage while the rest of the pack has one."""
    missing = np.isnan(recording.voltage_v)
    starts = recording.pack_starts
    n_missing = np.add.reduceat(missing, starts, axis=1, dtype=np.int64)
    partly = (n_missing > 0) & (n_missing <= 2) & (n_missing < np.array(recording.segments))
    for pack in np.flatnonzero(partly.sum(axis=0) >= 3):
        rows = np.flatnonzero(partly[:, pack])
        of_pack = slice(starts[pack], starts[pack] + recording.segments[pack])
        cells = np.flatnonzero(missing[rows[len(rows) // 2], of_pack]) + starts[pack]
        evidence = (Message("seen-no-voltage", n=len(cells), cells=tuple(Cell(int(each)) for each in cells)),)
        yield Suspicion("sense-wire-open", float(recording.time_s[rows[0]]), 60.0, evidence, int(cells[0]))


def _unplugged(recording: Recording, broken: set[int | None]) -> Iterator[Suspicion]:
    """A temperature is missing where the voltage is there."""
    missing = np.isnan(recording.temperature_degc) & np.isfinite(recording.voltage_v)
    whole = np.logical_and.reduceat(missing, recording.pack_starts, axis=1)
    missing &= ~np.repeat(whole, recording.segments, axis=1)
    if broken:
        return
    for cell in np.flatnonzero(missing[-1] | (missing.sum(axis=0) >= 10)):
        rows = np.flatnonzero(missing[:, cell])
        evidence = (Message("seen-no-temperature", cell=Cell(int(cell))),)
        yield Suspicion("temperature-sensor-open", float(recording.time_s[rows[0]]), 60.0, evidence, int(cell))


def _stuck_temperatures(recording: Recording) -> Iterator[Suspicion]:
    """A temperature jumps as no mass of a cell can, and stands still after that."""
    table = recording.temperature_degc
    step = max(int(JUMP_S / max(float(np.median(np.diff(recording.time_s))), 1e-2)), 1)
    if len(table) <= 2 * step:
        return
    with np.errstate(invalid="ignore"):
        jumps = np.abs(table[step:] - table[:-step]) >= JUMP_K
    for cell in np.flatnonzero(jumps.any(axis=0)):
        row = int(np.flatnonzero(jumps[:, cell])[0])
        after = table[row + 2 * step :, cell]
        after = after[np.isfinite(after)]
        if after.size < 5:
            after = table[row + step :, cell]
            after = after[np.isfinite(after)]
        if after.size >= 5 and np.ptp(after) <= 1.0:
            level = Quantity(float(np.median(after)), "degC", 0)
            before = Quantity(float(table[row, cell]), "degC", 0)
            evidence = (Message("seen-temperature-jump", cell=Cell(int(cell)), before=before, after=level),)
            yield Suspicion("temperature-sensor-fault", float(recording.time_s[row]), 50.0, evidence, int(cell))
