"""A whole recording in one pass, a minute at a time: energies, histograms, and extremes and resistance of cells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.analysis.totals import MAX_STEP_S, SECONDS_PER_HOUR
from app.estimation.arrays import BoolArray, FloatArray, row_mean
from app.estimation.health.resistance_tracker import ResistanceTracker

CURRENT_EDGES_A: Final = np.arange(-150.0, 301.0, 10.0)
TEMPERATURE_EDGES_DEGC: Final = np.arange(-20.0, 91.0, 1.0)
SOC_EDGES: Final = np.linspace(0.0, 1.0, 51)
DRIVING_A: Final = 2.0
REST_A: Final = 1.0
FIRST_REST_S: Final = 10.0  # at the start the car has stood, nobody knows how long
LAST_REST_S: Final = 120.0  # then the RC pairs have settled to a few millivolts
REST_MEAN_S: Final = 10.0
TRACKER_STEP_S: Final = 0.09  # the regression gains nothing from quicker samples
SESSION_S: Final = 1e9  # its memory: the whole session
SAG_A: Final = 50.0  # a cell's sag is judged above this current


@dataclass(frozen=True)
class SurveyPiece:
    """About a minute: (n,) and (n, n_cells) arrays on one time axis, NaN where not measured."""

    time_s: FloatArray
    current_a: FloatArray
    voltage_v: FloatArray
    temperature_degc: FloatArray
    soc: FloatArray
    balancing: FloatArray  # 1 where the cell is bled
    is_new: BoolArray | None = None  # where a voltage is new in this row, not held; None: all are new

    @property
    def fresh_voltage_v(self) -> FloatArray:
        """(n, n_cells) voltages that belong to their row's current; NaN where one is held from before."""
        return self.voltage_v if self.is_new is None else np.where(self.is_new, self.voltage_v, np.nan)

    def rows(self, rows: slice) -> SurveyPiece:
        """Return a part of it; its arrays are views."""
        return SurveyPiece(
            self.time_s[rows],
            self.current_a[rows],
            self.voltage_v[rows],
            self.temperature_degc[rows],
            self.soc[rows],
            self.balancing[rows],
            None if self.is_new is None else self.is_new[rows],
        )

    @staticmethod
    def joined(parts: Sequence[SurveyPiece]) -> SurveyPiece:
        """Return parts behind each other as one."""
        if len(parts) == 1:
            return parts[0]
        is_new = [np.isfinite(part.voltage_v) if part.is_new is None else part.is_new for part in parts]
        return SurveyPiece(
            np.concatenate([part.time_s for part in parts]),
            np.concatenate([part.current_a for part in parts]),
            np.concatenate([part.voltage_v for part in parts]),
            np.concatenate([part.temperature_degc for part in parts]),
            np.concatenate([part.soc for part in parts]),
            np.concatenate([part.balancing for part in parts]),
            None if all(part.is_new is None for part in parts) else np.concatenate(is_new),
        )


@dataclass(frozen=True)
class Rest:
    """Every cell after a while without current."""

    time_s: float
    voltage_v: FloatArray


@dataclass(frozen=True)
class Histogram:
    """Seconds in each bin, of temperature and SOC times cells; one edge more than bins, none empty at the ends."""

    unit: str
    edges: list[float]
    seconds: list[float]
    below_s: float
    above_s: float


