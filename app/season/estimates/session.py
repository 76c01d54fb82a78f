"""One session estimated again, as a task of its own: any process that can read the file may run it.

A minute at a time: the filter over all cells, and from the same minute how much more each cell resists than its cell
file says,

    y = v_ocv - v,   x = v_ocv - v_model;   y - mean(y) = f (x - mean(x)) + error

with both means taken over that minute, because what is slower is SOC, heat and overpotential. The model knows the
temperature and the SOC, so factors of different sessions compare.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from app import __version__
from app.analysis.session_cell import cell_of
from app.analysis.session_survey import read_pieces
from app.analysis.survey import SurveyPiece
from app.analysis.totals import MAX_STEP_S, SECONDS_PER_HOUR, listed
from app.estimation.arrays import FloatArray
from app.estimation.cell_model.cell_file import format_cell, parse_cell
from app.estimation.cell_model.circuit import CellModel
from app.estimation.filters.engine.native_resistance import LASTING_S
from app.estimation.filters.estimates import Estimates
from app.estimation.filters.estimators import make_estimator
from app.estimation.health.learned import RESISTANCE_SIGMA_MAX
from app.estimation.health.resistance_scale import filter_factor
from app.season.estimates.results import SCHEMA, cell_hash
from app.sessions.reading.reader import SessionFile

USED_SIGMA_MAX: Final = RESISTANCE_SIGMA_MAX
KNOWN_SIGMA_MAX: Final = 0.3  # a factor less sure than this tells nothing
UNKNOWN_SOC: Final = 0.5
ERROR_FLOOR_V2: Final = 1e-6
Keep = Callable[[FloatArray, Estimates], None]  # (n,) unix times [s], and the estimates at them
EVERY: Final = 10  # rows of the master's stream are a second; means need no more


@dataclass(frozen=True)
class EstimateJob:
    """A job for a worker; `cells` are texts of cell files, None is the session's own."""

    path: str
    cells: tuple[str | None, ...]
    filter_name: str = "fused"


def estimate_session(job: EstimateJob) -> list[dict[str, Any]]:
    """Return what each cell file makes of the session, in order, as plain JSON values; it is read once.

    Raises:
        SessionError: the file is missing, damaged or of a newer program.
        EstimatorError: there is no such filter, or a cell file is wrong.
    """
    began_s = time.process_time()
    with SessionFile(Path(job.path)) as session:
        own = cell_of(session)[0]
        models = [own if text is None else parse_cell(text) for text in job.cells]
        hashes = [cell_hash(format_cell(model)) for model in models]
        runs = {
            name: SessionEstimate(model, job.filter_name, session.battery.n_cells)
            for name, model in zip(hashes, models, strict=True)
        }
        for piece in read_pieces(session):
            for run in runs.values():
                run.add(piece)
        info, content = session.info, session.content_digest
    about = {
        "schema": SCHEMA,
        "session": info.id,
        "name": info.name,
        "start_s": info.started_wall_ns / 1e9,
        "end_s": (info.ended_wall_ns or info.started_wall_ns) / 1e9,
        "content": content,
        "recorded_by": info.voltwall,
        "version": __version__,
        "filter": job.filter_name,
    }
    spent_s = (time.process_time() - began_s) / max(len(models), 1)
    return [
        about
        | {"cell": {"name": model.name, "hash": name, "capacity_ah": model.capacity_ah}}
        | runs[name].result()
        | {"processor_s": round(spent_s, 4), "process": os.getpid()}
        for model, name in zip(models, hashes, strict=True)
    ]


def estimate_along(session: SessionFile, cell: CellModel, filter_name: str, keep: Keep) -> dict[str, Any]:
    """Return what a cell model makes of an open session, as `estimate_session` does; `keep` is given all on the way.

    Raises:
        NotASession: the file is damaged.
        EstimatorError: there is no such filter.
    """
    run = SessionEstimate(cell, filter_name, session.battery.n_cells, keep)
    for piece in read_pieces(session):
        run.add(piece)
    return run.result()


