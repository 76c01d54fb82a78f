"""Fits a cell model to measurements: slow tests for the OCV, pulses and drives for what current does.

For fixed time constants and activation energies the model is linear in everything else, so those few are searched and
the rest is solved for exactly, non-negative and robust. Arrays in, a `CellModel` and a report out; numpy alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import MAX_RC_PAIRS, CellModel
from app.estimation.errors import ModelError
from app.estimation.identification.cell_tables import (
    activation_energy,
    cell_model,
    ocv_shift,
    temperature_knots,
    typical_temperature,
)
from app.estimation.identification.design import REFERENCE_DEGC, branch_current
from app.estimation.identification.parts import (
    REST_CURRENT_C,
    OcvShift,
    Part,
    choose_capacity,
    has_soc_column,
    reference_soc,
    typical_resistance,
)
from app.estimation.identification.problem import ROBUST_ROUNDS, Problem, Solution
from app.estimation.identification.slow_tests import SlowCurves, read_slow
from app.estimation.recording.cell_recording import Recording, believable

RATED_C: Final = 4.0  # a race draws at least this much: pulses below it leave the fit without evidence
TAU_MIN_S: Final = 1.0
TAU_COUNT: Final = 7  # candidates, each twice the one before: 1 to 64 s at 10 Hz; slower states delay a cold start
JUDGED_SOC: Final = 0.05  # below, the voltage falls so fast that its error says nothing about the SOC
VOLTAGE_RMS_LIMIT_V: Final = 0.03  # above, estimates drift: see docs/explanation/identification.md
SOC_BEYOND: Final = 0.05  # a recording further beyond full or empty is not on the SOC axis
FLAT_V: Final = 0.15  # per unit of SOC: an OCV that rises less tells little
FLAT_SHARE: Final = 0.25  # of the range: less is a dip that a drive passes
SEARCHES: Final = 2  # of time constants: a coarse and a fine one
OnProgress = Callable[[int, int], None]


@dataclass(frozen=True)
class PartFit:
    """How well the model follows one recording, open loop from its reference SOC.

    Attributes:
        name: the file.
        is_drive: a drive; else a pulse test.
        rows: samples in the recording.
        voltage_rms_v: RMS of measured minus modelled voltage where the cell is between 5 and 100 % SOC [V].
        current_max_a: largest current magnitude [A].
        soc_range: lowest and highest SOC.
        temperature_range_degc: lowest and highest temperature [degC], NaN if not recorded.
        soc: (rows,) reference SOC.
        residual_v: (rows,) measured minus modelled voltage [V].
    """

    name: str
    is_drive: bool
    rows: int
    voltage_rms_v: float
    current_max_a: float
    soc_range: tuple[float, float]
    temperature_range_degc: tuple[float, float]
    soc: FloatArray
    residual_v: FloatArray


@dataclass(frozen=True)
class Identification:
    """A fitted cell, how well it fits, what was assumed (`notes`) and what to beware of (`warnings`)."""

    model: CellModel
    parts: tuple[PartFit, ...]
    tau_s: tuple[float, ...]
    activation_j_mol: float
    counted_ah: float
    notes: tuple[str, ...]
    warnings: tuple[str, ...]


def identify(
    slow_tests: Sequence[Recording],
    pulses: Sequence[Recording],
    drives: Sequence[Recording] = (),
    n_rc: int = 2,
    name: str = "cell",
    on_progress: OnProgress = lambda done, of: None,
) -> Identification:
    """Return the cell model that explains the recordings best.

    Args:
        slow_tests: discharge (and charge) at C/10 or less.
        pulses: pulse tests, at one or several temperatures; discharges between pulses may come in files of their own.
        drives: drives like those the model is for.
        n_rc: number of RC pairs, 0..4.
        name: name of the cell.
        on_progress: called with how many rounds are done, of how many.

    Raises:
        ModelError: a recording lacks what the fit needs; the error names it.
    """
    if not 0 <= n_rc <= MAX_RC_PAIRS:
        raise ModelError("--rc", f"{n_rc} RC pairs; 0 to {MAX_RC_PAIRS} can be fitted")
    if not pulses and not drives:
        raise ModelError("--pulses", "neither pulses nor a drive: nothing says what current does")
    slow = read_slow(slow_tests)
    notes = list(slow.notes)
    typical_ohm = typical_resistance([*pulses, *drives])
    capacity_ah = choose_capacity(slow, [*slow_tests, *pulses, *drives], typical_ohm, notes)
    pulses, drives = ([believable(r, capacity_ah) for r in given] for given in (pulses, drives))
    measured = [*pulses, *drives]
    knots_degc, slow_degc = temperature_knots(measured), typical_temperature(slow_tests)

    def laid(recordings: Sequence[Recording], said: list[str], shift: OcvShift | None = None) -> list[Part]:
        return [
            Part(r, reference_soc(r, capacity_ah, slow, typical_ohm, said, shift), is_drive=any(r is d for d in drives))
            for r in recordings
        ]

    parts = laid(measured, notes)
    columned = [part for part in parts if has_soc_column(part.recording)]
    if knots_degc.size > 1 and 0 < len(columned) < len(parts):
        # the rests of the others lie on the OCV at their temperature, which those with a soc column show
        first = Problem(columned, slow, capacity_ah, typical_ohm, knots_degc, slow_degc)
        shift = ocv_shift(first.solve(tau_candidates(measured, capacity_ah)), slow_degc)
        parts = laid(measured, [], shift)
    problem = Problem(parts, slow, capacity_ah, typical_ohm, knots_degc, slow_degc)
    rounds = count(1)

    def told() -> None:
        on_progress(next(rounds), SEARCHES + ROBUST_ROUNDS)

    solution = problem.robust(_search(problem, parts, capacity_ah, n_rc, told), told)
    source = f"identified from {', '.join(r.source for r in (*slow_tests, *measured))}"
    model = cell_model(solution, slow, slow_degc, measured, capacity_ah, name, source)
    fits = tuple(_part_fit(model, part) for part in parts)
    judged = [fit for fit in fits if fit.is_drive] or list(fits)
    model = replace(
        model,
        fit_voltage_rms_v=float(np.sqrt(np.mean([fit.voltage_rms_v**2 for fit in judged]))),
        fit_current_max_a=max(fit.current_max_a for fit in fits),
    )
    energy, sigma = activation_energy(solution, capacity_ah)
    if solution.knots_degc.size == 1:
        notes.append(_one_temperature(solution, energy, sigma))
    warnings = [*slow.warnings, *_warnings(fits, capacity_ah), *_flat(slow)]
    return Identification(model, fits, solution.tau_s, energy, slow.counted_ah, tuple(notes), tuple(warnings))


def _search(
    problem: Problem, parts: Sequence[Part], capacity_ah: float, n_rc: int, told: Callable[[], None]
) -> Solution:
    """Return the solution at the best time constants: a coarse choice, then a fine one."""
    candidates = tau_candidates([part.recording for part in parts], capacity_ah)
    solution = problem.choose_tau(candidates, n_rc)
    told()
    if n_rc:
        near = sorted({tau * factor for tau in solution.tau_s for factor in (2**-0.5, 1.0, 2**0.5)})
        solution = problem.choose_tau(near, n_rc)
    told()
    return solution


def _one_temperature(solution: Solution, energy: float, sigma: float) -> str:
    return (
        f"measured at {solution.knots_degc[0]:.0f} degC alone: resistances at other temperatures follow an activation "
        f"energy of {energy / 1e3:.0f} +- {sigma / 1e3:.0f} kJ/mol"
    )


def tau_candidates(recordings: Sequence[Recording], capacity_ah: float) -> tuple[float, ...]:
    """Return the time constants to choose from [s]: from twice the sampling under load, doubling."""
    steps = []
    for r in recordings:
        under_load = (np.abs(r.current_a) > REST_CURRENT_C * capacity_ah) & (r.step_s > 0.0)
        if under_load.any():
            steps.append(float(np.median(r.step_s[under_load])))
    if not steps:
        problem = f"no current flows in them that counts for a cell of {capacity_ah:.4g} Ah, as the slow test has it"
        raise ModelError("--pulses", f"{problem}: is one of them in mA?")
    shortest = max(TAU_MIN_S, 2.0 * min(steps))
    return tuple(float(shortest * 2.0**k) for k in range(TAU_COUNT))


def open_loop_voltage(model: CellModel, part: Part) -> FloatArray:
    """Return the (n,) voltage of the model along a recording [V], from its SOC and rest; NaN where unknown."""
    r = part.recording
    temperature = np.where(np.isnan(r.temperature_degc), REFERENCE_DEGC, r.temperature_degc)
    branch = np.zeros((model.n_rc, r.time_s.size))
    for k, tau in enumerate(model.tau_s):
        branch[k] = branch_current(r.time_s, r.current_a, float(tau[0, 0]))
    return model.terminal_voltage(part.soc, branch, r.current_a, temperature)


def _part_fit(model: CellModel, part: Part) -> PartFit:
    r = part.recording
    residual_v = r.voltage_v - open_loop_voltage(model, part)
    judged = np.isfinite(residual_v) & (part.soc >= JUDGED_SOC)
    return PartFit(
        name=r.source,
        is_drive=part.is_drive,
        rows=len(r.time_s),
        voltage_rms_v=float(np.sqrt(np.mean(residual_v[judged] ** 2))) if judged.any() else float("nan"),
        current_max_a=float(np.abs(r.current_a).max()),
        soc_range=(float(np.nanmin(part.soc)), float(np.nanmax(part.soc))),
        temperature_range_degc=(float(r.temperature_degc.min()), float(r.temperature_degc.max())),
        soc=part.soc,
        residual_v=residual_v,
    )


def _warnings(fits: Sequence[PartFit], capacity_ah: float) -> list[str]:
    pulse_max = max((fit.current_max_a for fit in fits if not fit.is_drive), default=0.0)
    drive_max = max((fit.current_max_a for fit in fits if fit.is_drive), default=0.0)
    warnings = []
    if drive_max == 0.0:
        warnings.append(
            f"no drive given: above {pulse_max:.3g} A ({pulse_max / capacity_ah:.2g} C) the model has no evidence; "
            "race currents are usually higher: add a test day with --drive"
        )
    elif drive_max < RATED_C * capacity_ah:
        warnings.append(f"the drive stays below {drive_max:.3g} A: a harder race lies outside the data")
    for fit in fits:
        if fit.voltage_rms_v > VOLTAGE_RMS_LIMIT_V:
            warnings.append(f"{fit.name}: the model misses the voltage by {1e3 * fit.voltage_rms_v:.0f} mV RMS")
        low, high = fit.soc_range
        if low < -SOC_BEYOND or high > 1.0 + SOC_BEYOND:
            warnings.append(
                f"{fit.name}: runs from {100.0 * low:.0f} to {100.0 * high:.0f} % SOC: the slow test does not cover "
                "the cell, or the count is wrong"
            )
    return warnings


def _flat(slow: SlowCurves) -> list[str]:
    """Warn of a cell whose voltage hardly tells its SOC."""
    slope_v = np.diff(slow.rested_v) / np.diff(slow.soc)
    share = float(np.mean(slope_v < FLAT_V))
    if share < FLAT_SHARE:
        return []
    gap_v = float(np.median(slow.charge_v - slow.discharge_v))
    hysteresis = f", and charge and discharge lie {1e3 * gap_v:.0f} mV apart" if slow.has_charge else ""
    return [
        f"the OCV rises by less than {100.0 * FLAT_V:.0f} mV per 10 % of SOC over {100.0 * share:.0f} % of the range"
        f"{hysteresis}: there the SOC rests on counted charge, and a wrong start is corrected late"
    ]
