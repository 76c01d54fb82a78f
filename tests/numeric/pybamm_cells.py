"""Cells of PyBaMM as a laboratory would measure them: slow test, pulses at 25 and 40 degC, a test day, races.

Needs the extra `voltwall[pybamm]`. The physics is a single-particle model with electrolyte and lumped heat, or the
full Doyle-Fuller-Newman model; neither has a resistor, an RC pair or a table in it.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from app.estimation.recording.cell_recording import Recording

FloatArray = NDArray[np.float64]

KELVIN = 273.15
RACE_DT_S = 0.1
PULSE_DT_S = 1.0
SLOW_DT_S = 60.0
HOLD_AT, HOLD_A = "held from [s]", "held [A]"
SURGE_C, POWER_ROUNDS = 50.0, 13
BEYOND_V: Final = 1.0  # a simulation ends so far below the lowest voltage
REGENERATION = 0.3  # of the peak current


@dataclass(frozen=True)
class Cell:
    """A parameter set of PyBaMM and how hard it is driven.

    Attributes:
        name: of the parameter set.
        capacity_ah: charge between its voltage limits, by a C/30 discharge [Ah].
        peak_c: largest current of a race, in C.
        mean_c: mean of it, in C.
        is_isothermal: whether the parameter set has no heat.
    """

    name: str
    capacity_ah: float
    peak_c: float
    mean_c: float
    is_isothermal: bool = False


CELLS = {
    cell.name: cell
    for cell in (
        Cell("Mohtat2020", 4.969, 5.0, 1.3),
        Cell("Chen2020", 5.153, 5.5, 1.25),
        Cell("Prada2013", 2.303, 6.0, 1.3, is_isothermal=True),
        Cell("Ecker2015", 0.1710, 5.0, 1.2),
        Cell("Ai2020", 2.4649, 5.0, 1.2),
    )
}


def _parameters(cell: Cell, soc: float, degc: float) -> tuple[Any, float]:
    """Return PyBaMM's parameters at a SOC and temperature, and the charge between the voltage limits at rest [Ah]."""
    os.environ.setdefault("PYBAMM_DISABLE_TELEMETRY", "true")
    import pybamm

    values = pybamm.ParameterValues(cell.name)
    low, high = values["Lower voltage cut-off [V]"], values["Upper voltage cut-off [V]"]
    values.set_initial_state(soc)
    values.update(
        {
            "Ambient temperature [K]": degc + KELVIN,
            "Initial temperature [K]": degc + KELVIN,
            "Total heat transfer coefficient [W.m-2.K-1]": 30.0,
            "Lower voltage cut-off [V]": low - BEYOND_V,
            "Upper voltage cut-off [V]": high + 0.5,
        },
        check_already_exists=False,
    )
    electrodes, parameters = pybamm.lithium_ion.get_min_max_stoichiometries(values), pybamm.LithiumIonParameters()
    return values, float(values.evaluate(parameters.n.Q_init)) * (electrodes[1] - electrodes[0])


def _simulation(cell: Cell, values: Any, current_a: FloatArray, dt_s: float, full: bool) -> Any:
    """Return PyBaMM's simulation of a current, held from `HOLD_AT` on at `HOLD_A`."""
    import pybamm

    drawn = pybamm.Interpolant(dt_s * np.arange(current_a.size), current_a, pybamm.t)
    at_s, held_a = pybamm.InputParameter(HOLD_AT), pybamm.InputParameter(HOLD_A)
    values["Current function [A]"] = drawn * (pybamm.t <= at_s) + held_a * (pybamm.t > at_s)
    kind = pybamm.lithium_ion.DFN if full else pybamm.lithium_ion.SPMe
    longest_s = 20.0 if dt_s >= SLOW_DT_S else 2.0 if dt_s >= PULSE_DT_S else 0.5
    return pybamm.Simulation(
        kind(None if cell.is_isothermal else {"thermal": "lumped"}),
        parameter_values=values,
        solver=pybamm.IDAKLUSolver(options={"dt_max": longest_s}),
    )


