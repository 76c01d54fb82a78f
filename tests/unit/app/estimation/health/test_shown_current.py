"""A current is a mean over some time, a voltage of one instant and filtered: sizes follow from what both show."""

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.health.cell_fits import fit_cell
from app.estimation.health.cell_voltages import CellVoltages, shown_current, slow_current
from app.estimation.health.stretch import Stretch

MODEL = load_cell("samsung-25r-10p")
STEP_S, SAMPLES = 0.01, 10  # step of the measurement; samples in a mean
PARTED_S, END_S, HOLD_S, CELL = 60.0, 61.0, 0.4, 5


def driven(mohm):
    """A stretch of driving at whose end a joint parts, measured as the master does: mean, and weight of the newest."""
    rng = np.random.default_rng(3)
    time_s = np.arange(0.0, END_S, STEP_S)
    pedal = np.repeat(rng.uniform(-20.0, 140.0, int(END_S / HOLD_S) + 1), int(HOLD_S / STEP_S))[: time_s.size]
    current = slow_current(time_s, pedal, 0.1)
    branches = [slow_current(time_s, current, float(tau_s.mean())) for tau_s in MODEL.tau_s]
    drop = 2e-3 * current + sum(5e-4 * each for each in branches)
    voltage = np.repeat((3.8 - drop)[:, None], 12, axis=1) + 2e-4 * rng.standard_normal((time_s.size, 12))
    voltage[time_s > PARTED_S, CELL] -= 1e-3 * mohm * current[time_s > PARTED_S]
    passes = voltage[::5]
    for k in range(1, len(passes)):
        passes[k] = 0.5 * passes[k] + 0.5 * passes[k - 1]
    mean_a = current.reshape(-1, SAMPLES).mean(axis=1)
    n = len(mean_a)
    return Stretch(
        time_s=time_s[SAMPLES - 1 :: SAMPLES],
        current_a=mean_a,
        steady_a=mean_a,
        voltage_v=passes[1::2][:n],
        temperature_degc=np.full((n, 12), 25.0),
        soc=np.full(n, 0.7),
        start_s=0.0,
        segments=(12,),
    )


@pytest.mark.parametrize("mohm", [3.0, 12.0, 20.0])
def test_a_joint_that_parted_a_second_ago_has_its_true_size(mohm):
    voltages = CellVoltages(driven(mohm), MODEL, END_S)
    found = {fit.law: fit for fit in fit_cell(voltages.of(CELL), MODEL, lambda size, onset_s: 0.0)}
    assert max(found.values(), key=lambda fit: fit.log_likelihood).law == "joint"
    assert found["joint"].size == pytest.approx(1e-3 * mohm, rel=0.05)


def test_a_current_that_hardly_moves_shows_nothing():
    stretch = driven(0.0)
    still = Stretch(**vars(stretch) | {"current_a": np.full(stretch.time_s.size, 40.0)})
    branches = np.array([slow_current(still.time_s, still.current_a, float(tau_s.mean())) for tau_s in MODEL.tau_s])
    assert shown_current(still, MODEL, branches) is None
