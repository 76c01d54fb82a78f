"""The accumulator: cells in series with their joints, bleed resistors, leaks and heat, and the faults they can have.

A load or charger gives the current, `step` advances everything, the arrays say what sensors would see and what is true.
No sensor error, no protocol and no clock here.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
from numpy import add, multiply, subtract

from simulator.cell import SECONDS_PER_HOUR, CellArray
from simulator.cell_data import EMPTY_SOC, SAMSUNG_25R_10P, ZERO_DEGC_IN_K, BoolArray, CellModel, FloatArray
from simulator.errors import ParameterError
from simulator.thermal import ThermalNetwork, ThermalParameters

_SELF_DISCHARGE_SPREAD_LIMIT = 3.0  # times the mean
_TIME_TOLERANCE_S = 1e-9  # rounding of ten steps of 0.1 s against one second


@dataclass(frozen=True)
class AccumulatorParameters:
    """Parameters of the accumulator. Spreads are relative standard deviations over cells, but for the start SOC."""

    n_cells: int = 96
    cells_per_pack: int = 12
    packs: tuple[int, ...] = ()  # cells of each, where they are not all of `cells_per_pack`
    start_soc: float | npt.ArrayLike = 0.9
    ambient_degc: float = 25.0
    start_degc: float | None = None  # temperature of the cells; the ambient when left out
    cell: CellModel = SAMSUNG_25R_10P
    capacity_spread: float = 0.01
    resistance_spread: float = 0.03
    start_soc_spread: float = 0.004  # absolute
    self_discharge_spread: float = 0.5
    joint_resistance_ohm: float = 3.5e-4  # fuses, welds and the busbar inside one cell's measuring span
    joint_spread: float = 0.08
    path_resistance_ohm: float = 0.025  # relays, main fuse, cables between packs: outside every cell's span
    bleed_ohm: float = 23.5  # two 47 ohm resistors in parallel
    bleed_heat_in_cell: float = 0.0  # part of a bleed resistor's heat that goes into its own cell, not the board
    capacity_ageing: float | npt.ArrayLike = 1.0  # present over new capacity, one number or one per cell
    resistance_ageing: float | npt.ArrayLike = 1.0
    thermal: ThermalParameters = field(default_factory=ThermalParameters)
    slow_period_s: float = 1.0  # period of temperatures and resistances; 0: at every step

    def __post_init__(self) -> None:
        if self.n_cells < 1:
            raise ParameterError("n_cells", self.n_cells, "at least 1")
        for name in ("bleed_ohm", "capacity_ageing", "resistance_ageing"):
            if not (np.asarray(getattr(self, name)) > 0.0).all():
                raise ParameterError(name, getattr(self, name), "must be positive")
        if self.packs and sum(self.packs) != self.n_cells:
            raise ParameterError("packs", self.packs, f"{self.n_cells} cells together")
        if np.shape(self.start_soc) not in ((), (self.n_cells,)):
            raise ParameterError("start_soc", np.shape(self.start_soc), "one number or one per cell")


class Accumulator:
    """N cells in series. Public arrays are (n_cells,), current is positive on discharge.

    To be changed at run time, by writing into them: `extra_joint_ohm`, `capacity_factor`, `resistance_factor`,
    `short_s` (conductance of a short inside the cell [S]), `heat_w` (from outside), `ambient_degc`, `sun_w`,
    `fan_blocked` (0..1). Joints and heat count at once, the others from the next slow period on.
    """

    def __init__(self, parameters: AccumulatorParameters, rng: np.random.Generator) -> None:
        self.parameters = p = parameters
        n = p.n_cells
        self.n_cells = n
        capacity_spread = _spread(rng, n, p.capacity_spread)
        resistance_spread = _spread(rng, n, p.resistance_spread)
        self._joint_ohm = p.joint_resistance_ohm * _spread(rng, n, p.joint_spread)
        soc = np.clip(np.asarray(p.start_soc) + p.start_soc_spread * rng.standard_normal(n), 0.0, 1.0)
        self_discharge = np.clip(
            1.0 + p.self_discharge_spread * rng.standard_normal(n), 0, _SELF_DISCHARGE_SPREAD_LIMIT
        )
        self._self_discharge_a = p.cell.self_discharge_a * self_discharge
        self._new_capacity_ah = p.cell.capacity_ah * capacity_spread
        self._new_resistance = resistance_spread
        self.age(np.asarray(p.capacity_ageing), np.asarray(p.resistance_ageing))
        self.passed_ah = 0.0  # through the string so far, out and in together

        self.ambient_degc = p.ambient_degc
        self.sun_w = 0.0
        self.fan_blocked: float = 0.0
        self.extra_joint_ohm = np.zeros(n)
        self.capacity_factor = np.ones(n)
        self.resistance_factor = np.ones(n)
        self.short_s = np.zeros(n)
        self.heat_w = np.zeros(n)

        self._cells = CellArray(p.cell, n)
        self._thermal = ThermalNetwork(
            replace(p.thermal, cells_per_pack=p.cells_per_pack),
            np.full(n, p.cell.heat_capacity_j_per_k),
            p.ambient_degc if p.start_degc is None else p.start_degc,
            p.packs,
        )
        self._capacity_ah = np.empty(n)
        self._measured_v = np.empty(n)
        self._sum_v: float | None = None  # sum of `_measured_v`, once used
        self._outlet_v: float | None = None
        self._short_now_s = np.zeros(n)
        self._leak_a = np.zeros(n)
        self._string_a = np.zeros(n)
        self._cell_a = np.zeros(n)
        self._bleed_a = np.zeros(n)
        self._bleed_j = np.zeros(n)
        self._leak_j = np.zeros(n)
        self._work = np.empty(n)
        self._slow_soc = np.empty(n)
        self._joint_now_ohm = np.empty(n)
        self._bleed_s = np.full(n, 1.0 / p.bleed_ohm)
        self._pack = np.repeat(np.arange(self._thermal.n_packs), self._thermal.packs)
        self._is_bleeding = False
        self._is_leaking = False
        self._current2_s = 0.0
        self._elapsed_s = 0.0
        self.current_a = 0.0
        self.loss_energy_j = 0.0  # all irreversible heat so far, bleeding included
        self.bleed_energy_j = 0.0
        self.reversible_energy_j = 0.0

        self.terminal_voltage_v = _read_only(self._measured_v)
        self.temperature_degc = _read_only(self._thermal.cell_degc)
        self.board_temperature_degc = _read_only(self._thermal.board_degc)
        self.soc = _read_only(self._cells.soc)
        self.ocv_v = _read_only(self._cells.ocv_v)
        self.capacity_ah = _read_only(self._capacity_ah)
        self.bleed_current_a = _read_only(self._bleed_a)
        self._cells.rest_at(soc)
        self._measured_v[:] = self._cells.voltage_v
        self._refresh()

    @property
    def voltage_v(self) -> float:
        """Sum of the measured cell voltages, joints included [V]."""
        if self._sum_v is None:
            self._sum_v = float(add.reduce(self._measured_v))
        return self._sum_v

    @property
    def outlet_voltage_v(self) -> float:
        """Voltage at the accumulator's terminals: `voltage_v` less the drop over relays, fuse and cables [V]."""
        if self._outlet_v is None:
            self._outlet_v = self.voltage_v - self.current_a * self.parameters.path_resistance_ohm
        return self._outlet_v

    @property
    def resistance_ohm(self) -> FloatArray:
        """(n_cells,) instantaneous resistance as a tester would find it across cell and joint [ohm]."""
        total: FloatArray = self._cells.ohmic_ohm + self._cells.charge_transfer_ohm + self._joint_now_ohm
        return total

    def step(
        self,
        dt_s: float,
        current_a: float,
        *,
        bleeding: BoolArray | FloatArray | None = None,
        cell_current_a: FloatArray | None = None,
        balancer_heat_w: FloatArray | None = None,
        fan_duty: float = 0.0,
    ) -> None:
        """Advance by `dt_s` with everything given held constant.

        Args:
            dt_s: length of the step, >= 0 [s].
            current_a: current through the string [A].
            bleeding: (n_cells,) whether each cell's bleed resistor is on, or for which part of the step (0..1).
            cell_current_a: (n_cells,) what a balancer draws from each cell besides, negative to charge it [A].
            balancer_heat_w: (n_cells,) what its switches lose, as warm as a bleed resistor [W].
            fan_duty: 0..1.

        Raises:
            ParameterError: dt_s is negative or not finite.
        """
        if not 0.0 <= dt_s < np.inf:
            raise ParameterError("dt_s", dt_s, "a step is finite and not negative")
        cells, measured = self._cells, self._measured_v
        string_a = self._string_a
        string_a.fill(current_a)
        cell_a = string_a
        if self._is_leaking:
            self._leak(dt_s)
            cell_a = add(self._leak_a, string_a, self._cell_a)
        if bleeding is not None:
            multiply(measured, bleeding, self._bleed_a)
            multiply(self._bleed_a, self._bleed_s, self._bleed_a)
            cell_a = add(cell_a, self._bleed_a, self._cell_a)
            self._is_bleeding = True
        elif self._is_bleeding:
            self._bleed_a[:] = 0.0
            self._is_bleeding = False
        if cell_current_a is not None:
            cell_a = add(cell_a, cell_current_a, self._cell_a)

        cells.step(dt_s, cell_a, is_charging=current_a < 0.0 or cell_current_a is not None)
        if self._is_bleeding:
            multiply(self._bleed_a, cells.voltage_v, self._work)
            self._work *= dt_s
            add(self._bleed_j, self._work, self._bleed_j)
        if balancer_heat_w is not None:
            self._bleed_j += balancer_heat_w * dt_s
        if self._is_leaking:
            multiply(self._leak_a, cells.voltage_v, self._work)
            multiply(self._work, dt_s, self._work)
            add(self._leak_j, self._work, self._leak_j)
        multiply(self._joint_now_ohm, string_a, self._work)
        subtract(cells.voltage_v, self._work, measured)
        self._sum_v = self._outlet_v = None
        self.current_a = current_a
        self._current2_s += current_a * current_a * dt_s
        self._elapsed_s += dt_s
        self.passed_ah += abs(current_a) * dt_s / SECONDS_PER_HOUR
        if self._elapsed_s >= self.parameters.slow_period_s - _TIME_TOLERANCE_S and self._elapsed_s > 0.0:
            self._slow_step(fan_duty)

    def age(self, capacity: FloatArray, resistance: FloatArray) -> None:
        """Set present over new capacity and resistance, (n_cells,) or one number, from the next slow period on."""
        self._built_capacity_ah = self._new_capacity_ah * capacity
        self._built_resistance = self._new_resistance * resistance

    def chemical_energy_j(self) -> float:
        """Energy that the cells can give at equilibrium, counted from where an empty cell has collapsed to 0 V [J]."""
        return float(self._cells.chemical_energy_j().sum())

    def stored_energy_j(self) -> float:
        """Energy held by RC pairs and hysteresis, which comes back as heat or work [J]."""
        return float(self._cells.stored_energy_j().sum())

    def _leak(self, dt_s: float) -> None:
        """Find what shorts draw at the last voltage, in a long step no more than empties the cell."""
        multiply(self._cells.voltage_v, self._short_now_s, self._leak_a)
        if dt_s > 0.0:
            left_coulomb = np.maximum(self._cells.soc - EMPTY_SOC, 0.0) * (self._capacity_ah * SECONDS_PER_HOUR)
            np.minimum(self._leak_a, left_coulomb / dt_s, out=self._leak_a)

    def _slow_step(self, fan_duty: float) -> None:
        """Turn the losses gathered since the last time into temperatures, then look resistances up again."""
        elapsed_s, n = self._elapsed_s, self.n_cells
        cells, thermal = self._cells, self._thermal
        capacity_coulomb = self._capacity_ah * SECONDS_PER_HOUR
        moved_coulomb = (self._slow_soc - cells.soc) * capacity_coulomb
        reversible_j = -moved_coulomb * (self.temperature_degc + ZERO_DEGC_IN_K) * cells.entropy_v_per_k
        self_discharged_coulomb = self._self_discharge_a * elapsed_s
        cells.soc -= self_discharged_coulomb / capacity_coulomb
        loss_j = cells.take_heat_j() + self._leak_j + self_discharged_coulomb * cells.ocv_v
        loss_j += self._current2_s * self._joint_now_ohm

        # A step a little longer than the period keeps the period, so that the matrix of the network is found again.
        period_s = self.parameters.slow_period_s
        thermal_s = period_s if elapsed_s < 2.0 * period_s else elapsed_s
        in_cell = self.parameters.bleed_heat_in_cell
        board_j = np.bincount(self._pack, (1.0 - in_cell) * self._bleed_j, thermal.n_packs)
        node_j = np.concatenate((loss_j + reversible_j + in_cell * self._bleed_j, board_j))
        node_w = node_j / thermal_s
        node_w[:n] += self.heat_w + self.sun_w / n
        thermal.step(thermal_s, node_w, self.ambient_degc, fan_duty * (1.0 - self.fan_blocked))

        self.loss_energy_j += float(loss_j.sum() + self._bleed_j.sum())
        self.bleed_energy_j += float(self._bleed_j.sum())
        self.reversible_energy_j += float(reversible_j.sum())
        self._bleed_j[:] = 0.0
        self._leak_j[:] = 0.0
        self._current2_s = 0.0
        self._elapsed_s -= thermal_s
        self._refresh()

    def _refresh(self) -> None:
        self._capacity_ah[:] = self._built_capacity_ah * self.capacity_factor
        self._cells.refresh(self.temperature_degc, self._capacity_ah, self._built_resistance * self.resistance_factor)
        add(self._joint_ohm, self.extra_joint_ohm, self._joint_now_ohm)
        self._short_now_s[:] = self.short_s
        self._is_leaking = bool(self.short_s.any())
        if not self._is_leaking:
            self._leak_a[:] = 0.0
        self._slow_soc[:] = self._cells.soc


def _spread(rng: np.random.Generator, n: int, relative: float) -> FloatArray:
    """Return (n,) factors around 1, none further out than three standard deviations."""
    factors: FloatArray = 1.0 + relative * np.clip(rng.standard_normal(n), -3.0, 3.0)
    return factors


def _read_only(array: FloatArray) -> FloatArray:
    view = array.view()
    view.flags.writeable = False
    return view
