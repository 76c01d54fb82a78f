"""Every filter behind one interface: what comes from outside is checked here, the C engine computes."""

from __future__ import annotations

from math import inf
from typing import Final

import numpy as np
from numpy import ndarray
from numpy.typing import ArrayLike

from app.estimation.arrays import FloatArray
from app.estimation.errors import EstimatorError, ShapeError
from app.estimation.filters.engine.native import NativeEngine
from app.estimation.filters.estimates import N_OUT, OUT_OCV, Estimates
from app.estimation.filters.setup import FilterSetup, Kind

NOT_STARTED: Final = "the filter has not been started"
SLOPE_FLOOR_V: Final = 0.02  # least slope by which a voltage error is turned into one of SOC
SOC_VARIANCE_MAX: Final = 0.25  # no cell's SOC is less known than this


class SocEstimator:
    """A filter over n_cells cells that share a current.

    A plain filter starts from the SOC it is given. Fused, the filter starts from the voltage, the count from the SOC.
    """

    def __init__(self, setup: FilterSetup, engine: NativeEngine) -> None:
        self.setup = setup
        self.engine = engine
        self.model = setup.cell.model
        self.tuning = setup.tuning
        self._shape = (engine.n_cells,)
        self._is_started = False
        self._was_given_soc = False  # a SOC, which a filter without a count goes on from

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return self.engine.n_cells

    @property
    def state_mean(self) -> FloatArray:
        """(n_states, n_cells) of the filter: SOC, then RC currents [A]; a copy."""
        return np.concatenate((self.engine.get("soc")[None], self.engine.get("branch_a")[: self.model.n_rc]))

    @property
    def state_cov(self) -> FloatArray:
        """(n_cells, n_states, n_states) of the filter; a copy."""
        d = 1 + self.model.n_rc  # the lasting error is the engine's own
        cov = self.engine.get("cov")[:d, :d]
        if self.setup.kind is Kind.COUNT:  # the SOC is counted, the RC currents are as good as the model says
            cov[0, :] = cov[:, 0] = 0.0
            cov[0, 0] = self._count_variance()
        return np.ascontiguousarray(np.moveaxis(cov, 2, 0))

    @property
    def counted_soc(self) -> FloatArray:
        """(n_cells,) SOC of the charge count; a copy."""
        return self.engine.get("count_soc")

    def voltage_soc(self) -> tuple[FloatArray, FloatArray] | None:
        """Return (n_cells,) SOC by voltages alone and its sigma; None where a count or a given SOC has a part in it."""
        if self._was_given_soc or self.setup.kind is Kind.COUNT:
            return None
        soc = self.engine.get("soc")
        slope_v = np.maximum(self.model.ocv.slope(np.clip(soc, 0.0, 1.0)), SLOPE_FLOOR_V)
        variance = self.engine.get("cov")[0, 0] + self.engine.get("slow_square_v2") / slope_v**2
        return soc, np.sqrt(np.minimum(variance, SOC_VARIANCE_MAX))

    def use_capacity(self, capacity_ah: ArrayLike) -> None:
        """Count with capacities of the cells' own instead of the cell file's, from the next step on.

        Args:
            capacity_ah: (n_cells,) or scalar [Ah].

        Raises:
            ShapeError: it is neither.
            EstimatorError: one is not finite and positive.
        """
        own, engine = self._positive("capacity_ah", capacity_ah), self.engine
        ratio = own / engine.get("capacity_ah")
        if (ratio == 1.0).all():
            return
        engine.set("capacity_ah", own)
        # charge over capacity counts in the new unit from the start on; what was learned of it stays true
        for name in ("gain", "fused_gain"):
            engine.set(name, (1.0 + engine.get(name)) * ratio - 1.0)
        for name in ("drawn", "gain_slope"):
            engine.set(name, engine.get(name) / ratio)

    def widen(self, soc_sigma: ArrayLike) -> None:
        """Know the SOC less surely, because charge has moved that was not measured.

        Args:
            soc_sigma: (n_cells,) or scalar, standard deviation of that charge over the capacity.

        Raises:
            ShapeError: it is neither.
        """
        more_v2, engine = self._per_cell("soc_sigma", soc_sigma) ** 2, self.engine
        cov = engine.get("cov")
        cov[0, 0] = np.minimum(cov[0, 0] + more_v2, SOC_VARIANCE_MAX)
        engine.set("cov", cov)
        for name in ("anchor_v2", "start_v2", "fused_v2"):
            engine.set(name, np.minimum(engine.get(name) + more_v2, SOC_VARIANCE_MAX))

    def capacity(self) -> tuple[FloatArray, FloatArray]:
        """Return (n_cells,) capacities as far as the run contradicts the ones counted with, and their sigmas [Ah]."""
        counted_ah, gain = self.engine.get("capacity_ah"), self.engine.get("gain")
        per_gain_ah = counted_ah / (1.0 + gain) ** 2
        uncertainty = self.tuning.hidden_factor
        return counted_ah / (1.0 + self.engine.get("fused_gain")), per_gain_ah * np.sqrt(
            uncertainty * self.engine.get("gain_v2")
        )

    def use_resistance(self, factor: ArrayLike) -> None:
        """Predict voltages with resistances that differ from the cell file's, from the next step on.

        Args:
            factor: (n_cells,) or scalar, all resistances of a cell over those of the cell file.

        Raises:
            ShapeError: it is neither.
            EstimatorError: one is not finite and positive.
        """
        self.engine.set("resistance", self._positive("factor", factor))

    def start(
        self,
        voltages_v: ArrayLike,
        temperatures_degc: ArrayLike,
        current_a: float,
        soc: ArrayLike | None = None,
        soc_sigma: ArrayLike | None = None,
    ) -> None:
        """Set the state from one sample.

        Args:
            voltages_v: (n_cells,) [V]; NaN where not measured.
            temperatures_degc: (n_cells,) [degC]; NaN where not measured.
            current_a: positive on discharge [A].
            soc: known SOC at this moment, scalar or (n_cells,), NaN = unknown; None = take it from the voltage.
            soc_sigma: how far that may be off; None = the filter's own default.

        Raises:
            ShapeError: an array is not (n_cells,).
        """
        given, sigma = self._per_cell("soc", soc), self._per_cell("soc_sigma", soc_sigma)
        voltage, temperature = self._sample(voltages_v, temperatures_degc)
        self.engine.start(current_a, voltage, temperature, given, sigma)
        self._was_given_soc = not self.setup.counts and bool(np.isfinite(given).any())
        self._is_started = True

    def step(self, dt_s: float, current_a: float, voltages_v: ArrayLike, temperatures_degc: ArrayLike) -> Estimates:
        """Return the estimates after one sample.

        Args:
            dt_s: time since the previous sample, >= 0; hours are allowed [s].
            current_a: current held over that time, positive on discharge [A]; NaN = not measured, the last one counts.
            voltages_v: (n_cells,) [V]; NaN where not measured.
            temperatures_degc: (n_cells,) [degC]; NaN where not measured, the last one counts.

        Raises:
            ShapeError: an array is not (n_cells,).
            EstimatorError: dt_s is negative or not finite, or `start` was never called.
        """
        if not self._is_started:
            raise EstimatorError(NOT_STARTED)
        if not 0.0 <= dt_s < inf:
            raise EstimatorError(f"a step of {dt_s} s is no step")
        # the usual case without a call: next to an engine of microseconds each counts
        if (
            type(voltages_v) is ndarray
            and type(temperatures_degc) is ndarray
            and voltages_v.shape == (shape := self._shape)
            and temperatures_degc.shape == shape
        ):
            voltage, temperature = voltages_v, temperatures_degc
        else:
            voltage, temperature = self._sample(voltages_v, temperatures_degc)
        return Estimates(self.engine.step(dt_s, current_a, voltage, temperature))

    def run(
        self,
        dt_s: FloatArray,
        current_a: FloatArray,
        voltage_v: FloatArray,
        temperature_degc: FloatArray,
        soc_only: bool = False,
    ) -> Estimates:
        """Return the estimates of a whole record, as so many calls of `step` would give them.

        Args:
            dt_s: (n_steps,) time since the previous sample, >= 0 [s].
            current_a: (n_steps,) positive on discharge [A]; NaN = the last one counts.
            voltage_v: (n_steps, n_cells) [V]; NaN where not measured.
            temperature_degc: (n_steps, n_cells) [degC]; NaN = the last one counts.
            soc_only: keep `soc` and `soc_sigma` alone: writing the rest of a long record to memory takes nearly as
                long as estimating it.

        Returns:
            Estimates whose arrays are (n_steps, n_cells).

        Raises:
            ShapeError: the arrays do not fit each other.
            EstimatorError: a step is negative or not finite, or `start` was never called.
        """
        if not self._is_started:
            raise EstimatorError(NOT_STARTED)
        n = dt_s.size
        names = ("dt_s", "current_a", "voltage_v", "temperature_degc")
        shapes = ((n,), (n,), (n, self.n_cells), (n, self.n_cells))
        for name, array, shape in zip(names, (dt_s, current_a, voltage_v, temperature_degc), shapes, strict=True):
            if array.shape != shape:
                raise ShapeError(name, shape, array.shape)
        if not (np.isfinite(dt_s).all() and (dt_s >= 0.0).all()):
            raise EstimatorError("a step is negative or not finite")
        n_rows = OUT_OCV if soc_only else N_OUT
        return Estimates(self.engine.record(dt_s, current_a, voltage_v, temperature_degc, n_rows))

    def _sample(self, voltages_v: ArrayLike, temperatures_degc: ArrayLike) -> tuple[FloatArray, FloatArray]:
        voltage, temperature = np.asarray(voltages_v, np.float64), np.asarray(temperatures_degc, np.float64)
        if voltage.shape != self._shape:
            raise ShapeError("voltages_v", self._shape, voltage.shape)
        if temperature.shape != self._shape:
            raise ShapeError("temperatures_degc", self._shape, temperature.shape)
        return voltage, temperature

    def _per_cell(self, name: str, values: ArrayLike | None) -> FloatArray:
        """Return a scalar or (n_cells,) argument as (n_cells,); NaN everywhere for None."""
        array = np.asarray(np.nan if values is None else values, dtype=np.float64)
        if array.shape not in ((), self._shape):
            raise ShapeError(name, self._shape, array.shape)
        return np.array(array if array.shape == self._shape else np.broadcast_to(array, self._shape))

    def _positive(self, name: str, values: ArrayLike) -> FloatArray:
        own = self._per_cell(name, values)
        if not (np.isfinite(own).all() and (own > 0.0).all()):
            raise EstimatorError(f"{name} has to be finite and positive")
        return own

    def _count_variance(self) -> FloatArray:
        gain, offset = self.engine.get("count_gain"), self.engine.get("count_offset")
        return gain**2 + offset**2 + self.engine.get("anchor_v2")
