"""N cells stepped at once: charge, hysteresis, RC ladder, terminal voltage and the heat of every loss.

Current comes in, voltage and heat go out; temperatures are given by `simulator.thermal`. Time integration is exact for
a current that is constant over the step (exponentials, not differences), so no step length is unstable.
"""

from __future__ import annotations

import numpy as np
from numpy import add, arcsinh, copysign, expm1, minimum, multiply, subtract

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
_TURN, _OHMIC, _TRANSFER = range(3)  # drops after those of the RC pairs


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
        self.voltage_v = np.empty(n)
        self.ocv_v = np.empty(n)
        self._resistances_ohm = np.empty((2 + self.n_pairs, n))
        self.ohmic_ohm = self._resistances_ohm[0]
        self.charge_transfer_ohm = self._resistances_ohm[1]
        self.rc_ohm = self._resistances_ohm[2:]
        self.entropy_v_per_k = np.empty(n)
        self._rc_f = np.repeat(np.asarray(model.rc_f)[:, None], n, axis=1)
        self._capacity_coulomb = np.full(n, model.capacity_ah * SECONDS_PER_HOUR)
        self._ocv_soc, self._ocv_table = model.equilibrium()
        tables = (model.ohmic_ohm, model.charge_transfer_ohm, *model.rc_ohm, model.entropy_v_per_k)
        self._tables = np.stack([table.at(model.soc_grid) for table in tables])
        self._activation_j_per_mol = np.array(
            [[model.ohmic_j_per_mol], [model.charge_transfer_j_per_mol], *[[model.rc_j_per_mol]] * self.n_pairs]
        )
        self._wasted_per_amp = 1.0 - model.coulombic_efficiency
        self._dt_s = -1.0
        self._n_steps = 0
        self._allocate_work()
        self.refresh(np.full(n, REFERENCE_DEGC), np.full(n, model.capacity_ah), np.ones(n))
        self._stored_j = self.stored_energy_j()
        self.rest_at(self.soc)

    @property
    def hysteresis_v(self) -> FloatArray:
        """(n,) offset of each cell's equilibrium voltage from the mean of the branches [V]."""
        offset_v: FloatArray = -self._drop_v[self.n_pairs + _TURN]
        return offset_v

    def rest_at(self, soc: FloatArray | float) -> None:
        """Set the (n,) SOC with everything relaxed and half way between the branches of the OCV."""
        self.soc[:] = soc
        self._drop_v[:] = 0.0
        self.ocv_v[:] = np.interp(self.soc, self._ocv_soc, self._ocv_table)
        self.voltage_v[:] = self.ocv_v
        self.take_heat_j()

    def _allocate_work(self) -> None:
        """Lay out the drops: each relaxes towards what the current drives it to, v' = v + closing (v - driven).

        RC pairs first, then hysteresis, the ohmic drop and that of charge transfer, which have no memory.
        """
        n, pairs = self.n_cells, self.n_pairs
        n_drops = pairs + 3
        self._drop_v = np.zeros((n_drops, n))
        self._kept_v = self._drop_v[: pairs + 1]
        self.rc_v = self._drop_v[:pairs]
        self._closing = np.full((2, n_drops, n), -1.0)
        self._closing_end, self._closing_mean = self._closing
        self._turn_closing = self._closing_end[pairs + _TURN]
        self._per_amp = np.empty((n_drops + 1, n))
        self._driven = np.empty((n_drops + 1, n))
        self._driven_v = self._driven[:n_drops]
        self._driven_turn = self._driven[pairs + _TURN]
        self._driven_transfer = self._driven[pairs + _TRANSFER]
        self._driven_soc = self._driven[n_drops]
        self._away_v = np.empty((n_drops, n))
        self._stepped_v = np.empty((2, n_drops, n))
        self._end_v, self._mean_v = self._stepped_v
        self._kept_end_v = self._end_v[: pairs + 1]
        self._turned_v = self._end_v[pairs + _TURN]
        self._sum_v = np.empty((2, n))
        self._sum_end_v, self._sum_mean_v = self._sum_v
        self._asinh_v = np.empty(n)
        self._hysteresis_limit_v = np.full(n, self.model.hysteresis_v)
        self._negative = np.full(n, -1.0)
        self._work = np.empty(n)
        self._charging_a = np.empty(n)
        self._charging_w = np.zeros(n)  # into the equilibrium, waste included
        self._wasted_soc = np.empty(n)  # an ampere and step
        self._zeros = np.zeros(n)
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
        self._settle()
        np.multiply(capacity_ah, SECONDS_PER_HOUR, out=self._capacity_coulomb)
        np.multiply(self._capacity_coulomb, self.model.hysteresis_soc, out=self._turning_coulomb)
        if self._dt_s >= 0.0:
            self._prepare(self._dt_s)

    def _prepare(self, dt_s: float) -> None:
        """Lay out what depends on the step length: v_end = v + (a-1) (v - R i), v_mean = v + (g-1) (v - R i)."""
        self._dt_s = dt_s
        pairs = self.n_pairs
        end, mean = self._closing[:, :pairs]  # current at the step's end, and its mean
        if dt_s > 0.0:
            x = dt_s / (self.rc_ohm * self._rc_f)
            np.expm1(-x, out=end)
            # g = (1 - exp(-x)) / x
            np.divide(end, np.negative(x, out=x), out=mean)
            np.subtract(mean, 1.0, out=mean)
        else:
            end[:] = mean[:] = 0.0
        per_amp = self._per_amp
        per_amp[:pairs] = self.rc_ohm
        np.divide(dt_s, self._turning_coulomb, out=per_amp[pairs + _TURN])
        per_amp[pairs + _OHMIC] = self.ohmic_ohm
        np.divide(self.charge_transfer_ohm, self._asinh_v, out=per_amp[pairs + _TRANSFER])
        np.divide(dt_s, self._capacity_coulomb, out=per_amp[-1])
        np.multiply(per_amp[-1], self._wasted_per_amp, out=self._wasted_soc)

    def step(self, dt_s: float, current_a: FloatArray, *, is_charging: bool = False) -> None:
        """Advance by `dt_s` >= 0 with a current that is constant over the step; afterwards `voltage_v` is up to date.

        RC pair: v' = (R i - v) / (R C). Hysteresis, with h the drop below the mean OCV and k Q the charge that turns
        it: h' = |i| (h_max sign i - h) / (k Q). Its loss is |i| h^2 / h_max and its store k Q h^2 / (2 h_max), whose
        sum is the power i h at every instant, so no closed loop can yield energy.

        Args:
            dt_s: length of the step [s].
            current_a: (n,) current through each cell, positive on discharge [A].
            is_charging: some cell may be charged: of what flows into it the coulombic efficiency arrives.
        """
        if dt_s != self._dt_s:
            self._settle()
            self._prepare(dt_s)
        work, heat_w, turn_v = self._work, self._heat_w, self._driven_turn
        drop_v, away_v, end_v, mean_v = self._drop_v, self._away_v, self._end_v, self._mean_v
        is_wasting = is_charging and self._wasted_per_amp > 0.0

        multiply(self._per_amp, current_a, self._driven)
        if is_wasting:
            minimum(current_a, self._zeros, out=self._charging_a)
            multiply(self._charging_a, self._wasted_soc, work)
            subtract(self._driven_soc, work, self._driven_soc)
        subtract(self.soc, self._driven_soc, self.soc)
        self.ocv_v[:] = np.interp(self.soc, self._ocv_soc, self._ocv_table)
        if is_wasting:
            multiply(self.ocv_v, self._charging_a, work)
            subtract(self._charging_w, work, self._charging_w)

        copysign(turn_v, self._negative, work)
        expm1(work, self._turn_closing)
        copysign(self._hysteresis_limit_v, current_a, turn_v)
        arcsinh(self._driven_transfer, self._driven_transfer)
        multiply(self._driven_transfer, self._asinh_v, self._driven_transfer)

        subtract(drop_v, self._driven_v, away_v)
        multiply(self._closing_end, away_v, end_v)
        # i h dt = |i| h_max dt - sign(i) k Q dh
        multiply(self._turned_v, turn_v, work)
        subtract(self._turned_v2, work, self._turned_v2)
        add(end_v, drop_v, end_v)
        multiply(self._closing_mean, away_v, mean_v)
        add(mean_v, drop_v, mean_v)
        self._kept_v[:] = self._kept_end_v
        add.reduce(self._stepped_v, 1, out=self._sum_v)
        subtract(self.ocv_v, self._sum_end_v, self.voltage_v)
        multiply(self._sum_mean_v, current_a, work)
        add(heat_w, work, heat_w)
        self._n_steps += 1

    def stored_energy_j(self) -> FloatArray:
        """Return (n,) energy held by the capacitances and by hysteresis [J]."""
        stored: FloatArray = 0.5 * (self._rc_f * self.rc_v**2).sum(axis=0)
        if self.model.hysteresis_v > 0.0:
            stored += 0.5 * self._turning_coulomb / self.model.hysteresis_v * self.hysteresis_v**2
        return stored

    def chemical_energy_j(self) -> FloatArray:
        """Return (n,) energy of the equilibrium curve from an empty cell, which holds none, to the present SOC [J]."""
        soc, volts = self._ocv_soc, self._ocv_table
        below = np.concatenate(([0.0], np.cumsum(0.5 * (volts[1:] + volts[:-1]) * np.diff(soc))))
        left = np.clip(np.searchsorted(soc, self.soc, side="right") - 1, 0, len(soc) - 2)
        inside = np.clip(self.soc, soc[0], soc[-1]) - soc[left]
        slope_v = (volts[left + 1] - volts[left]) / (soc[left + 1] - soc[left])
        area = below[left] + inside * volts[left] + 0.5 * inside**2 * slope_v
        area += np.maximum(self.soc - soc[-1], 0.0) * volts[-1]
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
            self._loss_j += (self._heat_w + self._wasted_per_amp * self._charging_w) * self._dt_s
            if self.model.hysteresis_v > 0.0:
                self._loss_j += self._turned_v2 * (self._turning_coulomb / self.model.hysteresis_v)
            self._heat_w[:] = 0.0
            self._charging_w[:] = 0.0
            self._turned_v2[:] = 0.0
            self._n_steps = 0
