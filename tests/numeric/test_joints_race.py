"""Loose busbar bolts in the simulated race: another author's physics, spread and sensor errors."""

import numpy as np
import pytest

from app.estimation.health.joint_watch import JUDGE_S, JointWatch
from app.estimation.health.packs import Packs
from simulator.accumulator import Accumulator, AccumulatorParameters
from simulator.race import endurance
from tests.campaign import of_size

STEP_S = 0.1


def race(seed, seconds, loose=None, loosens_at_s=0.0):
    """Return (time, cells named) at every judgement, seen through filtered and noisy sensors."""
    rng = np.random.default_rng(seed)
    accumulator = Accumulator(AccumulatorParameters(start_soc=0.9), rng)
    event = endurance(rng, n_laps=10)
    bias_v = np.clip(4e-4 * rng.normal(size=96), -1.2e-3, 1.2e-3)
    watch, seen_v, verdicts = JointWatch(Packs((12,) * 8)), None, []
    for k in range(int(seconds / STEP_S)):
        if loose is not None and k * STEP_S >= loosens_at_s:
            accumulator.extra_joint_ohm[loose] = 3e-4
        current = event.current_a(k * STEP_S, accumulator)
        accumulator.step(STEP_S, current, fan_duty=0.5)
        sample = accumulator.terminal_voltage_v + bias_v + 1e-4 * rng.normal(size=96)
        seen_v = sample if seen_v is None else seen_v + 0.6 * (sample - seen_v)
        sensed_a = 1.003 * np.round((current + 0.16 * rng.normal()) / 0.2424) * 0.2424 + 0.2
        watch.step(STEP_S, sensed_a, np.round(seen_v, 4))
        if k % round(JUDGE_S / STEP_S) == 0:
            watch.judge()
            verdicts.append((k * STEP_S, np.flatnonzero(watch.loose).tolist()))
    return verdicts


@pytest.mark.parametrize("seed", range(of_size(1, 3, 8, 40)))
def test_clean_race_names_no_joint(seed):
    assert not any(named for _, named in race(seed, 240.0))


@pytest.mark.parametrize(("seed", "cell"), [(1, 30), (2, 0), (3, 95), (4, 47)][: of_size(2, 4, 4)])
def test_loose_bolt_is_named_within_one_lap(seed, cell):
    verdicts = race(seed, 180.0, loose=cell, loosens_at_s=110.0)
    assert not any(named for at_s, named in verdicts if at_s < 110.0)
    assert verdicts[-1][1] == [cell]
