"""Values of each cell and of each pack in a snapshot: measured and estimated."""

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Final

import numpy as np

from app.battery.battery import Battery
from app.estimation.filters.estimators import Estimates
from app.live.prediction import Assessment
from app.telemetry import Cells, FloatArray, Pack
from app.telemetry.cell_findings import Finding
from app.telemetry.measurement import Measurement

RESISTING: Final = ("joint-resistance-high", "cell-resistance-high")


def cells_of(measured: Measurement, estimate: Estimates | None, assessment: Assessment) -> Cells:
    """Everything per cell; estimates are NaN without an estimator's result."""
    voltages_v, resistance_ohm = measured.voltage_v, measured.resistance_ohm
    joints, health, growth = assessment.joints, assessment.health, assessment.learned
    if joints is not None:
        resistance_ohm = np.where(np.isfinite(joints.resistance_ohm), joints.resistance_ohm, resistance_ohm)
    none = np.full(voltages_v.shape, np.nan)
    soc = none if estimate is None else estimate.known_soc(voltages_v)
    return Cells(
        voltage_v=voltages_v,
        temperature_degc=measured.temperature_degc,
        soc=soc,
        soc_sigma=none if estimate is None else np.where(np.isnan(soc), np.nan, estimate.soc_sigma),
        ocv_v=none if estimate is None else estimate.ocv_v,
        residual_v=none if estimate is None else voltages_v - estimate.voltage_v,
        resistance_ohm=resistance_ohm,
        capacity_ah=measured.capacity_ah if assessment.capacity_ah is None else assessment.capacity_ah,
        balancing=measured.balancing,
        model_valid=None if estimate is None else estimate.model_valid,
        soh_capacity=none if health is None else health.capacity,
        resistance_factor=none if growth is None else np.where(growth.has_resistance, growth.resistance_factor, np.nan),
        joint_excess_ohm=none if joints is None else joints.joint_excess_ohm,
        joint_loose=assessment.loose,
        voltage_age_s=measured.voltage_age_s,
    )


def with_findings(cells: Cells, findings: Iterable[Finding]) -> Cells:
    """Cells whose resistance and joint [ohm] are those of their findings: the verdict on a trip is more than theirs."""
    sizes = [(finding, finding.size) for finding in findings if finding.code in RESISTING and finding.size is not None]
    if not sizes:
        return cells
    resistance_ohm, joint_ohm = cells.resistance_ohm.copy(), cells.joint_excess_ohm.copy()
    is_loose = np.zeros(joint_ohm.shape, bool) if cells.joint_loose is None else cells.joint_loose.copy()
    usual_ohm = np.nanmedian(resistance_ohm) if np.isfinite(resistance_ohm).any() else np.nan
    for finding, size_ohm in sizes:
        resistance_ohm[finding.cell] = np.fmax(resistance_ohm[finding.cell], usual_ohm + size_ohm)
        if finding.code == "joint-resistance-high":
            joint_ohm[finding.cell], is_loose[finding.cell] = size_ohm, True
    return replace(cells, resistance_ohm=resistance_ohm, joint_excess_ohm=joint_ohm, joint_loose=is_loose)


def extreme(values: FloatArray, *, highest: bool) -> tuple[float | None, int | None]:
    """Return (value, cell) of the highest or lowest element that is there."""
    present = np.where(np.isnan(values), -np.inf if highest else np.inf, values)
    cell = int(present.argmax() if highest else present.argmin())
    value = float(values[cell])
    return (None, None) if math.isnan(value) else (value, cell)


def mean(values: FloatArray) -> float | None:
    """Mean of the elements that are there."""
    present = values[~np.isnan(values)]
    return float(present.sum() / len(present)) if len(present) else None


def mean_of_all(values: FloatArray) -> float | None:
    """Mean of all elements, None where one is missing."""
    return None if np.isnan(values).any() else mean(values)


def packs_of(battery: Battery, cells: Cells, slave_status: tuple[int | None, ...]) -> tuple[Pack, ...]:
    """A row for each pack: voltage and spread only where all its cells are there."""
    starts, voltages_v, temperatures_degc = battery.starts, cells.voltage_v, cells.temperature_degc
    low_v, high_v = np.fmin.reduceat(voltages_v, starts), np.fmax.reduceat(voltages_v, starts)
    columns = (
        np.add.reduceat(voltages_v, starts),
        low_v,
        high_v,
        np.maximum.reduceat(voltages_v, starts) - np.minimum.reduceat(voltages_v, starts),
        np.fmax.reduceat(temperatures_degc, starts),
        np.fmin.reduceat(temperatures_degc, starts),
    )
    lists = ([None if math.isnan(value) else value for value in column.tolist()] for column in columns)
    return tuple(map(Pack, *lists, slave_status))