def simulate(
    cell: Cell, current_a: FloatArray, dt_s: float, soc: float, degc: float, full: bool, name: str
) -> Recording:
    """Return what a rig would have recorded of a current, until the cell falls 50 mV below its limit.

    Args:
        cell: which cell.
        current_a: (n,) positive on discharge [A], every dt_s.
        dt_s: [s].
        soc: at the start, at rest, as a share of the charge between the voltage limits at rest. The recording's soc
            column counts over the cell's capacity instead, from a full cell, as a laboratory does.
        degc: of the surroundings and of the cell at the start [degC].
        full: the Doyle-Fuller-Newman model instead of single particles with electrolyte.
        name: of the recording.

    Raises:
        ImportError: PyBaMM is not installed.
    """
    values, at_rest_ah = _parameters(cell, soc, degc)
    low = values["Lower voltage cut-off [V]"] + BEYOND_V
    time_s = dt_s * np.arange(current_a.size)
    simulation = _simulation(cell, values, current_a, dt_s, full)
    solution = simulation.solve(t_eval=[0.0, float(time_s[-1])], t_interp=time_s, inputs={HOLD_AT: 1e9, HOLD_A: 0.0})
    time_s = time_s[time_s <= solution.t[-1]]
    voltage = np.asarray(solution["Voltage [V]"](t=time_s))
    current = np.asarray(solution["Current [A]"](t=time_s))
    kelvin = np.asarray(solution["Volume-averaged cell temperature [K]"](t=time_s))
    drawn = np.concatenate(([0.0], np.cumsum(0.5 * (current[1:] + current[:-1]) * dt_s))) / 3600.0
    drawn_before = (1.0 - soc) * at_rest_ah
    below = np.flatnonzero(voltage < low - 0.05)
    stop = int(below[0]) if below.size else time_s.size
    columns: tuple[FloatArray, ...] = (
        time_s,
        current,
        voltage,
        kelvin - KELVIN,
        1.0 - (drawn_before + drawn) / cell.capacity_ah,
    )
    time_s, current, voltage, degrees, truth = (column[:stop] for column in columns)
    return Recording(name, time_s, current, voltage, degrees, truth, notes=())


def held(levels: list[tuple[float, float]], dt_s: float) -> FloatArray:
    """Return the samples of (level, seconds) one after the other."""
    return np.concatenate([np.full(max(round(seconds / dt_s), 1), level) for level, seconds in levels])


def slow_test(cell: Cell, full: bool) -> Recording:
    """C/30 discharge down to the lowest voltage, an hour of rest, C/30 charge."""
    c, name = cell.capacity_ah, f"{cell.name} slow"
    down = held([(0.0, 60.0), (c / 30.0, 33.0 * 3600.0)], SLOW_DT_S)
    emptied = simulate(cell, down, SLOW_DT_S, 1.0, 25.0, full, name)
    again = held([(0.0, 3600.0), (-c / 30.0, 29.5 * 3600.0)], SLOW_DT_S)
    current = np.concatenate((down[: emptied.time_s.size - 1], again))
    return simulate(cell, current, SLOW_DT_S, 1.0, 25.0, full, name)


def pulse_test(cell: Cell, degc: float, full: bool) -> Recording:
    """Ten seconds of discharge and of charge at every tenth of the charge, half an hour of rest before each."""
    c = cell.capacity_ah
    levels = [(0.0, 20.0)]
    for k in range(9):
        levels += [(0.66 * cell.peak_c * c, 10.0), (0.0, 60.0), (-REGENERATION * cell.peak_c * c * (k > 0), 10.0)]
        levels += [(0.0, 60.0), (c, 330.0), (0.0, 1800.0)]
    return simulate(cell, held(levels, PULSE_DT_S), PULSE_DT_S, 1.0, degc, full, f"{cell.name} pulses {degc:g} degC")