@dataclass
class Survey:
    """Figures of a recording; arrays are (n_cells,)."""

    n_cells: int
    start_s: float = np.nan
    end_s: float = np.nan
    samples: int = 0
    driving_s: float = 0.0
    gap_s: float = 0.0  # no sample for longer than MAX_STEP_S
    energy_out_wh: float = 0.0  # energy of the measured cells [Wh]
    energy_in_wh: float = 0.0
    energy_gap_s: float = 0.0  # under current with a cell missing: both energies are at least what they say
    charge_out_ah: float = 0.0
    charge_in_ah: float = 0.0
    current_max_a: float = -np.inf
    current_min_a: float = np.inf
    power_max_w: float = -np.inf
    first_rest: Rest | None = None
    last_rest: Rest | None = None
    histograms: dict[str, Histogram] = field(default_factory=dict)
    voltage_min_v: FloatArray = field(default_factory=lambda: np.empty(0))
    voltage_min_at_s: FloatArray = field(default_factory=lambda: np.empty(0))
    voltage_max_v: FloatArray = field(default_factory=lambda: np.empty(0))
    temperature_first_degc: FloatArray = field(default_factory=lambda: np.empty(0))
    temperature_max_degc: FloatArray = field(default_factory=lambda: np.empty(0))
    temperature_max_at_s: FloatArray = field(default_factory=lambda: np.empty(0))
    soc_first: FloatArray = field(default_factory=lambda: np.empty(0))
    soc_last: FloatArray = field(default_factory=lambda: np.empty(0))
    lowest_s: FloatArray = field(default_factory=lambda: np.empty(0))  # while driving, as the lowest cell
    sag_v: FloatArray = field(default_factory=lambda: np.empty(0))  # mean, below the mean of all, above SAG_A
    balancing_s: FloatArray = field(default_factory=lambda: np.empty(0))
    missing: FloatArray = field(default_factory=lambda: np.empty(0))  # samples without a voltage
    resistance_ohm: FloatArray = field(default_factory=lambda: np.empty(0))  # with its joint
    resistance_sigma_ohm: FloatArray = field(default_factory=lambda: np.empty(0))

    @property
    def has_energies(self) -> bool:
        """Both energies are of all cells, but for what flowed in a time too short to count."""
        return self.energy_gap_s <= MAX_STEP_S


