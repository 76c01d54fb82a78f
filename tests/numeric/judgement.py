"""How right count, filter and fusion are along a recording with the sensor errors of a car.

1.2 mV and 0.1 mV steps; 0.02C of noise, gain +-0.5 %, offset +-0.0067C, all four signs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from app.estimation.arrays import BoolArray, FloatArray
from app.estimation.cell_model.circuit import SECONDS_PER_HOUR, CellModel
from app.estimation.filters.estimators import Estimates, make_estimator
from app.estimation.recording.cell_recording import Recording
from app.estimation.scoring import SocScore, score_soc

SIGNS = tuple((gain, offset) for gain in (-1.0, 1.0) for offset in (-1.0, 1.0))
GAIN_ERROR = 0.005
OFFSET_C = 0.0067
CURRENT_NOISE_C = 0.02
VOLTAGE_NOISE_V = 1.2e-3
TEMPERATURE_UNKNOWN_DEGC = 25.0


@dataclass(frozen=True)
class Judgement:
    """One run from one start, four signs of the sensor errors, (4,) each; RMSE in points of SOC.

    `excess` is how much worse the fusion is than the better of count and filter.
    """

    count: FloatArray
    filter: FloatArray
    fused: FloatArray
    scores: tuple[SocScore, ...]

    @property
    def excess(self) -> FloatArray:
        """(4,) points of RMSE."""
        return np.asarray(self.fused - np.minimum(self.count, self.filter))


def rows_of(recording: Recording, rows: BoolArray) -> Recording:
    """Return some rows of a recording."""
    names = ("time_s", "current_a", "voltage_v", "temperature_degc", "soc")
    return replace(recording, **{name: getattr(recording, name)[rows] for name in names})


def part(recording: Recording, start_s: float, stop_s: float) -> Recording:
    """Return the rows from start_s to stop_s after the first."""
    elapsed_s = recording.time_s - recording.time_s[0]
    return rows_of(recording, (elapsed_s >= start_s) & (elapsed_s < stop_s))


def disturbed(recording: Recording, capacity_ah: float, gain: float, offset: float) -> tuple[FloatArray, FloatArray]:
    """Return voltage [V] and current [A] as a car measures them."""
    rng = np.random.default_rng(7)
    n = recording.time_s.size
    voltage = np.round(recording.voltage_v + VOLTAGE_NOISE_V * rng.normal(size=n), 4)
    current = recording.current_a * (1.0 + GAIN_ERROR * gain) + OFFSET_C * offset * capacity_ah
    return voltage, current + CURRENT_NOISE_C * capacity_ah * rng.normal(size=n)


def estimate(
    model: CellModel,
    recording: Recording,
    sensed: tuple[FloatArray, FloatArray],
    name: str,
    soc: float | None,
    soc_sigma: float | None = None,
) -> Estimates:
    """Return what a filter says along a recording as sensed; SOC None = from the first voltage."""
    voltage, current = sensed
    estimator = make_estimator(name, model, 1)
    known = np.isfinite(recording.temperature_degc)
    degc = np.where(known, recording.temperature_degc, TEMPERATURE_UNKNOWN_DEGC)
    estimator.start(voltage[:1], degc[:1], float(current[0]), soc, soc_sigma)
    return estimator.run(recording.step_s, current, voltage[:, None], degc[:, None])


def counted(model: CellModel, recording: Recording, current_a: FloatArray, soc: float) -> FloatArray:
    """Return (n,) SOC by counting charge alone."""
    kept = np.where(current_a < 0.0, model.coulombic_efficiency, 1.0)
    return np.asarray(soc - np.cumsum(kept * current_a * recording.step_s) / (SECONDS_PER_HOUR * model.capacity_ah))


def rmse_points(soc: FloatArray, reference: FloatArray) -> float:
    """Return the root mean square error in points of SOC, rows without a reference left out."""
    return float(100.0 * np.sqrt(np.nanmean((soc - reference) ** 2)))


def judge(model: CellModel, recording: Recording, off: float) -> Judgement:
    """Return how right count, filter and fusion are from a start SOC that is wrong by `off`."""
    start = float(recording.soc[0]) + (off if 0.0 < recording.soc[0] + off <= 1.0 else -off)
    count, alone, fused, scores = [], [], [], []
    for gain, offset in SIGNS:
        sensed = disturbed(recording, model.capacity_ah, gain, offset)
        count.append(rmse_points(counted(model, recording, sensed[1], start), recording.soc))
        by_voltage = estimate(model, recording, sensed, "cdkf", None).soc[:, 0]
        given = estimate(model, recording, sensed, "cdkf", start).soc[:, 0]
        alone.append(min(rmse_points(by_voltage, recording.soc), rmse_points(given, recording.soc)))
        found = estimate(model, recording, sensed, "fused", start)
        score = score_soc(recording.time_s, found.soc[:, 0], found.soc_sigma[:, 0], recording.soc)
        if score is None:
            raise ValueError(f"{recording.source} has no soc column")
        fused.append(100.0 * score.soc_rmse)
        scores.append(score)
    return Judgement(np.array(count), np.array(alone), np.array(fused), tuple(scores))
