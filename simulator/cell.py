"""N cells stepped at once: charge, hysteresis, RC ladder, terminal voltage and the heat of every loss.

Current comes in, voltage and heat go out; temperatures are given by `simulator.thermal`. Time integration is exact for
a current that is constant over the step (exponentials, not differences), so no step length is unstable.
"""

from __future__ import annotations

import numpy as np
from numpy import abs as absolute
from numpy import add, arcsinh, copysign, copyto, expm1, multiply, subtract

from simulator.cell_data import (
    FARADAY_C_PER_MOL,
    GAS_CONSTANT_J_PER_MOL_K,
    OCV_GRID_POINTS,
    REFERENCE_DEGC,
    SOC_GRID_START,
    SOC_GRID_STOP,
    ZERO_DEGC_IN_K,
    CellModel,
    FloatArray,
)

SECONDS_PER_HOUR = 3600.0
_REFERENCE_K = REFERENCE_DEGC + ZERO_DEGC_IN_K
_SOC_STEP = (SOC_GRID_STOP - SOC_GRID_START) / (OCV_GRID_POINTS - 1)
_END, _MEAN = range(2)  # of a step


class CellArray:
    """The electrical state of n cells of one kind, each with its own capacity and resistance.

    Losses in the resistors become heat at once; what capacitors and hysteresis store is energy that comes back, see
    `stored_energy_j`. Resistances follow SOC and temperature whenever `refresh` is called.
    """

    def __init__(self, model: CellModel, n_cells: int) -> None:
        self.model = model
        self.n_cells = n = n_cells
        self.n_pairs = len(model.rc_f)
        self.soc = np.full(n, 0.5)
        self.hysteresis_v = np.zeros(n)
        self.rc_v = np.zeros((self.n_pairs, n))
        self.voltage_v = np.empty(n)
        self.ocv_v = np.empty(n)
        self._resistances_ohm = np.empty((2 + self.n_pairs, n))
        self.ohmic_ohm = self._resistances_ohm[0]
        self.charge_transfer_ohm = self._resistances_ohm[1]
        self.rc_ohm = self._resistances_ohm[2:]
        self.entropy_v_per_k = np.empty(n)
        self._rc_f = np.repeat(np.asarray(model.rc_f)[:, None], n, axis=1)
        self._capacity_coulomb = np.full(n, model.capacity_ah * SECONDS_PER_HOUR)
        self._soc_grid = model.soc_grid
        self._ocv_table = model.ocv_v.at(self._soc_grid)
        tables = (model.ohmic_ohm, model.charge_transfer_ohm, *model.rc_ohm, model.entropy_v_per_k)
        self._tables = np.stack([table.at(self._soc_grid) for table in tables])
        self._activation_j_per_mol = np.array(
            [[model.ohmic_j_per_mol], [model.charge_transfer_j_per_mol], *[[model.rc_j_per_mol]] * self.n_pairs]
        )
        self._has_charge_transfer = any(model.charge_transfer_ohm.value)
        self._wasted_per_amp = 1.0 - model.coulombic_efficiency
        self._dt_s = -1.0
        self._n_steps = 0
        self._allocate_work()
        self.refresh(np.full(n, REFERENCE_DEGC), np.full(n, model.capacity_ah), np.ones(n))
        self._stored_j = self.stored_energy_j()
        self.rest_at(self.soc)

    def rest_at(self, soc: FloatArray | float) -> None:
        """Set the (n,) SOC with everything relaxed and half way between the branches of the OCV."""
        self.soc[:] = soc
        self.rc_v[:] = 0.0
        self.hysteresis_v[:] = 0.0
        self.ocv_v[:] = np.interp(self.soc, self._soc_grid, self._ocv_table)
        self.voltage_v[:] = self.ocv_v
        self.take_heat_j()

    def _allocate_work(self) -> None:
        n, pairs = self.n_cells, self.n_pairs
        self._decay = np.empty((2, pairs, n))
        self._gain = np.empty((2, pairs, n))
        self._rc_pair = np.zeros((2, pairs, n))
        self._rc_drive = np.empty((2, pairs, n))
        self._rc_sum = np.empty((2, n))
        self._rc_end, self._rc_sum_end, self._rc_sum_mean = self._rc_pair[_END], self._rc_sum[_END], self._rc_sum[_MEAN]
        self._soc_per_amp = np.empty(n)
        self._soc_per_amp_charging = np.empty(n)
        self._turn_per_amp = np.empty(n)
        self._asinh_per_amp = np.empty(n)
        self._asinh_v = np.empty(n)
        self._loss_v = np.empty(n)
        self._work = np.empty(n)
        self._sign_v = np.empty(n)
        self._turn = np.empty(n)
        self._heat_w = np.zeros(n)
        self._turned_v2 = np.zeros(n)
        self._loss_j = np.zeros(n)
        self._turning_coulomb = np.empty(n)

    def refresh(self, temperature_degc: FloatArray, capacity_ah: FloatArray, resistance_scale: FloatArray) -> None:
        """Look resistances up again for the present SOC.

        Args:
            temperature_degc: (n,) cell temperatures [degC].
            capacity_ah: (n,) present capacities [Ah].
            resistance_scale: (n,) factor on every resistance, 1 for a new mean cell.
        """
        position = (self.soc - SOC_GRID_START) / _SOC_STEP
        np.clip(position, 0.0, OCV_GRID_POINTS - 1.0, out=position)
        looked_up = self._tables[:, position.astype(np.intp)]
        self.entropy_v_per_k[:] = looked_up[-1]
        kelvin = temperature_degc + ZERO_DEGC_IN_K
        inverse_rt = (1.0 / kelvin - 1.0 / _REFERENCE_K) / GAS_CONSTANT_J_PER_MOL_K
        np.multiply(self._activation_j_per_mol, inverse_rt, out=self._resistances_ohm)
        np.exp(self._resistances_ohm, out=self._resistances_ohm)
        np.multiply(self._resistances_ohm, looked_up[:-1], out=self._resistances_ohm)
        np.multiply(self._resistances_ohm, resistance_scale, out=self._resistances_ohm)
        # 2RT/F asinh(i R F / 2RT)
        np.multiply(kelvin, 2.0 * GAS_CONSTANT_J_PER_MOL_K / FARADAY_C_PER_MOL, out=self._asinh_v)
        np.divide(self.charge_transfer_ohm, self._asinh_v, out=self._asinh_per_amp)
        self._settle()
        np.multiply(capacity_ah, SECONDS_PER_HOUR, out=self._capacity_coulomb)
        np.multiply(self._capacity_coulomb, self.model.hysteresis_soc, out=self._turning_coulomb)
        if self._dt_s >= 0.0:
            self._prepare(self._dt_s)

    def _prepare(self, dt_s: float) -> None:
        """Lay out what depends on the step length: v_end = a v + (1-a) R i, v_mean = g v + (1-g) R i."""
        self._dt_s = dt_s
        if dt_s > 0.0:
            x = dt_s / (self.rc_ohm * self._rc_f)
            closing = np.expm1(-x)
            np.add(closing, 1.0, out=self._decay[_END])
            # g = (1 - exp(-x)) / x
            np.divide(closing, np.negative(x, out=x), out=self._decay[_MEAN])
        else:
            self._decay[:] = 1.0
        np.multiply(1.0 - self._decay, self.rc_ohm, out=self._gain)
        np.divide(dt_s, self._capacity_coulomb, out=self._soc_per_amp)
        np.multiply(self._soc_per_amp, self.model.coulombic_efficiency, out=self._soc_per_amp_charging)
        np.divide(-dt_s, self._turning_coulomb, out=self._turn_per_amp)

    def step(self, dt_s: float, current_a: FloatArray, *, is_charging: bool = False) -> None:
        """Advance by `dt_s` >= 0 with a current that is constant over the step; afterwards `voltage_v` is up to date.

        RC pair: v' = (R i - v) / (R C). Hysteresis, with h the offset from the mean OCV and k Q the charge that turns
        it: h' = -|i| (h + h_max sign i) / (k Q). Its loss is |i| h^2 / h_max and its store k Q h^2 / (2 h_max), whose
        sum is the power -i h at every instant, so no closed loop can yield energy.

        Args:
            dt_s: length of the step [s].
            current_a: (n,) current through each cell, positive on discharge [A].
            is_charging: the string is being charged, so the coulombic efficiency applies.
        """
        if dt_s != self._dt_s:
            self._settle()
            self._prepare(dt_s)
        work, loss_v, pair = self._work, self._loss_v, self._rc_pair

        multiply(current_a, self._soc_per_amp_charging if is_charging else self._soc_per_amp, work)
        subtract(self.soc, work, self.soc)
        copyto(self.ocv_v, np.interp(self.soc, self._soc_grid, self._ocv_table))
        if is_charging and self._wasted_per_amp > 0.0:
            multiply(self.ocv_v, current_a, work)
            multiply(work, self._wasted_per_amp, work)
            subtract(self._heat_w, work, self._heat_w)

        multiply(self._decay, self.rc_v, pair)
        multiply(self._gain, current_a, self._rc_drive)
        add(pair, self._rc_drive, pair)
        copyto(self.rc_v, self._rc_end)
        add.reduce(pair, 1, out=self._rc_sum)

        multiply(current_a, self.ohmic_ohm, loss_v)
        if self._has_charge_transfer:
            multiply(current_a, self._asinh_per_amp, work)
            arcsinh(work, work)
            multiply(work, self._asinh_v, work)
            add(loss_v, work, loss_v)
        subtract(self.ocv_v, loss_v, self.voltage_v)
        subtract(self.voltage_v, self._rc_sum_end, self.voltage_v)

        add(loss_v, self._rc_sum_mean, loss_v)
        if self.model.hysteresis_v > 0.0:
            self._turn_hysteresis(current_a)
        multiply(loss_v, current_a, loss_v)
        add(self._heat_w, loss_v, self._heat_w)
        self._n_steps += 1

    def _turn_hysteresis(self, current_a: FloatArray) -> None:
        work, turn, sign_v = self._work, self._turn, self._sign_v
        copysign(self.model.hysteresis_v, current_a, sign_v)
        # dh = (h + h_max sign i) (exp(-|i| dt / kQ) - 1)
        absolute(current_a, turn)
        multiply(turn, self._turn_per_amp, turn)
        expm1(turn, turn)
        add(self.hysteresis_v, sign_v, work)
        multiply(turn, work, turn)
        add(self.hysteresis_v, turn, self.hysteresis_v)
        add(self.voltage_v, self.hysteresis_v, self.voltage_v)
        # -i h dt = |i| h_max dt + sign(i) k Q dh
        add(self._loss_v, sign_v, self._loss_v)
        multiply(turn, sign_v, turn)
        add(self._turned_v2, turn, self._turned_v2)

    def predict(self, dt_s: float, current_a: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return what a step would lead to, without taking it: (n,) voltages [V] and -dV/di at that current [ohm].

        The slope leaves out hysteresis, which turns too little in a step to matter for a search.
        """
        if dt_s != self._dt_s:
            self._settle()
            self._prepare(dt_s)
        soc = self.soc - current_a * self._soc_per_amp
        position = np.clip((soc - SOC_GRID_START) / _SOC_STEP, 0.0, OCV_GRID_POINTS - 1.001).astype(np.intp)
        slope_v = (self._ocv_table[position + 1] - self._ocv_table[position]) / _SOC_STEP
        decay, gain = self._decay[_END], self._gain[_END]
        sign_v = np.copysign(self.model.hysteresis_v, current_a)
        turned_v = (self.hysteresis_v + sign_v) * np.exp(np.abs(current_a) * self._turn_per_amp) - sign_v
        scaled = current_a * self._asinh_per_amp
        voltage_v = (
            np.interp(soc, self._soc_grid, self._ocv_table)
            + turned_v
            - (decay * self.rc_v + gain * current_a).sum(axis=0)
            - current_a * self.ohmic_ohm
            - np.arcsinh(scaled) * self._asinh_v
        )
        slope_ohm = (
            slope_v * self._soc_per_amp
            + gain.sum(axis=0)
            + self.ohmic_ohm
            + self.charge_transfer_ohm / np.sqrt(1.0 + scaled**2)
        )
        return voltage_v, slope_ohm

    def stored_energy_j(self) -> FloatArray:
        """Return (n,) energy held by the capacitances and by hysteresis [J]."""
        stored: FloatArray = 0.5 * (self._rc_f * self.rc_v**2).sum(axis=0)
        if self.model.hysteresis_v > 0.0:
            stored += 0.5 * self._turning_coulomb / self.model.hysteresis_v * self.hysteresis_v**2
        return stored

    def chemical_energy_j(self) -> FloatArray:
        """Return (n,) energy of the equilibrium curve from the bottom of the SOC grid up to the present SOC [J]."""
        table = self._ocv_table
        below = np.concatenate(([0.0], np.cumsum(0.5 * (table[1:] + table[:-1]) * _SOC_STEP)))
        position = np.clip((self.soc - SOC_GRID_START) / _SOC_STEP, 0.0, OCV_GRID_POINTS - 1.0)
        left = np.minimum(position.astype(np.intp), OCV_GRID_POINTS - 2)
        inside = (position - left) * _SOC_STEP
        area = below[left] + inside * table[left] + 0.5 * inside**2 * (table[left + 1] - table[left]) / _SOC_STEP
        energy: FloatArray = area * self._capacity_coulomb
        return energy

    def take_heat_j(self) -> FloatArray:
        """Return (n,) heat of all losses since the last call [J] and start again from zero."""
        self._settle()
        stored = self.stored_energy_j()
        heat = self._loss_j - (stored - self._stored_j)
        self._stored_j = stored
        self._loss_j = np.zeros(self.n_cells)
        return heat

    def _settle(self) -> None:
        if self._n_steps:
            self._loss_j += self._heat_w * self._dt_s
            if self.model.hysteresis_v > 0.0:
                self._loss_j += self._turned_v2 * (self._turning_coulomb / self.model.hysteresis_v)
            self._heat_w[:] = 0.0
            self._turned_v2[:] = 0.0
            self._n_steps = 0