class SessionEstimate:
    """One filter along one session, piece by piece."""

    def __init__(self, cell: CellModel, filter_name: str, n_cells: int, keep: Keep | None = None) -> None:
        self._keep = keep
        self._cell = cell
        self._estimator = make_estimator(filter_name, cell, n_cells)
        self._last_s: float | None = None
        self._last_a = 0.0
        self._factor = np.ones(n_cells)
        self._sums = np.zeros((4, n_cells))  # sums of x x, x y, y y [V^2 s], and the time of them [s]
        self._warm = np.zeros((2, n_cells))  # sum of temperatures, count
        self._off = np.zeros((2, n_cells))  # innovation squared, count
        self._apart = np.zeros(2)  # new less recorded SOC squared, count
        self._moved_ah = np.zeros(2)  # out, in
        nan = np.full(n_cells, np.nan)
        self._first, self._soc, self._sigma, self._recorded = (nan.copy() for _ in range(4))
        self._samples = 0

    def add(self, piece: SurveyPiece) -> None:
        """Take the next minute; a gap begins a new stretch, of which nobody knows what flowed."""
        breaks = np.flatnonzero(np.diff(piece.time_s) > MAX_STEP_S) + 1
        for rows in np.split(np.arange(len(piece.time_s)), breaks):
            if rows.size:
                self._stretch(piece, slice(int(rows[0]), int(rows[-1]) + 1))

    def _stretch(self, piece: SurveyPiece, rows: slice) -> None:
        time_s, current_a = piece.time_s[rows], piece.current_a[rows]
        voltage_v, temperature_degc = piece.fresh_voltage_v[rows], piece.temperature_degc[rows]
        if self._last_s is None:
            self._estimator.start(voltage_v[0], temperature_degc[0], float(np.nan_to_num(current_a[0])))
            self._last_s = float(time_s[0])
        dt_s = np.maximum(np.diff(time_s, prepend=self._last_s), 0.0)
        if dt_s[0] > MAX_STEP_S:
            moved = self._last_a * dt_s[0] / SECONDS_PER_HOUR / self._cell.capacity_ah
            nothing = np.full(voltage_v.shape[1], np.nan)
            self._estimator.step(float(dt_s[0]), 0.0, nothing, temperature_degc[0])
            self._estimator.widen(min(moved, UNKNOWN_SOC))
            dt_s[0] = 0.0
        estimates = self._estimator.run(dt_s, current_a, voltage_v, temperature_degc)
        if self._keep is not None:
            self._keep(time_s, estimates)
        self._last_s = float(time_s[-1])
        self._samples += len(time_s)
        known_a = np.nan_to_num(current_a)
        self._last_a = float(np.sqrt(np.mean(known_a**2)))
        moved_ah = known_a * dt_s / SECONDS_PER_HOUR
        self._moved_ah += (moved_ah[moved_ah > 0.0].sum(), -moved_ah[moved_ah < 0.0].sum())
        self._take(estimates.soc, estimates.soc_sigma, piece.soc[rows], temperature_degc, estimates.innovation_v)
        self._regress(dt_s, estimates.ocv_v, estimates.voltage_v, voltage_v)

    def _take(
        self,
        soc: FloatArray,
        sigma: FloatArray,
        recorded: FloatArray,
        temperature_degc: FloatArray,
        innovation_v: FloatArray,
    ) -> None:
        self._first = np.where(np.isnan(self._first), soc[0], self._first)
        self._soc, self._sigma = soc[-1].copy(), sigma[-1].copy()
        seconds = slice(None, None, EVERY)
        self._warm += _sums(temperature_degc[seconds], 1)
        self._off += _sums(innovation_v[seconds], 2)
        self._apart += _sums((soc[seconds] - recorded[seconds]).ravel(), 2)
        self._recorded = np.where(np.isnan(recorded[-1]), self._recorded, recorded[-1])

    def _regress(self, dt_s: FloatArray, ocv_v: FloatArray, model_v: FloatArray, fresh_voltage_v: FloatArray) -> None:
        y, x = ocv_v - fresh_voltage_v, (ocv_v - model_v) / self._factor
        weight = np.broadcast_to(dt_s[:, None], y.shape)
        is_finite = np.isfinite(fresh_voltage_v)
        if not is_finite.all():
            weight = weight * is_finite
            y, x = np.where(is_finite, y, 0.0), np.where(is_finite, x, 0.0)
        lasted_s = weight.sum(axis=0)
        y -= np.einsum("ij,ij->j", weight, y) / np.maximum(lasted_s, 1e-9)
        x -= np.einsum("ij,ij->j", weight, x) / np.maximum(lasted_s, 1e-9)
        weighted = weight * x
        xx, xy = np.einsum("ij,ij->j", weighted, x), np.einsum("ij,ij->j", weighted, y)
        self._sums += (xx, xy, np.einsum("ij,ij,ij->j", weight, y, y), lasted_s)
        factor, sigma = self.resistance()
        self._factor = filter_factor(factor, sigma <= USED_SIGMA_MAX)
        self._estimator.use_resistance(self._factor)

    def resistance(self) -> tuple[FloatArray, FloatArray]:
        """Return (n_cells,) resistance over that of the cell model, and its sigma; NaN and inf where unknown."""
        xx, xy, yy, lasted_s = self._sums
        with np.errstate(divide="ignore", invalid="ignore"):
            factor = xy / xx
            left = np.maximum((yy - xy * factor) / lasted_s, ERROR_FLOOR_V2)
            sigma = np.sqrt(2.0 * LASTING_S * left / xx)
        is_known = np.isfinite(factor) & (factor > 0.0) & (sigma <= KNOWN_SIGMA_MAX)
        return np.where(is_known, factor, np.nan), np.where(is_known, sigma, np.inf)

    def result(self) -> dict[str, Any]:
        """Return what came out."""
        factor, sigma = self.resistance()
        capacity_ah, capacity_sigma_ah = self._estimator.capacity() if self._samples else (self._soc, self._soc)
        with np.errstate(invalid="ignore", divide="ignore"):
            warm, off = self._warm[0] / self._warm[1], np.sqrt(self._off[0] / self._off[1])
        return {
            "samples": self._samples,
            "soc_first": listed(self._first, 5),
            "soc_last": listed(self._soc, 5),
            "soc_sigma_last": listed(self._sigma, 5),
            "resistance_factor": listed(factor, 5),
            "resistance_sigma": listed(np.where(np.isfinite(sigma), sigma, np.nan), 5),
            "capacity_ah": listed(capacity_ah, 4),
            "capacity_sigma_ah": listed(capacity_sigma_ah, 4),
            "temperature_degc": listed(warm, 2),
            "innovation_rms_v": listed(off, 6),
            "charge_out_ah": round(float(self._moved_ah[0]), 4),
            "charge_in_ah": round(float(self._moved_ah[1]), 4),
            "recorded_soc_last": listed(self._recorded, 5),
            "recorded_soc_rms": float(np.sqrt(self._apart[0] / self._apart[1])) if self._apart[1] else None,
        }


def _sums(values: FloatArray, power: int) -> FloatArray:
    """(2, ...) sums over the first axis of what was measured, to a power, and how many there were."""
    is_finite = np.isfinite(values)
    return np.array([(np.where(is_finite, values, 0.0) ** power).sum(axis=0), is_finite.sum(axis=0)])
