"""The oracle of the C engine: the filters in plain numpy, written like the equations, state in, state out.

It says file by file and name by name what `app/estimation/filters/engine` has to compute.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.filters.estimates import N_OUT
from app.estimation.filters.setup import FilterSetup, Kind
from app.estimation.filters.tables import CURRENT_MAX_C
from tests.oracle.fusion import fuse, read_rest, self_check, soc_variance, watch_rest
from tests.oracle.output import Output, output_sigma, output_tangent
from tests.oracle.predict import predict
from tests.oracle.start import start
from tests.oracle.state import (
    Measurement,
    Motion,
    State,
    initial_state,
    motion_of,
    noise_v2,
    read,
)
from tests.oracle.update import update

COUNT_SIGMA_MAX: Final = 0.5
BEYOND_SHARE: Final = 0.1  # share of the charge, at currents beyond those of the cell file


def step(setup: FilterSetup, state: State, motion: Motion, measured: Measurement) -> tuple[State, FloatArray]:
    """Return the state after one sample, and (8, n) what it says; rows as in `Estimates`."""
    state = predict(setup, state, motion, measured)
    if setup.kind is Kind.COUNT:
        return _count(setup, state, motion, measured)
    output = _output(setup, state, motion, measured)
    state, innovation = update(setup, state, motion, measured, output)
    soc, variance = state.soc, soc_variance(setup, state, measured, output)
    state = watch_rest(setup, state, motion, measured)
    starts = state.start_soc, state.start_v2, state.start_weight
    is_fused = setup.kind is Kind.SIGMA_FUSED
    if motion.read_rest_s > 0.0 and (is_fused or not motion.is_rest_on):
        state = read_rest(setup, state, motion, measured)
    if motion.is_rest_cut:
        state = replace(state, unsettled_v2=np.zeros_like(state.unsettled_v2))
    if is_fused:
        state, soc, variance = fuse(setup, state, motion, measured, output, variance)
    if motion.is_rest_on:  # it will be read as a whole
        state = replace(state, start_soc=starts[0], start_v2=starts[1], start_weight=starts[2])
    state, valid = self_check(setup, state, motion, measured, innovation.nu, innovation.used, soc)
    ocv_v = setup.cell.ocv(soc, measured.place)
    rows = (variance**0.5, ocv_v, output.h, innovation.nu, innovation.sigma, valid, innovation.used)
    return state, np.array([np.clip(soc, 0.0, 1.0), *rows])


def _output(setup: FilterSetup, state: State, motion: Motion, measured: Measurement) -> Output:
    if setup.rule is None:
        return output_tangent(setup, state, motion, measured)
    return output_sigma(setup, setup.rule, state, motion, measured)


def _count(setup: FilterSetup, state: State, motion: Motion, measured: Measurement) -> tuple[State, FloatArray]:
    """The charge count alone: the voltage is predicted for the self-check only."""
    state = replace(state, soc=state.count_soc)
    h = output_tangent(setup, state, motion, measured).h
    nu, sigma = measured.voltage_v - h, np.sqrt(noise_v2(setup, motion, measured))
    state, valid = self_check(setup, state, motion, measured, nu, measured.is_measured, state.soc)
    soc, soc_sigma = np.clip(state.soc, 0.0, 1.0), np.minimum(np.sqrt(state.count_v2), COUNT_SIGMA_MAX)
    ocv_v = setup.cell.ocv(state.soc, measured.place)
    return state, np.array([soc, soc_sigma, ocv_v, h, nu, sigma, valid, np.zeros_like(nu)])


class ReferenceEngine:
    """Keeps the state and the last current of one filter over n_cells cells; with the interface of `NativeEngine`."""

    def __init__(self, setup: FilterSetup, n_cells: int) -> None:
        self.n_cells = n_cells
        self.state = initial_state(setup, n_cells)
        self._setup = setup
        self._current_a = 0.0
        self._since_s = 0.0  # since the starts were last weighed
        self._flow_a = self._beyond_a = 0.0  # size of the current, and of what of it is beyond the cell file's
        self._rest_s = -1.0  # time of rest since the start; negative once it has been read or broken

    def start(
        self,
        current_a: float,
        voltage_v: FloatArray,
        temperature_degc: FloatArray,
        soc: FloatArray,
        soc_sigma: FloatArray,
    ) -> None:
        """Set the state from one sample; see `NativeEngine.start`."""
        motion = motion_of(self._setup, 0.0, self._held(current_a))
        self._since_s, self._rest_s = self._setup.tuning.weighing_s, 0.0
        state, measured = read(self._setup, self.state, voltage_v, temperature_degc)
        self.state = start(self._setup, state, motion, measured, soc, soc_sigma)

    def step(self, dt_s: float, current_a: float, voltage_v: FloatArray, temperature_degc: FloatArray) -> FloatArray:
        """Return (8, n_cells) estimates after one sample; see `NativeEngine.step`."""
        current_a = self._held(current_a)
        self._watch_current(dt_s)
        is_beyond = self._beyond_a > BEYOND_SHARE * self._flow_a
        motion = motion_of(self._setup, dt_s, current_a, self._since_s + dt_s, self._rest_s, is_beyond)
        self._since_s = 0.0 if motion.weighed_s > 0.0 else self._since_s + dt_s
        rests = motion.rest_share > 0.0 or (self._rest_s == 0.0 and dt_s == 0.0)
        self._rest_s = self._rest_s + dt_s if rests and not motion.is_whole_rest else -1.0
        state, measured = read(self._setup, self.state, voltage_v, temperature_degc)
        self.state, numbers = step(self._setup, state, motion, measured)
        return numbers

    def record(
        self,
        dt_s: FloatArray,
        current_a: FloatArray,
        voltage_v: FloatArray,
        temperature_degc: FloatArray,
        n_rows: int = N_OUT,
    ) -> FloatArray:
        """Return (n_rows, n_steps, n_cells) estimates of a whole record; see `NativeEngine.record`."""
        numbers = np.empty((n_rows, *voltage_v.shape))
        for k, (dt, current) in enumerate(zip(dt_s.tolist(), current_a.tolist(), strict=True)):
            numbers[:, k] = self.step(dt, current, voltage_v[k], temperature_degc[k])[:n_rows]
        return numbers

    def get(self, name: str) -> FloatArray:
        """Return a copy of one quantity of the state; see `NativeEngine.get`."""
        return np.array(getattr(self.state, name))

    def set(self, name: str, values: FloatArray) -> None:
        """Replace one quantity of the state; see `NativeEngine.set`."""
        self.state = replace(self.state, **{name: np.array(values)})

    def _watch_current(self, dt_s: float) -> None:
        """q' = q + (1 - exp(-dt / wander_s)) (|i| - q) of the current, and of what of it was beyond `seen_a`."""
        size_a, share = abs(self._current_a), 1.0 - math.exp(-dt_s / self._setup.tuning.wander_s)
        beyond_a = size_a if size_a > self._setup.cell.seen_a else 0.0
        self._flow_a += share * (size_a - self._flow_a)
        self._beyond_a += share * (beyond_a - self._beyond_a)

    def _held(self, current_a: float) -> float:
        """Return the current in force: this one, or the last where this one is missing or impossible."""
        if abs(current_a) <= CURRENT_MAX_C * self._setup.cell.model.capacity_ah:
            self._current_a = float(current_a)
        return self._current_a