class Surveyor:
    """Takes a recording piece by piece, in order; `result` at the end."""

    def __init__(self, n_cells: int, *, in_turns: bool = False) -> None:
        """`in_turns`: cells are sent one after the other, so none is missing before it was sent once."""
        self._n = n_cells
        self._waited = np.zeros(n_cells) if in_turns else None  # rows until the first value of a cell
        nan = np.full(n_cells, np.nan)
        self._survey = Survey(
            n_cells,
            voltage_min_v=nan.copy(),
            voltage_min_at_s=nan.copy(),
            voltage_max_v=nan.copy(),
            temperature_first_degc=nan.copy(),
            temperature_max_degc=nan.copy(),
            temperature_max_at_s=nan.copy(),
            soc_first=nan.copy(),
            soc_last=nan.copy(),
            lowest_s=np.zeros(n_cells),
            balancing_s=np.zeros(n_cells),
            missing=np.zeros(n_cells),
        )
        self._tracker = ResistanceTracker(n_cells, memory_s=SESSION_S)
        self._tracked_s: float | None = None
        self._last_s: float | None = None
        self._sag = np.zeros((2, n_cells))  # sum and count
        self._rest_from_s: float | None = None
        self._rest_tail: list[tuple[FloatArray, FloatArray]] = []
        self._counts = {
            "current": np.zeros(len(CURRENT_EDGES_A) + 1),
            "temperature": np.zeros(len(TEMPERATURE_EDGES_DEGC) + 1),
            "soc": np.zeros(len(SOC_EDGES) + 1),
        }

    def add(self, piece: SurveyPiece) -> None:
        """Take the next minute."""
        if not len(piece.time_s):
            return
        survey = self._survey
        before_s = piece.time_s[0] if self._last_s is None else self._last_s
        raw_s = np.diff(piece.time_s, prepend=before_s)  # each sample stands for the time up to it
        dt_s = np.where((raw_s > 0.0) & (raw_s <= MAX_STEP_S), raw_s, 0.0)
        survey.gap_s += float(raw_s[raw_s > MAX_STEP_S].sum())
        survey.start_s = piece.time_s[0] if survey.samples == 0 else survey.start_s
        survey.end_s = self._last_s = float(piece.time_s[-1])
        survey.samples += len(piece.time_s)
        self._energies(piece, dt_s)
        self._extremes(piece, dt_s)
        self._count("current", CURRENT_EDGES_A, piece.current_a, dt_s)
        self._count("temperature", TEMPERATURE_EDGES_DEGC, piece.temperature_degc, dt_s[:, None])
        self._count("soc", SOC_EDGES, piece.soc, dt_s[:, None])
        self._track(piece)
        self._rests(piece)

    def result(self) -> Survey:
        """Return what was found."""
        survey = self._survey
        if self._waited is not None:  # a cell without any value is missing all the time
            survey.missing -= np.where(np.isnan(survey.voltage_max_v), 0.0, self._waited)
            self._waited[:] = 0.0
        survey.histograms = {
            "current": self._histogram("current", "A", CURRENT_EDGES_A),
            "temperature": self._histogram("temperature", "degC", TEMPERATURE_EDGES_DEGC),
            "soc": self._histogram("soc", "1", SOC_EDGES),
        }
        with np.errstate(invalid="ignore", divide="ignore"):
            survey.sag_v = np.where(self._sag[1] > 0, self._sag[0] / self._sag[1], np.nan)
        survey.resistance_ohm = self._tracker.resistance_ohm()[0]
        survey.resistance_sigma_ohm = self._tracker.sigma_ohm()[0]
        self._end_rest()
        return survey

    def _energies(self, piece: SurveyPiece, dt_s: FloatArray) -> None:
        survey = self._survey
        current = np.nan_to_num(piece.current_a)
        missing = np.isnan(piece.voltage_v).any(axis=1)
        watts = current * np.nansum(piece.voltage_v, axis=1)
        survey.energy_gap_s += float(dt_s[missing & (np.abs(current) > REST_A)].sum())
        survey.energy_out_wh += float((np.maximum(watts, 0.0) * dt_s).sum() / SECONDS_PER_HOUR)
        survey.energy_in_wh += float((np.maximum(-watts, 0.0) * dt_s).sum() / SECONDS_PER_HOUR)
        survey.charge_out_ah += float((np.maximum(current, 0.0) * dt_s).sum() / SECONDS_PER_HOUR)
        survey.charge_in_ah += float((np.maximum(-current, 0.0) * dt_s).sum() / SECONDS_PER_HOUR)
        driving = np.abs(current) > DRIVING_A
        survey.driving_s += float(dt_s[driving].sum())
        survey.current_max_a = max(survey.current_max_a, float(current.max()))
        survey.current_min_a = min(survey.current_min_a, float(current.min()))
        survey.power_max_w = max(survey.power_max_w, float(watts[~missing].max(initial=-np.inf)))
        volts = np.where(np.isnan(piece.voltage_v), np.inf, piece.voltage_v)
        is_measured = driving & np.isfinite(volts).any(axis=1)
        survey.lowest_s += np.bincount(volts[is_measured].argmin(axis=1), dt_s[is_measured], minlength=self._n)
        survey.balancing_s += (np.nan_to_num(piece.balancing) * dt_s[:, None]).sum(axis=0)
        loaded = piece.current_a > SAG_A
        if loaded.any():
            rows = piece.fresh_voltage_v[loaded]
            apart = row_mean(rows)[:, None] - rows
            self._sag += np.array([np.nansum(apart, axis=0), np.isfinite(apart).sum(axis=0)])

    def _extremes(self, piece: SurveyPiece, dt_s: FloatArray) -> None:
        survey = self._survey
        survey.missing += np.isnan(piece.voltage_v).sum(axis=0)
        if self._waited is not None:
            is_measured = np.isfinite(piece.voltage_v)
            first = np.where(is_measured.any(axis=0), is_measured.argmax(axis=0), len(is_measured))
            self._waited += np.where(np.isnan(survey.voltage_max_v), first, 0)
        keep_extreme(survey.voltage_min_v, survey.voltage_min_at_s, piece.voltage_v, piece.time_s, lowest=True)
        keep_extreme(
            survey.temperature_max_degc, survey.temperature_max_at_s, piece.temperature_degc, piece.time_s, lowest=False
        )
        survey.voltage_max_v = np.fmax(survey.voltage_max_v, np.fmax.reduce(piece.voltage_v, axis=0))
        first, last = _first_rows(piece.temperature_degc), _first_rows(piece.soc)
        survey.temperature_first_degc = np.where(
            np.isnan(survey.temperature_first_degc), first, survey.temperature_first_degc
        )
        survey.soc_first = np.where(np.isnan(survey.soc_first), last, survey.soc_first)
        newest = _first_rows(piece.soc[::-1])
        survey.soc_last = np.where(np.isnan(newest), survey.soc_last, newest)

    def _count(self, name: str, edges: FloatArray, values: FloatArray, weights_s: FloatArray) -> None:
        is_finite = np.isfinite(values)
        if is_finite.any():
            weights = np.broadcast_to(weights_s, values.shape)[is_finite]
            bins = np.searchsorted(edges, values[is_finite], side="right")
            self._counts[name] += np.bincount(bins, weights, minlength=len(edges) + 1)

    def _histogram(self, name: str, unit: str, edges: FloatArray) -> Histogram:
        counts = self._counts[name]
        seconds, below_s, above_s = counts[1:-1], float(counts[0]), float(counts[-1])
        filled = np.flatnonzero(seconds)
        if not filled.size:
            return Histogram(unit, [], [], below_s, above_s)
        low, high = int(filled[0]), int(filled[-1]) + 1
        return Histogram(
            unit, edges[low : high + 1].round(6).tolist(), seconds[low:high].round(3).tolist(), below_s, above_s
        )

    def _track(self, piece: SurveyPiece) -> None:
        time_s = piece.time_s
        before_s = time_s[0] if self._tracked_s is None else self._tracked_s
        chosen = _spaced(time_s, before_s - TRACKER_STEP_S if self._tracked_s is None else before_s)
        if len(chosen):
            dt_s = np.maximum(np.diff(time_s[chosen], prepend=before_s), 0.0)
            self._tracked_s = float(time_s[chosen[-1]])
            self._tracker.take(dt_s, piece.current_a[chosen], piece.fresh_voltage_v[chosen])

    def _rests(self, piece: SurveyPiece) -> None:
        quiet = np.abs(piece.current_a) < REST_A
        edges = np.flatnonzero(np.diff(quiet, prepend=not quiet[0]))
        for start, end in zip(edges, [*edges[1:], len(quiet)], strict=True):
            if not quiet[start]:
                self._end_rest()
                continue
            if self._rest_from_s is None:
                self._rest_from_s = float(piece.time_s[start])
            self._rest_tail.append((piece.time_s[start:end], piece.voltage_v[start:end]))
            self._rest_tail = self._rest_tail[-4:]

    def _end_rest(self) -> None:
        survey, from_s = self._survey, self._rest_from_s
        tail, self._rest_tail, self._rest_from_s = self._rest_tail, [], None
        if from_s is None or not tail:
            return
        time_s, volts = np.concatenate([part[0] for part in tail]), np.concatenate([part[1] for part in tail])
        lasted_s = float(time_s[-1]) - from_s
        mean_v = row_mean(volts[time_s >= time_s[-1] - REST_MEAN_S].T)
        is_first = from_s - survey.start_s < 1.0
        if is_first and lasted_s >= FIRST_REST_S:
            survey.first_rest = Rest(float(time_s[-1]), mean_v)
        if lasted_s >= LAST_REST_S or (is_first and lasted_s >= FIRST_REST_S):
            survey.last_rest = Rest(float(time_s[-1]), mean_v)


