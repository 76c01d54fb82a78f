"""Switched-capacitor equaliser: N-1 capacitors that carry charge between neighbours, 2N switches in two phases.

In phase A capacitor k lies across cell k, in phase B across cell k+1. Each of the N switch nodes has the resistance of
one closed switch, shared by the capacitors on its two sides. The network is solved exactly: one period is a linear map
of capacitor voltages, and any number of periods is a power of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from simulator.cell_data import FloatArray
from simulator.errors import ParameterError


@dataclass(frozen=True)
class SwitchedCapacitorParameters:
    """Component values."""

    capacitance_f: float
    switch_ohm: float
    frequency_hz: float
    duty: float = 0.45  # duty of each phase; the rest is dead time
    series_ohm: float = 0.0  # series resistance of a capacitor
    cell_ohm: float = 0.0  # instantaneous resistance of a cell
    precharged: bool = False  # capacitors start at their cell's voltage instead of empty

    def __post_init__(self) -> None:
        for name in ("capacitance_f", "frequency_hz", "duty"):
            if not getattr(self, name) > 0.0:
                raise ParameterError(name, getattr(self, name), "must be positive")
        if self.duty > 0.5:
            raise ParameterError("duty", self.duty, "two phases share a period: 0.5 at most")
        if not self.switch_ohm + self.series_ohm + self.cell_ohm > 0.0:
            raise ParameterError("switch_ohm", self.switch_ohm, "some resistance must limit the current")


class SwitchedCapacitorEqualiser:
    """State: (n-1,) capacitor voltages at the beginning of a period."""

    def __init__(self, parameters: SwitchedCapacitorParameters, voltage_v: FloatArray) -> None:
        self.parameters = parameters
        self.n_cells = n = len(voltage_v)
        if n < 2:
            raise ParameterError("voltage_v", n, "two cells or more")
        self.capacitor_v = voltage_v[:-1].copy() if parameters.precharged else np.zeros(n - 1)
        self.loss_w = 0.0
        self._conductance_s = np.linalg.inv(self._loop_ohm())
        self._period = self._period_map()
        self._powers: dict[int, FloatArray] = {1: self._period}

    def step(self, dt_s: float, emf_v: FloatArray) -> FloatArray:
        """Advance by whole periods nearest to `dt_s` and return the (n,) mean currents out of the cells [A].

        Args:
            dt_s: length of the step, a period or more [s].
            emf_v: (n,) cell voltages without the drop that the equaliser's own current makes over `cell_ohm` [V].
        """
        n, p = self.n_cells, self.parameters
        periods = max(1, round(dt_s * p.frequency_hz))
        power = self._powers.get(periods)
        if power is None:
            power = np.linalg.matrix_power(self._period, periods)
            self._powers = {1: self._period, periods: power}
        state = power @ np.concatenate((self.capacitor_v, np.zeros(n), emf_v))
        charge_coulomb = state[n - 1 : 2 * n - 1]
        seconds = periods / p.frequency_hz
        gained_j = 0.5 * p.capacitance_f * float((state[: n - 1] ** 2 - self.capacitor_v**2).sum())
        self.loss_w = (float(emf_v @ charge_coulomb) - gained_j) / seconds
        self.capacitor_v = state[: n - 1]
        current_a: FloatArray = charge_coulomb / seconds
        return current_a

    def slowest_time_s(self) -> float:
        """Return the time constant with which the slowest pattern of capacitor voltages follows the cells [s]."""
        eigenvalues = np.abs(np.linalg.eigvals(self._period[: self.n_cells - 1, : self.n_cells - 1]))
        largest = float(eigenvalues.max())
        return -1.0 / (math.log(largest) * self.parameters.frequency_hz) if largest > 0.0 else 0.0

    def transfer_ohm(self) -> float:
        """Return the resistance that stands for one capacitor between two cells held at different voltages [ohm].

        coth(x/2) / (f C) with x = duty / (f R C): 1 / (f C) for slow switching, 2 R / duty for fast, R around the loop.
        """
        pair = SwitchedCapacitorEqualiser(self.parameters, np.zeros(2))
        held = np.array([1.0, 0.0])
        pair.step(1e3 * max(pair.slowest_time_s(), 1.0 / self.parameters.frequency_hz), held)
        return float(1.0 / pair.step(1.0 / self.parameters.frequency_hz, held)[0])

    def conductance_s(self) -> FloatArray:
        """Return (n, n) Y [S] of the mean currents I = Y V that settled capacitors carry out of cells held at V.

        Switch nodes carry the difference of two capacitors' currents, so slow patterns along a chain pass through far
        less resistance than one pair of cells alone would find.
        """
        n, m, period = self.n_cells, self.n_cells - 1, self._period
        settled = np.linalg.solve(np.eye(m) - period[:m, :m], period[:m, m + n :])
        charge = period[m : m + n, :m] @ settled + period[m : m + n, m + n :]
        conductance: FloatArray = self.parameters.frequency_hz * charge
        return conductance

    def slowest_pattern_ohm(self) -> float:
        """Return the resistance of the pattern that evens out last: its time is this times a cell's dQ/dV [ohm]."""
        return float(1.0 / np.sort(np.linalg.eigvals(self.conductance_s()).real)[1])

    def _loop_ohm(self) -> FloatArray:
        """Return (n-1, n-1) L with L q = V - v: the voltage around each capacitor's loop for the currents q in all."""
        p, m = self.parameters, self.n_cells - 1
        own = 2.0 * p.switch_ohm + p.series_ohm + p.cell_ohm
        return own * np.eye(m) - p.switch_ohm * (np.eye(m, k=1) + np.eye(m, k=-1))

    def _phase_map(self, first_cell: int) -> FloatArray:
        """Return the map of (capacitor voltages, charge given by cells, cell voltages) over one phase."""
        n, m = self.n_cells, self.n_cells - 1
        p = self.parameters
        seconds = p.duty / p.frequency_hz
        # v' = G (V - v) / C has symmetric G: v(t) = V + exp(-G t / C) (v(0) - V)
        values, vectors = np.linalg.eigh(self._conductance_s)
        closing = vectors @ np.diag(-np.expm1(-values * seconds / p.capacitance_f)) @ vectors.T
        size = m + 2 * n
        phase = np.eye(size)
        sees = np.eye(m, n, k=first_cell)
        phase[:m, :m] -= closing
        phase[:m, m + n :] += closing @ sees
        phase[m : m + n, :m] -= p.capacitance_f * sees.T @ closing
        phase[m : m + n, m + n :] += p.capacitance_f * sees.T @ closing @ sees
        return phase

    def _period_map(self) -> FloatArray:
        period: FloatArray = self._phase_map(1) @ self._phase_map(0)
        return period
