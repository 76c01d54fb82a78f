"""From fitted coefficients to the tables of a cell model: over all temperatures a cell may meet, measured or not.

Between the temperatures of the tests resistances are interpolated linearly in 1/T after the usual activation energy is
taken out. Beyond them they go on with the activation energy that the whole drop shows between the last two, or the
usual one. The cell file says which temperatures were measured; how far the rest may be off follows from that.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import ACTIVATION_SIGMA_J_MOL, GAS_CONSTANT, KELVIN, CellModel
from app.estimation.cell_model.ocv import OcvCurve
from app.estimation.identification.design import (
    DEFAULT_ACTIVATION_J_MOL,
    OFFSET_SOC,
    OVERPOTENTIAL_SOC,
    REFERENCE_DEGC,
    RESISTANCE_SOC,
    arrhenius,
    hat_weights,
    temperature_weights,
)
from app.estimation.identification.parts import OcvShift
from app.estimation.identification.problem import Solution
from app.estimation.identification.slow_tests import SlowCurves
from app.estimation.recording.cell_recording import Recording

OCV_POINTS: Final = 101
KNOT_APART_K: Final = 6.0  # tests at temperatures nearer than this share their tables
SPAN_MIN_K: Final = 8.0  # less than this between the recordings and one set of tables serves all
TABLE_DEGC: Final = (-30.0, 60.0)  # what the tables cover at least
TABLE_STEP_K: Final = 10.0
SEEN_STEP_K: Final = 5.0  # of the list of temperatures that were measured
SEEN_SHARE: Final = 0.01  # of the rows of a recording at a temperature that make it measured
MIDDLE_SOC: Final = np.array([0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9])
TYPICAL_C: Final = 1.0  # the current whose lasting drop tells the activation energy
ACTIVATION_FIT_SIGMA_J_MOL: Final = 6e3  # how far beyond its temperatures a measured activation energy holds


def temperature_knots(recordings: Sequence[Recording]) -> FloatArray:
    """Return (n_t,) the temperatures that get tables of their own, rising [degC]: those the tests were made at."""
    known = [r.temperature_degc[np.isfinite(r.temperature_degc)] for r in recordings]
    known = [degc for degc in known if degc.size]
    if not known:
        return np.array([REFERENCE_DEGC])
    low, high = np.percentile(np.concatenate(known), (5.0, 95.0))
    medians = np.sort([float(np.median(degc)) for degc in known])
    if high - low < SPAN_MIN_K:
        return np.array([float(medians.mean())])
    groups: list[list[float]] = []
    for degc in medians.tolist():
        if groups and degc - groups[-1][0] < KNOT_APART_K:
            groups[-1].append(degc)
        else:
            groups.append([degc])
    if len(groups) == 1:
        return np.array([low, high])
    return np.array([float(np.mean(group)) for group in groups])


def seen_temperatures(recordings: Sequence[Recording]) -> FloatArray:
    """Return (m,) the temperatures that recordings tell of, rising, 5 K or less apart where they are continuous."""
    seen: list[float] = []
    for recording in recordings:
        degc = recording.temperature_degc[np.isfinite(recording.temperature_degc)]
        if degc.size == 0:
            seen.append(REFERENCE_DEGC)
            continue
        low, high = np.percentile(degc, (100.0 * SEEN_SHARE, 100.0 - 100.0 * SEEN_SHARE))
        seen += np.linspace(low, high, 1 + max(int(np.ceil((high - low) / SEEN_STEP_K)), 1)).tolist()
    return np.unique(np.round(seen, 1))


def typical_temperature(recordings: Sequence[Recording]) -> float:
    """Return the median temperature of recordings [degC]; 25 where none was recorded."""
    degc = np.concatenate([r.temperature_degc for r in recordings])
    return float(np.nanmedian(degc)) if np.isfinite(degc).any() else REFERENCE_DEGC


def activation_energy(solution: Solution, capacity_ah: float) -> tuple[float, float]:
    """Return activation energy of a lasting drop at 1C and its sigma [J/mol], by the two coldest tests."""
    knots = solution.knots_degc
    if knots.size < 2:
        return DEFAULT_ACTIVATION_J_MOL, ACTIVATION_SIGMA_J_MOL
    over = [np.interp(MIDDLE_SOC, OVERPOTENTIAL_SOC, e) for e in solution.overpotential_v]
    lasting = solution.r0_ohm + solution.r_ohm.sum(axis=0)
    drop = np.array([np.interp(MIDDLE_SOC, RESISTANCE_SOC, r) for r in lasting]) * TYPICAL_C * capacity_ah
    drop = (drop + np.array(over) * np.arcsinh(TYPICAL_C)).mean(axis=1) * arrhenius(knots, DEFAULT_ACTIVATION_J_MOL)
    inverse = 1.0 / (knots + KELVIN)
    found = GAS_CONSTANT * float(np.log(drop[0] / drop[-1]) / (inverse[0] - inverse[-1]))
    # the measured slope is the better known the farther apart the tests are
    measured_v2 = (ACTIVATION_FIT_SIGMA_J_MOL * max(1.0, 3e-4 / float(inverse[0] - inverse[-1]))) ** 2
    weight = ACTIVATION_SIGMA_J_MOL**2 / (ACTIVATION_SIGMA_J_MOL**2 + measured_v2)
    energy = weight * found + (1.0 - weight) * DEFAULT_ACTIVATION_J_MOL
    return energy, float(np.sqrt(weight * measured_v2))


def ocv_shift(solution: Solution, slow_degc: float) -> OcvShift:
    """Return what the OCV at a SOC and a temperature lies above that at the temperature of the slow tests."""
    knots = solution.knots_degc
    offset_v = solution.offset_v - own_offset_v(solution, slow_degc)

    def shift(soc: FloatArray, degc: FloatArray) -> FloatArray:
        known = np.where(np.isnan(degc), REFERENCE_DEGC, degc)
        return np.asarray((temperature_weights(knots, known) @ offset_v * hat_weights(OFFSET_SOC, soc)).sum(axis=1))

    return shift


def own_offset_v(solution: Solution, slow_degc: float) -> FloatArray:
    """Return (11,) the offset of the OCV at the temperature of the slow tests [V]."""
    return np.asarray((temperature_weights(solution.knots_degc, np.array([slow_degc])) @ solution.offset_v)[0])


def cell_model(
    solution: Solution,
    slow: SlowCurves,
    slow_degc: float,
    recordings: Sequence[Recording],
    capacity_ah: float,
    name: str,
    source: str,
) -> CellModel:
    """Return the solution as tables over SOC and temperature."""
    knots = solution.knots_degc
    energy, energy_sigma = activation_energy(solution, capacity_ah)
    grid_degc = table_temperatures(knots)
    inside = np.clip(grid_degc, knots[0], knots[-1])
    weights = temperature_weights(knots, inside)
    scale = arrhenius(inside, DEFAULT_ACTIVATION_J_MOL) * arrhenius(grid_degc, energy) / arrhenius(inside, energy)
    by_degc = weights * scale[:, None]
    over_v = np.array([np.interp(RESISTANCE_SOC, OVERPOTENTIAL_SOC, e) for e in solution.overpotential_v])
    r_ohm = np.einsum("tj,kjs->kts", by_degc, solution.r_ohm)
    tau_s = np.broadcast_to(np.array(solution.tau_s)[:, None, None], r_ohm.shape)
    # the curve is that of the temperature of the slow test, whose branches it lies between
    offset_v = own_offset_v(solution, slow_degc)
    soc = np.linspace(0.0, 1.0, OCV_POINTS)
    ocv_v = solution.blended_v(slow, soc) + np.interp(soc, OFFSET_SOC, offset_v)
    shift_v = weights @ solution.offset_v - offset_v
    return CellModel(
        name=name,
        source=source,
        capacity_ah=capacity_ah,
        ocv=OcvCurve(soc, np.maximum.accumulate(ocv_v) + 1e-7 * np.arange(OCV_POINTS)),
        soc_grid=RESISTANCE_SOC,
        temperature_grid_degc=grid_degc,
        r0_ohm=by_degc @ solution.r0_ohm,
        r_ohm=r_ohm,
        tau_s=tau_s,
        overpotential_v=by_degc @ over_v,
        overpotential_current_a=capacity_ah,
        ocv_shift_v=np.array([np.interp(RESISTANCE_SOC, OFFSET_SOC, row) for row in shift_v]),
        v_min_v=round(float(slow.discharge_v.min()) * 20.0) / 20.0,
        v_max_v=round(float(slow.charge_v.max()) * 20.0) / 20.0,
        fit_temperature_degc=seen_temperatures(recordings),
        activation_sigma_j_mol=energy_sigma,
    )


def table_temperatures(knots_degc: FloatArray) -> FloatArray:
    """Return (n,) rows of the tables [degC]: those of the tests, and steps of 10 K that lie apart from them."""
    low = min(TABLE_DEGC[0], TABLE_STEP_K * np.floor(knots_degc[0] / TABLE_STEP_K))
    high = max(TABLE_DEGC[1], TABLE_STEP_K * np.ceil(knots_degc[-1] / TABLE_STEP_K))
    steps = np.arange(low, high + 1.0, TABLE_STEP_K)
    apart = np.abs(steps[:, None] - knots_degc).min(axis=1) > 0.3 * TABLE_STEP_K
    apart[[0, -1]] = ~np.isin(steps[[0, -1]], knots_degc)
    return np.sort(np.concatenate((steps[apart], np.round(knots_degc, 2))))
