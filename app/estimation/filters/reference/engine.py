"""One step of the reference over all cells, behind the interface of the engines."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.filters.estimates import N_OUT
from app.estimation.filters.reference.fusion import fuse, self_check, soc_variance
from app.estimation.filters.reference.output import Output, output_sigma, output_tangent
from app.estimation.filters.reference.predict import predict
from app.estimation.filters.reference.start import start
from app.estimation.filters.reference.state import (
    CURRENT_MAX_C,
    Measurement,
    Motion,
    State,
    initial_state,
    motion_of,
    read,
)
from app.estimation.filters.reference.update import update
from app.estimation.filters.setup import FilterSetup, Kind

COUNT_SIGMA_MAX: Final = 0.5


def step(setup: FilterSetup, state: State, motion: Motion, measured: Measurement) -> tuple[State, FloatArray]:
    """Return the state after one sample, and (8, n) what it says; rows as in `Estimates`."""
    state = predict(setup, state, motion, measured)
    if setup.kind is Kind.COUNT:
        return _count(setup, state, motion, measured)
    output = _output(setup, state, motion, measured)
    state, innovation = update(setup, state, motion, measured, output)
    soc, variance = state.soc, soc_variance(setup, state, output)
    if setup.kind is Kind.SIGMA_FUSED:
        state, soc, variance = fuse(setup, state, motion, variance)
    state, valid = self_check(setup, state, motion, innovation.nu, innovation.used)
    rows = (variance**0.5, setup.cell.ocv(soc), output.h, innovation.nu, innovation.sigma, valid, innovation.used)
    return state, np.array([np.clip(soc, 0.0, 1.0), *rows])


def _output(setup: FilterSetup, state: State, motion: Motion, measured: Measurement) -> Output:
    if setup.rule is None:
        return output_tangent(setup, state, motion, measured)
    return output_sigma(setup, setup.rule, state, motion, measured)


def _count(setup: FilterSetup, state: State, motion: Motion, measured: Measurement) -> tuple[State, FloatArray]:
    """The charge count alone: the voltage is predicted for the self-check only."""
    state = replace(state, soc=state.count_soc)
    h = output_tangent(setup, state, motion, measured).h
    nu, sigma = measured.voltage_v - h, np.sqrt(motion.noise_v2 * measured.cold)
    state, valid = self_check(setup, state, motion, nu, measured.is_measured)
    soc, soc_sigma = np.clip(state.soc, 0.0, 1.0), np.minimum(np.sqrt(state.count_v2), COUNT_SIGMA_MAX)
    return state, np.array([soc, soc_sigma, setup.cell.ocv(state.soc), h, nu, sigma, valid, np.zeros_like(nu)])


class ReferenceEngine:
    """Keeps the state and the last current of one filter over n_cells cells; see `Engine`."""

    def __init__(self, setup: FilterSetup, n_cells: int) -> None:
        self.n_cells = n_cells
        self.state = initial_state(setup, n_cells)
        self._setup = setup
        self._current_a = 0.0

    def start(
        self,
        current_a: float,
        voltage_v: FloatArray,
        temperature_degc: FloatArray,
        soc: FloatArray,
        soc_sigma: FloatArray,
    ) -> None:
        """Set the state from one sample; see `Engine.start`."""
        motion = motion_of(self._setup, 0.0, self._held(current_a))
        state, measured = read(self._setup, self.state, voltage_v, temperature_degc)
        self.state = start(self._setup, state, motion, measured, soc, soc_sigma)

    def step(self, dt_s: float, current_a: float, voltage_v: FloatArray, temperature_degc: FloatArray) -> FloatArray:
        """Return (8, n_cells) estimates after one sample; see `Engine.step`."""
        motion = motion_of(self._setup, dt_s, self._held(current_a))
        state, measured = read(self._setup, self.state, voltage_v, temperature_degc)
        self.state, numbers = step(self._setup, state, motion, measured)
        return numbers

    def record(
        self, dt_s: FloatArray, current_a: FloatArray, voltage_v: FloatArray, temperature_degc: FloatArray
    ) -> FloatArray:
        """Return (8, n_steps, n_cells) estimates of a whole record; see `Engine.record`."""
        numbers = np.empty((N_OUT, *voltage_v.shape))
        for k, (dt, current) in enumerate(zip(dt_s.tolist(), current_a.tolist(), strict=True)):
            numbers[:, k] = self.step(dt, current, voltage_v[k], temperature_degc[k])
        return numbers

    def get(self, name: str) -> FloatArray:
        """Return a copy of one quantity of the state; see `Engine.get`."""
        return np.array(getattr(self.state, name))

    def set(self, name: str, values: FloatArray) -> None:
        """Replace one quantity of the state; see `Engine.set`."""
        self.state = replace(self.state, **{name: np.array(values)})

    def _held(self, current_a: float) -> float:
        """Return the current in force: this one, or the last where this one is missing or impossible."""
        if abs(current_a) <= CURRENT_MAX_C * self._setup.cell.model.capacity_ah:
            self._current_a = float(current_a)
        return self._current_a