def _spaced(time_s: FloatArray, before_s: float) -> NDArray[np.intp]:
    """Indices of samples at least TRACKER_STEP_S apart, and from the time before them."""
    if (np.diff(time_s, prepend=before_s) >= TRACKER_STEP_S).all():
        return np.arange(len(time_s))
    chosen = []
    for k, at_s in enumerate(time_s.tolist()):
        if at_s - before_s >= TRACKER_STEP_S:
            before_s = at_s
            chosen.append(k)
    return np.array(chosen, dtype=np.intp)


def keep_extreme(
    best: FloatArray, best_at_s: FloatArray, values: FloatArray, time_s: FloatArray, *, lowest: bool
) -> None:
    """Put a piece's extremes into `best` and when they were into `best_at_s` where they go beyond it."""
    filled = np.where(np.isnan(values), np.inf if lowest else -np.inf, values)
    at = filled.argmin(axis=0) if lowest else filled.argmax(axis=0)
    extreme = np.take_along_axis(filled, at[None, :], axis=0)[0]
    beyond = (extreme < best) | np.isnan(best) if lowest else (extreme > best) | np.isnan(best)
    beyond &= np.isfinite(extreme)
    best[beyond] = extreme[beyond]
    best_at_s[beyond] = time_s[at[beyond]]


def _first_rows(values: FloatArray) -> FloatArray:
    """The first measured value of each column."""
    is_finite = np.isfinite(values)
    at = is_finite.argmax(axis=0)
    return np.where(is_finite.any(axis=0), np.take_along_axis(values, at[None, :], axis=0)[0], np.nan)