def race_current(cell: Cell, seed: int, seconds: float = 1600.0) -> FloatArray:
    """Return (n,) the current of laps [A] at 10 Hz: bursts, braking, coasting; 20 s of rest before, 60 s after."""
    rng = np.random.default_rng(seed)
    peak = cell.peak_c
    lap: list[tuple[float, float]] = []
    while sum(duration for _, duration in lap) < 62.0:
        lap.append((peak * rng.uniform(0.3, 1.0), rng.choice([0.8, 1.2, 1.8, 2.5, 3.5])))
        lap.append((0.0, 0.3))
        lap.append((-peak * REGENERATION * rng.uniform() * float(rng.random() < 0.5), rng.uniform(0.8, 2.5)))
        lap.append((peak * rng.uniform(0.05, 0.25), rng.uniform(0.5, 2.5)))
    shape = held(lap, RACE_DT_S)
    shape = np.clip(shape * cell.mean_c / shape.mean(), -REGENERATION * peak, peak)
    laps = [np.zeros(200)]
    while sum(part.size for part in laps) < seconds / RACE_DT_S - 600:
        laps.append(shape * rng.uniform(0.92, 1.08, shape.size) * rng.uniform(0.9, 1.1))
    current = np.concatenate([*laps, np.zeros(600)])
    return cell.capacity_ah * np.convolve(current, np.ones(3) / 3.0, "same")


def race(cell: Cell, seed: int, soc: float, degc: float, full: bool) -> Recording:
    """A race that starts at rest."""
    return simulate(cell, race_current(cell, seed), RACE_DT_S, soc, degc, full, f"{cell.name} race {seed}")


def held_power(
    cell: Cell, seed: int, soc: float, degc: float, full: bool, at_s: FloatArray, horizons_s: tuple[float, ...]
) -> FloatArray:
    """Return (m, 2 + horizons) moments of the race [s], the cell's lowest voltage [V], and powers that it holds [W].

    Held for each horizon: that of the largest constant current that does not take the voltage below the lowest, at its
    end; found by bisection up to `SURGE_C`. Arguments as in `race`.

    Raises:
        ImportError: PyBaMM is not installed.
    """
    values, _ = _parameters(cell, soc, degc)
    import pybamm

    low = values["Lower voltage cut-off [V]"] + BEYOND_V
    simulation = _simulation(cell, values, race_current(cell, seed), RACE_DT_S, full)
    free, rows, state, before_s = {HOLD_AT: 1e9, HOLD_A: 0.0}, [], None, 0.0
    for now_s in at_s.tolist():
        state = simulation.step(now_s - before_s, starting_solution=state, inputs=free, save=False)
        before_s, row = now_s, [now_s, low]
        for horizon_s in horizons_s:
            held_w, least_a, most_a = 0.0, 0.0, SURGE_C * cell.capacity_ah
            for _ in range(POWER_ROUNDS):
                trial_a = 0.5 * (least_a + most_a)
                try:
                    ahead = simulation.step(
                        horizon_s, starting_solution=state, inputs={HOLD_AT: now_s, HOLD_A: trial_a}, save=False
                    )
                    volts, lasted_s = ahead["Voltage [V]"].entries[1:], ahead.t[-1] - now_s
                except pybamm.SolverError:
                    volts, lasted_s = np.zeros(1), 0.0
                if lasted_s >= 0.999 * horizon_s and volts.min() >= low:
                    least_a, held_w = trial_a, trial_a * float(volts[-1])
                else:
                    most_a = trial_a
            row.append(held_w)
        rows.append(row)
    return np.array(rows)


def save(recording: Recording, path: Path) -> None:
    """Write a recording as CSV, gzip where the name ends in it."""
    table = np.column_stack(
        (recording.time_s, recording.current_a, recording.voltage_v, recording.temperature_degc, recording.soc)
    )
    header = "time_s,current_a,voltage_v,temperature_c,soc"
    np.savetxt(path, table, "%.6g", ",", header=header, comments="")
