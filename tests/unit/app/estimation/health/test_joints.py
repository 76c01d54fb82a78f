import numpy as np
import pytest

from app.estimation.errors import ShapeError
from app.estimation.health.joints import judge_joints
from app.estimation.health.packs import Packs
from app.estimation.health.resistance_tracker import ResistanceTracker

R0, R1, TAU = 1.7e-3, 1.2e-3, 9.0
SEGMENTS = Packs((12,) * 8)


def lap(rng, seconds=80.0, dt=0.1):
    current = []
    while len(current) * dt < seconds:
        current += [rng.uniform(60, 220)] * int(rng.uniform(5, 25)) + [-rng.uniform(0, 60)] * int(rng.uniform(5, 20))
        current += [rng.uniform(0, 20)] * int(rng.uniform(3, 15))
    return np.array(current[: int(seconds / dt)])


def drive(seed=0, joint=None, growth=None, spread=0.03, joint_spread=0.08, laps=1, noise_v=1e-3, dt=0.1, pattern=0.0):
    """Return tracker and truth after some laps of 96 cells with cell, joint, RC pair, noise and quantised voltage."""
    rng = np.random.default_rng(seed)
    cells = (1 + spread * rng.normal(size=96)) * (1.0 if growth is None else growth)
    joints = 3.5e-4 * (1 + joint_spread * rng.normal(size=96)) + (0.0 if joint is None else joint)
    joints = joints + np.tile(np.where(np.arange(12) == 11, pattern, 0.0), 8)
    tracker = ResistanceTracker(96)
    branch = 0.0
    for current in np.concatenate([lap(rng, dt=dt) for _ in range(laps)]):
        branch += (1 - np.exp(-dt / TAU)) * (current - branch)
        v = 3.8 - cells * (R0 * current + R1 * branch) - joints * current + noise_v * rng.normal(size=96)
        tracker.step(dt, current + rng.normal(), np.round(v, 4))
    return tracker, R0 * cells + joints


def report(tracker, **more):
    return judge_joints(tracker.resistance_ohm(), tracker.sigma_ohm(), SEGMENTS, **more)


def loosened(cell, ohm=3e-4):
    joint = np.zeros(96)
    joint[cell] = ohm
    return joint


def test_resistance_is_that_of_cell_and_joint_and_the_pair_stands_apart():
    tracker, truth = drive()
    ohmic, pair = tracker.resistance_ohm()
    np.testing.assert_allclose(ohmic, truth, rtol=0.02)
    assert np.std(ohmic - truth) < 3 * tracker.sigma_ohm()[0].mean()
    assert pair.mean() == pytest.approx(R1, rel=0.25)


@pytest.mark.parametrize("cell", [0, 50, 95])
def test_loose_bolt_is_named_within_one_lap(cell):
    tracker, _ = drive(seed=cell, joint=loosened(cell))
    assert np.flatnonzero(report(tracker).is_loose).tolist() == [cell]
    assert report(tracker).joint_excess_ohm[cell] == pytest.approx(3e-4, abs=1.3e-4)


@pytest.mark.parametrize("seed", range(3))
def test_sound_cars_have_no_loose_bolt(seed):
    tracker, _ = drive(seed=seed)
    assert not report(tracker).is_loose.any()


def test_longer_busbar_at_every_pack_end_is_no_loose_bolt():
    tracker, _ = drive(pattern=4e-4)
    assert not report(tracker).is_loose.any()
    tracker, _ = drive(pattern=4e-4, joint=loosened(23))
    assert np.flatnonzero(report(tracker).is_loose).tolist() == [23]


def test_aged_cell_is_told_from_a_loose_joint():
    growth = np.ones(96)
    growth[40] = 1.6
    tracker, _ = drive(growth=growth)
    found = report(tracker)
    assert found.cell_growth_frac[40] > 0.3
    assert found.joint_excess_ohm[40] < 0.5 * 0.6 * R0


def test_warm_pack_is_no_loose_bolt():
    growth = np.ones(96)
    growth[24:36] = 0.8
    tracker, _ = drive(growth=growth)
    assert not report(tracker, temperature_factor=growth).is_loose.any()
    assert not report(tracker).is_loose.any()


def test_known_baseline_is_taken_off():
    before = report(drive(joint=loosened(7))[0]).joint_excess_ohm
    assert not report(drive(joint=loosened(7), seed=3)[0], baseline_ohm=before).is_loose.any()


def test_missing_cell_stays_unknown_and_others_do_not_suffer():
    rng = np.random.default_rng(2)
    tracker = ResistanceTracker(96)
    for current in lap(rng):
        v = np.full(96, 3.8 - R0 * current)
        v[5] = np.nan
        tracker.step(0.1, current, v)
    assert np.isnan(tracker.resistance_ohm()[0, 5])
    assert tracker.resistance_ohm()[0, 6] == pytest.approx(R0, rel=1e-6)
    assert not report(tracker).is_loose.any()


def test_another_number_of_cells_is_refused():
    with pytest.raises(ShapeError):
        judge_joints(np.zeros((2, 13)), np.zeros((2, 13)), SEGMENTS)


def test_no_current_no_verdict():
    tracker = ResistanceTracker(96)
    for _ in range(100):
        tracker.step(0.1, 0.0, np.full(96, 3.8))
    assert np.isnan(tracker.resistance_ohm()).all()
    assert not report(tracker).is_loose.any()
