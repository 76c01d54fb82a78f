"""Load of every cell in a stretch of a session: sums over time that the survey does not have."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from app.analysis.report.summary import NEAR
from app.analysis.survey import REST_A, SurveyPiece
from app.analysis.totals import MAX_STEP_S, SECONDS_PER_HOUR
from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import CellModel
from app.estimation.health.capacity import CapacityBetweenRests, CapacityTracker

_NEAR_COLUMNS = {  # column, limit, what of a piece, side
    "near_v_min_s": ("v_min", "v_cell_min", "voltage_v", -1.0),
    "near_v_max_s": ("v_max", "v_cell_max", "voltage_v", 1.0),
    "near_t_max_s": ("t_max", "t_cell_max", "temperature_degc", 1.0),
}


class CellSums:
    """Takes the pieces of a stretch in order; arrays are (n_cells,)."""

    def __init__(self, n_cells: int, bleed_ohm: float | None = None) -> None:
        self._n = n_cells
        self._bleed_ohm = np.nan if bleed_ohm is None else bleed_ohm
        self._before_s: float | None = None
        self._out_ws, self._in_ws, self._bled_vs = np.zeros((3, n_cells))
        self._missing_s = np.zeros(n_cells)  # under current, without a voltage
        self._out_as = self._in_as = 0.0
        self._means = {name: np.zeros((2, n_cells)) for name in ("temperature_degc", "soc")}  # integral and seconds
        self._near: dict[str, FloatArray] = {}

    def add(self, piece: SurveyPiece, limits: Mapping[str, float]) -> None:
        """Take the next piece, which `limits` were in force in, by name."""
        if not len(piece.time_s):
            return
        raw_s = np.diff(piece.time_s, prepend=piece.time_s[0] if self._before_s is None else self._before_s)
        dt_s = np.where((raw_s > 0.0) & (raw_s <= MAX_STEP_S), raw_s, 0.0)  # each stands for the time up to it
        self._before_s = float(piece.time_s[-1])
        charge_as = np.nan_to_num(piece.current_a) * dt_s
        out_as, in_as = np.maximum(charge_as, 0.0), np.maximum(-charge_as, 0.0)
        self._out_as += float(out_as.sum())
        self._in_as += float(in_as.sum())
        volts = np.nan_to_num(piece.voltage_v)
        self._out_ws += out_as @ volts  # current is positive on discharge; a cell's voltage is never below 0
        self._in_ws += in_as @ volts
        self._missing_s += (dt_s * (np.abs(charge_as) > REST_A * dt_s)) @ np.isnan(piece.voltage_v)
        if np.nanmax(piece.balancing, initial=0.0) > 0.0:
            self._bled_vs += dt_s @ (volts * np.nan_to_num(piece.balancing))
        for name, (integral, seconds) in self._means.items():
            values = getattr(piece, name)
            is_finite = np.isfinite(values)
            integral += dt_s @ np.where(is_finite, values, 0.0)
            seconds += dt_s @ is_finite
        self._add_near(piece, dt_s, limits)

    def _add_near(self, piece: SurveyPiece, dt_s: FloatArray, limits: Mapping[str, float]) -> None:
        for column, (kind, limit, of, side) in _NEAR_COLUMNS.items():
            if limit in limits:
                edge = limits[limit] - side * NEAR[kind]  # type: ignore[index]
                is_near = side * getattr(piece, of) > side * edge  # missing values compare as False
                so_far = self._near.get(column, np.zeros(self._n))
                self._near[column] = so_far + dt_s @ is_near

    def columns(self) -> dict[str, FloatArray | float]:
        """Return the columns of the table `cells` that are sums."""
        means = {}
        for name, (integral, seconds) in self._means.items():
            means[name] = np.where(seconds > 0.0, integral / np.maximum(seconds, 1e-9), np.nan)
        return {
            "energy_out_wh": self._energies_wh(self._out_ws),
            "energy_in_wh": self._energies_wh(self._in_ws),
            "charge_out_ah": self._out_as / SECONDS_PER_HOUR,
            "charge_in_ah": self._in_as / SECONDS_PER_HOUR,
            "bled_v_s": self._bled_vs,
            "bled_ah": self._bled_vs / self._bleed_ohm / SECONDS_PER_HOUR,
            "temperature_mean_degc": means["temperature_degc"],
            "soc_mean": means["soc"],
            **{column: self._near.get(column, np.full(self._n, np.nan)) for column in _NEAR_COLUMNS},
        }

    def _energies_wh(self, sums_ws: FloatArray) -> FloatArray:
        return np.where(self._missing_s <= MAX_STEP_S, sums_ws / SECONDS_PER_HOUR, np.nan)


@dataclass(frozen=True)
class Stretch:
    """Charge counted between two rests: (n_cells,) change of SOC, its sigma, charge and its sigma [Ah]."""

    soc_moved: FloatArray
    soc_moved_sigma: float
    charge_ah: float
    charge_sigma_ah: float


class _Stretches(CapacityTracker):
    """A tracker that keeps what it is given."""

    def __init__(self, nominal_ah: float, n_cells: int) -> None:
        super().__init__(nominal_ah, n_cells)
        self.stretches: list[Stretch] = []

    def observe(
        self, soc_moved: ArrayLike, soc_moved_sigma: ArrayLike, charge_ah: ArrayLike, charge_sigma_ah: ArrayLike
    ) -> None:
        self.stretches.append(
            Stretch(
                np.array(soc_moved, dtype=np.float64),
                float(np.asarray(soc_moved_sigma)),
                float(np.asarray(charge_ah)),
                float(np.asarray(charge_sigma_ah)),
            )
        )


class RestCounter:
    """Counts the charge between the rests of a session, piece by piece."""

    def __init__(self, cell: CellModel, n_cells: int) -> None:
        self._tracker = _Stretches(cell.capacity_ah, n_cells)
        self._rests = CapacityBetweenRests(cell, self._tracker)
        self._last_s: float | None = None

    def add(self, piece: SurveyPiece) -> None:
        """Take the next piece."""
        for at_s, current_a, volts in zip(
            piece.time_s.tolist(), piece.current_a.tolist(), piece.voltage_v, strict=True
        ):
            dt_s = 0.0 if self._last_s is None else at_s - self._last_s
            self._last_s = at_s
            if current_a == current_a and 0.0 <= dt_s <= MAX_STEP_S:
                self._rests.step(dt_s, current_a, volts)

    @property
    def stretches(self) -> list[Stretch]:
        """Return the counts between two rests, in order."""
        return self._tracker.stretches
