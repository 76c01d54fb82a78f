"""The one judge of a cell's joints, capacity, leaks and sensors, live and over a session.

Feed `step` with every sample and call `judge` every JUDGE_S seconds. Times are labels: any clock that does not run
backwards within a session; unix time lets findings live through a restart.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from app.estimation.arrays import BoolArray, FloatArray, median, robust_sigma
from app.estimation.cell_model.circuit import CellModel
from app.estimation.errors import check_step
from app.estimation.health.cell_finding import BAND_SIGMAS, SURE, CellFinding, FindingCode, confidence_of
from app.estimation.health.charge_watch import ChargeDrift, ChargeMemory, ChargeWatch
from app.estimation.health.joint_watch import ALARM_OHM, JUDGE_S, JointWatch, LooseJoints
from app.estimation.health.joints import JointReport
from app.estimation.health.packs import Packs
from app.estimation.health.sensor_watch import ChannelWatch, DeadSensors, ThermistorWatch

__all__ = ["JUDGE_S", "CellWatch", "CellWatchMemory"]

SIGMA_MIN_FRAC: Final = 0.02  # sigma of a filter's SOC
GROWTH_MIN: Final = 0.15  # share of a cell's own resistance
GROWTH_JUDGEMENTS: Final = 60.0  # time of driving over which a cell's own growth is averaged
GROWTH_SIGMA_MAX: Final = 0.5  # what is less sure teaches nothing of it
GROWTH_SIGMAS: Final = 6.0  # multiple of its scatter over the cells
CELL_SHARE: Final = 0.25  # share of what is more: a joint has nothing that lasts, so it is the cell that resists
LEAK_MIN_A: Final = 4e-3  # 0.4 % of 25 Ah in a day
LEAK_SIGMAS: Final = 5.0
LOST_MIN: Final = 0.06
LOST_SIGMAS: Final = 4.0
THERMAL_S: Final = 1.0  # between two checks of the thermistors
CHANNEL_S: Final = 0.15  # and at the voltage channels
VOLTAGE_S: Final = 4.0  # after so long without a new one a cell has no voltage; sooner than a sensor is found open
AT_ONCE: Final = 0.4  # share of the cells that must be measured in one sample to be compared with each other
THERMISTOR_K: Final = 1.0  # resolution of a temperature
CHANNEL_V: Final = 1e-3
EMPTY_SOC: Final = 0.12
UNSURE: Final = 0.25  # share of a size: a size with a larger sigma does not replace one that was surer
GONE: Final = 0.5  # share of what was found: evidence that it is less ends a finding, want of evidence does not
_TEMPERATURE: Final[tuple[FindingCode, FindingCode]] = ("temperature-sensor-fault", "temperature-sensor-open")
_VOLTAGE: Final[tuple[FindingCode, FindingCode]] = ("cell-voltage-stuck", "cell-voltage-missing")
HOLD: Final = 0.6  # share of a threshold: what was found ends below it


@dataclass(frozen=True)
class CellWatchMemory:
    """State of a watch that a session leaves to the next one of the same cells.

    Attributes:
        joint_baseline_ohm: (n_cells,) of `JointWatch`.
        loose: joints that were loose.
        charge: of `ChargeWatch`.
        findings: what was found.
    """

    joint_baseline_ohm: FloatArray
    loose: LooseJoints | None = None
    charge: ChargeMemory | None = None
    findings: tuple[CellFinding, ...] = ()


class CellWatch:
    """All that is watched of every cell."""

    def __init__(self, cell: CellModel, pack_sizes: tuple[int, ...], memory: CellWatchMemory | None = None) -> None:
        """Start, or go on with what an earlier session left.

        Raises:
            ShapeError: the memory belongs to another number of cells, or a pack has none.
        """
        self._cell = cell
        self._packs = Packs(pack_sizes)
        n_cells = self._packs.n_cells
        before = memory or CellWatchMemory(np.full(n_cells, np.nan))
        self._joint_watch = JointWatch(self._packs, before.joint_baseline_ohm, before.loose)
        self._charge_watch = ChargeWatch(cell, self._packs, before.charge)
        self._thermistors = ThermistorWatch(self._packs, (e for e in before.findings if e.code in _TEMPERATURE))
        self._channels = ChannelWatch(self._packs, (e for e in before.findings if e.code in _VOLTAGE))
        self._unmeasured_s = np.full(n_cells, np.inf)  # since each cell had a voltage
        self._measured = np.zeros(n_cells, dtype=np.bool_)  # since the channels were looked at
        self._findings = {(finding.code, finding.cell): finding for finding in before.findings}
        self._time_s = -np.inf
        self._thermal_s = self._channel_s = 0.0  # since they were looked at
        self._has_looked = False
        self._leaked = {cell for code, cell in self._findings if code == "self-discharge-high"}
        self._growth = _Mean(n_cells)
        self.joints: JointReport | None = None

    @property
    def memory(self) -> CellWatchMemory:
        """Return the state to keep for the next session."""
        return CellWatchMemory(
            self._joint_watch.baseline_ohm, self._joint_watch.loose_joints, self._charge_watch.memory, self.findings
        )

    @property
    def findings(self) -> tuple[CellFinding, ...]:
        """Return the present faults, the surest first."""
        return tuple(sorted(self._findings.values(), key=lambda finding: (-finding.confidence, finding.cell)))

    def has(self, code: FindingCode) -> BoolArray:
        """Return (n_cells,) the cells of which this was found."""
        has_finding: BoolArray = np.array([(code, cell) in self._findings for cell in range(self._packs.n_cells)])
        return has_finding

    @property
    def resistance_age_s(self) -> float:
        """Seconds since current last showed the resistances; infinite before it did."""
        return self._joint_watch.age_s

    def step(
        self,
        time_s: float,
        dt_s: float,
        current_a: float,
        voltages_v: FloatArray,
        temperatures_degc: FloatArray,
        balancing: BoolArray | None = None,
    ) -> None:
        """Take one sample.

        Args:
            time_s: when it was measured [s].
            dt_s: since the sample before, 0 = not known [s].
            current_a: positive on discharge [A].
            voltages_v: (n_cells,) [V]; NaN = missing.
            temperatures_degc: (n_cells,) [degC]; NaN = missing.
            balancing: (n_cells,) cells that are bled; None = not known.

        Raises:
            EstimatorError: dt_s is negative or not finite.
        """
        check_step(dt_s)
        self._time_s = time_s
        self._unmeasured_s = np.where(np.isfinite(voltages_v), 0.0, self._unmeasured_s + dt_s)
        self._thermal_s += dt_s
        if self._thermal_s >= THERMAL_S:
            self._thermistors.step(time_s, self._thermal_s, temperatures_degc, self._unmeasured_s < VOLTAGE_S)
            self._thermal_s = 0.0
        self._channel_s += dt_s
        self._measured |= np.isfinite(voltages_v)  # messages of a battery take turns
        if self._channel_s >= CHANNEL_S:
            self._channels.step(time_s, self._channel_s, current_a, voltages_v, self._measured)
            self._channel_s = 0.0
            self._measured[:] = False
        dead = self._channels.is_dead
        if dead.any():
            self._charge_watch.forget(dead)
            voltages_v = np.where(dead, np.nan, voltages_v)
        if np.isfinite(voltages_v).mean() < AT_ONCE:
            voltages_v = np.full_like(voltages_v, np.nan)  # the others were measured at other currents: no peers
        self._joint_watch.step(dt_s, current_a, voltages_v)
        growth = None if self.joints is None else self.joints.cell_growth_frac
        self._has_looked |= self._charge_watch.step(time_s, dt_s, current_a, voltages_v, balancing, growth)

    def judge(self) -> tuple[CellFinding, ...]:
        """Return what is wrong now, the surest first: also what was found before and nothing has contradicted."""
        was_loose = self._joint_watch.loose
        self.joints = self._joint_watch.judge()
        has_changed = self._joint_watch.loose != was_loose
        self._charge_watch.forget(has_changed, leak=True)  # a drop that changed was taken for charge
        self._keep(("joint-resistance-high", "cell-resistance-high"), self._resisting(self.joints))
        if self._has_looked:
            self._has_looked = False
            drift = self._charge_watch.drift()
            self._keep(("self-discharge-high",), self._leaking(drift))
            self._keep(("capacity-low",), self._losing(drift))
        self._keep(_TEMPERATURE, self._dead(_TEMPERATURE, "K", THERMISTOR_K, self._thermistors.result()))
        self._keep(_VOLTAGE, self._dead(_VOLTAGE, "V", CHANNEL_V, self._channels.result()))
        return self.findings

    def _keep(self, codes: tuple[FindingCode, ...], findings: list[CellFinding]) -> None:
        """Put what was found of a kind in the place of what was known of it; a finding keeps when it began."""
        before = {key: self._findings.pop(key) for key in list(self._findings) if key[0] in codes}
        for finding in findings:
            earlier = before.get((finding.code, finding.cell))
            self._findings[finding.code, finding.cell] = (
                finding if earlier is None else replace(finding, since_s=earlier.since_s)
            )

    def _resisting(self, report: JointReport) -> list[CellFinding]:
        """Return the joints and the cells that resist more than they ought to."""
        watch = self._joint_watch
        if not np.isfinite(watch.age_s):  # nothing has been seen since an earlier session
            return [
                finding
                for (code, _), finding in self._findings.items()
                if code in ("joint-resistance-high", "cell-resistance-high")
            ]
        usual = median(report.resistance_ohm)
        is_sure = watch.growth_sigma < GROWTH_SIGMA_MAX
        growth = self._growth.add(np.where(is_sure, report.cell_growth_frac, np.nan), watch.evidence_count)
        scatter = robust_sigma(growth)
        excess_ohm = np.nan_to_num(report.ohmic_excess_ohm)
        limit = max(GROWTH_MIN, GROWTH_SIGMAS * scatter)
        is_cell = np.zeros(len(growth), dtype=np.bool_)
        is_cell[self._beyond("cell-resistance-high", growth, np.full(len(growth), limit))] = True
        is_cell &= (np.nan_to_num(growth) * usual > CELL_SHARE * excess_ohm) & (excess_ohm > GROWTH_MIN * usual)
        is_cell &= ~(watch.loose & watch.was_sound)  # no cell ages within a session
        findings = []
        is_empty = self._charge_watch.soc < EMPTY_SOC  # an empty cell resists more, and a fuller one does not
        for cell in np.flatnonzero(watch.loose | is_cell).tolist():
            if is_empty[cell] and not self._is_found(cell, "joint-resistance-high", "cell-resistance-high"):
                continue
            code: FindingCode = "cell-resistance-high" if is_cell[cell] else "joint-resistance-high"
            size = float((report.ohmic_excess_ohm if code == "cell-resistance-high" else report.joint_excess_ohm)[cell])
            of_cell = scatter * usual if code == "cell-resistance-high" else 0.0
            sigma = float(
                np.linalg.norm((report.sigma_ohm[cell], watch.change_ohm[cell], of_cell, SIGMA_MIN_FRAC * size))
            )
            earlier = self._findings.get((code, cell))
            if earlier is not None and sigma > max(earlier.sigma, UNSURE * size):
                findings.append(earlier)
                continue
            seen_s = self._time_s - watch.age_s
            value, evidence_s = float(report.resistance_ohm[cell]), watch.evidence_s
            neighbours, confidence = self._packs.neighbours(cell), confidence_of(size, sigma, ALARM_OHM)
            findings.append(
                CellFinding(
                    *(code, cell, size, sigma, "ohm", seen_s, seen_s, evidence_s, watch.excitation_a),
                    value,
                    usual,
                    neighbours,
                    confidence,
                )
            )
        return findings

    def _leaking(self, drift: ChargeDrift) -> list[CellFinding]:
        limits_a = np.maximum(LEAK_MIN_A, LEAK_SIGMAS * drift.leak_noise_a)
        findings = []
        beyond, before = set(self._beyond("self-discharge-high", drift.leak_a, limits_a)), self._leaked
        self._leaked = beyond
        for cell in sorted(beyond & before):  # two checks in a row
            size, sigma = float(drift.leak_a[cell]), float(drift.leak_sigma_a[cell])
            usual = median(drift.leak_a)
            findings.append(
                self._of_charge(
                    "self-discharge-high", cell, size, sigma, "A", size, usual, confidence_of(size, sigma, 0.0)
                )
            )
        return self._lasting("self-discharge-high", findings, drift.leak_a, drift.leak_sigma_a)

    def _losing(self, drift: ChargeDrift) -> list[CellFinding]:
        limits = np.maximum(LOST_MIN, LOST_SIGMAS * drift.lost_sigma)
        findings = []
        for cell in self._beyond("capacity-low", drift.lost, limits):
            size, sigma = float(drift.lost[cell]), float(drift.lost_sigma[cell])
            value, usual = 1.0 - size, 1.0 - median(drift.lost)
            confidence = confidence_of(size, sigma, 0.0)
            findings.append(self._of_charge("capacity-low", cell, size, sigma, "1", value, usual, confidence))
        return self._lasting("capacity-low", findings, drift.lost, drift.lost_sigma)

    def _dead(
        self, codes: tuple[FindingCode, FindingCode], unit: str, sigma: float, dead_sensors: DeadSensors
    ) -> list[CellFinding]:
        nan = float("nan")
        dead = []
        for cell in np.flatnonzero(dead_sensors.is_dead).tolist():
            size, since_s, seen_s = (
                float(dead_sensors.size[cell]),
                float(dead_sensors.since_s[cell]),
                float(dead_sensors.seen_s[cell]),
            )
            value, usual, neighbours = (
                float(dead_sensors.value[cell]),
                float(dead_sensors.usual[cell]),
                self._packs.neighbours(cell),
            )
            evidence_s, code = seen_s - since_s, codes[int(np.isnan(value))]
            dead.append(
                CellFinding(
                    code, cell, size, sigma, unit, since_s, seen_s, evidence_s, nan, value, usual, neighbours, SURE
                )
            )
        return dead

    def _of_charge(
        self,
        code: FindingCode,
        cell: int,
        size: float,
        sigma: float,
        unit: str,
        value: float,
        usual: float,
        confidence: float,
    ) -> CellFinding:
        watch = self._charge_watch
        seen_s, evidence_s, current_a = watch.looked_s, watch.evidence_s, watch.mean_current_a
        neighbours = self._packs.neighbours(cell)
        return CellFinding(
            code, cell, size, sigma, unit, seen_s, seen_s, evidence_s, current_a, value, usual, neighbours, confidence
        )

    def _is_found(self, cell: int, *codes: FindingCode) -> bool:
        return any((code, cell) in self._findings for code in codes)

    def _lasting(
        self, code: FindingCode, findings: list[CellFinding], values: FloatArray, sigmas: FloatArray
    ) -> list[CellFinding]:
        """Return `found` with what was found before and is less sure now, but not contradicted."""
        seen = {finding.cell for finding in findings}
        kept = [finding for (kind, cell), finding in self._findings.items() if kind == code and cell not in seen]
        return findings + [
            finding
            for finding in kept
            if values[finding.cell] + BAND_SIGMAS * sigmas[finding.cell] >= GONE * finding.size
        ]

    def _beyond(self, code: FindingCode, values: FloatArray, limits: FloatArray) -> list[int]:
        """Return the cells beyond a limit; one that was found ends well below it."""
        held = np.array([HOLD if (code, cell) in self._findings else 1.0 for cell in range(len(values))])
        return [int(cell) for cell in np.flatnonzero(np.nan_to_num(values) > held * limits)]


class _Mean:
    """Mean of the last GROWTH_JUDGEMENTS values, a fading one; each counts once."""

    def __init__(self, n_cells: int) -> None:
        self._mean = np.full(n_cells, np.nan)
        self._counts = np.zeros(n_cells)
        self._last = -1

    def add(self, values: FloatArray, count: int) -> FloatArray:
        """Take a value, the same `count` is the same value; return the mean."""
        if count != self._last:
            self._last = count
            is_known = np.isfinite(values)
            self._counts += is_known
            share = 1.0 / np.clip(self._counts, 1.0, GROWTH_JUDGEMENTS)
            before = np.where(np.isfinite(self._mean), self._mean, values)
            self._mean = np.where(is_known, before + share * (values - before), self._mean)
        return self._mean
