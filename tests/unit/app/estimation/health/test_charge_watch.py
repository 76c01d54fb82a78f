import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.errors import EstimatorError, ShapeError
from app.estimation.health.charge_watch import ChargeMemory, ChargeWatch
from app.estimation.health.packs import Packs
from tests.campaign import of_size

N, PER_PACK = 24, 12
SEGMENTS = Packs((PER_PACK,) * (N // PER_PACK))
DT_S = 1.0
OHM = 3.5e-3
DAY_S = 86_400.0


class Pack:
    """Cells that follow the cell file's OCV, with a resistance, a capacity each and what leaks; seen with noise."""

    def __init__(self, watch=None, seed=1, n_cells=N, per_pack=PER_PACK):
        self.cell, self.n = load_cell(), n_cells
        self.rng = np.random.default_rng(seed)
        self.watch = watch or ChargeWatch(self.cell, Packs((per_pack,) * (n_cells // per_pack)))
        self.soc = 0.8 + 0.004 * self.rng.normal(size=n_cells)
        self.capacity_ah = self.cell.capacity_ah * (1 + 0.01 * self.rng.normal(size=n_cells))
        self.leak_a = np.zeros(n_cells)
        self.bias_v = 4e-4 * self.rng.normal(size=n_cells)
        self.time_s = 0.0
        self.balancing = None
        self.spoil = {}  # what channels show instead

    def pass_time(self, seconds, current_a=0.0):
        """Let time pass unseen."""
        self.time_s += seconds
        self.soc -= (current_a + self.leak_a) * seconds / 3600 / self.capacity_ah

    def run(self, seconds, currents_a=(0.0,)):
        """Let time pass with a current every 5 s, seen by the watch."""
        current_a = 0.0
        for k in range(int(seconds / DT_S)):
            if k % 5 == 0:
                current_a = float(self.rng.choice(currents_a))
            self.sample(current_a)
        return self.watch.drift()

    def sample(self, current_a, dt_s=DT_S):
        """Let the watch see one sample."""
        self.pass_time(dt_s, current_a)
        v = self.cell.ocv.voltage(self.soc) - OHM * (current_a + self.leak_a) + self.bias_v
        v += self.rng.normal(0, 1e-4, self.n)
        v[list(self.spoil)] = list(self.spoil.values())
        self.seen_v = v
        self.watch.step(self.time_s, dt_s, current_a, v, self.balancing)


DRIVING = (-40.0, 0.0, 30.0, 60.0, 120.0)


def certain(drift):
    return np.flatnonzero(drift.leak_a > 5 * drift.leak_noise_a).tolist()


def in_band(value, size, sigma):
    return abs(value - size) <= 3 * sigma


def test_a_small_leak_shows_in_hours_of_rest():
    pack = Pack()
    pack.leak_a[5] = 0.1
    drift = pack.run(4 * 3600)
    assert certain(drift) == [5]
    assert in_band(0.1, drift.leak_a[5], drift.leak_sigma_a[5])


def test_self_discharge_of_two_percent_a_day_shows_from_session_to_session():
    pack = Pack()
    pack.leak_a[5] = 0.02 * pack.cell.capacity_ah / 24
    for _ in range(3):
        drift = pack.run(200)
        pack.run(200, DRIVING)
        pack.run(600)
        pack.pass_time(DAY_S)
        pack.watch = ChargeWatch(pack.cell, SEGMENTS, pack.watch.memory)
    assert certain(drift) == [5]
    assert in_band(pack.leak_a[5], drift.leak_a[5], drift.leak_sigma_a[5])


def test_a_cell_that_is_bled_does_not_leak():
    pack = Pack()
    pack.run(300)
    pack.balancing = np.arange(N) == 5
    pack.leak_a[5] = 0.17
    assert certain(pack.run(3600)) == []


def test_a_missing_cell_is_not_judged_and_spoils_no_other():
    pack = Pack()
    pack.soc[3] = np.nan
    drift = pack.run(3600)
    assert certain(drift) == []


def test_a_memory_of_other_cells_is_refused():
    with pytest.raises(ShapeError):
        ChargeWatch(load_cell(), SEGMENTS, ChargeMemory(0.0, 0.0, 0.5, np.zeros((5, 7)), np.zeros((5, 5, 7))))


@settings(max_examples=of_size(2, 5, 25))
@given(st.integers(0, N - 1), st.floats(3.0, 30.0), st.integers(0, 10**6))
def test_any_short_is_named_for_its_cell_and_sized_within_its_band(cell, leak_a, seed):
    pack = Pack(seed=seed)
    pack.run(120)
    pack.leak_a[cell] = leak_a
    drift = pack.run(300)
    assert certain(drift) == [cell]
    assert in_band(leak_a, drift.leak_a[cell], drift.leak_sigma_a[cell])


@settings(max_examples=of_size(2, 4, 20))
@given(st.integers(0, N - 1), st.floats(0.05, 0.4), st.integers(0, 10**6))
def test_any_lost_capacity_is_inside_its_band_and_is_no_leak(cell, lost, seed):
    pack = Pack(seed=seed)
    pack.capacity_ah[cell] = pack.cell.capacity_ah * (1.0 - lost)
    pack.run(120)
    pack.run(900, DRIVING)
    drift = pack.run(300)
    assert set(np.flatnonzero(drift.lost > 4 * drift.lost_sigma).tolist()) <= {cell}
    assert in_band(lost, drift.lost[cell], drift.lost_sigma[cell])
    assert certain(drift) == []


@settings(max_examples=of_size(2, 4, 20))
@given(st.integers(0, 10**6))
def test_a_sound_pack_shows_nothing_whatever_the_noise(seed):
    pack = Pack(seed=seed)
    pack.run(120)
    pack.run(600, DRIVING)
    drift = pack.run(900)
    assert certain(drift) == []
    assert not (drift.lost > 4 * drift.lost_sigma).any()


@pytest.mark.parametrize("n_cells", [14, 216])
def test_one_pack_of_any_size_has_its_leak_found(n_cells):
    pack = Pack(n_cells=n_cells, per_pack=n_cells)
    pack.run(120)
    pack.leak_a[n_cells - 1] = 6.0
    assert certain(pack.run(300)) == [n_cells - 1]


@pytest.mark.parametrize("jump_s", [-1e5, DAY_S, 1e9])
def test_a_clock_that_is_set_changes_no_leak(jump_s):
    pack = Pack()
    pack.leak_a[5] = 0.2
    before = pack.run(2700)
    assert in_band(0.2, before.leak_a[5], before.leak_sigma_a[5])
    pack.time_s += jump_s
    after = pack.run(900)
    assert certain(after) == [5]
    assert after.leak_a[5] == pytest.approx(before.leak_a[5], rel=0.1)


def test_a_silence_of_unknown_length_is_timed_by_the_labels():
    pack = Pack()
    pack.leak_a[5] = 0.2
    pack.run(300)
    pack.pass_time(DAY_S)
    pack.sample(0.0, dt_s=0.0)
    drift = pack.run(120)
    assert certain(drift) == [5]
    assert in_band(0.2, drift.leak_a[5], drift.leak_sigma_a[5])


def test_a_clock_that_ran_back_while_switched_off_is_no_leak():
    pack = Pack()
    pack.run(600)
    pack.watch = ChargeWatch(pack.cell, SEGMENTS, pack.watch.memory)
    pack.time_s -= DAY_S
    drift = pack.run(600)
    assert certain(drift) == []
    assert pack.watch.evidence_s >= 600.0


@pytest.mark.parametrize("dt_s", [-1.0, np.nan, np.inf])
def test_a_step_of_no_length_is_refused_and_changes_nothing(dt_s):
    pack = Pack()
    pack.run(300)
    before = pack.watch.drift()
    with pytest.raises(EstimatorError, match="dt_s"):
        pack.watch.step(pack.time_s, dt_s, 0.0, np.full(N, 3.9))
    np.testing.assert_array_equal(pack.watch.drift().leak_a, before.leak_a)
    pack.leak_a[5] = 6.0
    assert certain(pack.run(240)) == [5]


def test_a_sample_twice_is_one_sample():
    once, twice = Pack(), Pack()
    for pack in (once, twice):
        pack.leak_a[5] = 6.0
    for _ in range(300):
        once.sample(0.0)
        twice.sample(0.0)
        twice.watch.step(twice.time_s, 0.0, 0.0, twice.seen_v)
    assert twice.watch.drift().leak_a[5] == pytest.approx(once.watch.drift().leak_a[5], rel=0.05)


def test_a_lost_current_sensor_makes_no_leak_of_lost_capacity():
    pack = Pack()
    pack.capacity_ah[5] *= 0.8
    pack.run(300)
    for _ in range(600):
        pack.pass_time(DT_S, 60.0)
        pack.watch.step(pack.time_s, DT_S, np.nan, pack.cell.ocv.voltage(pack.soc) - 0.12)
    drift = pack.run(600)
    assert certain(drift) == []
    assert np.isfinite(drift.leak_a).all()
    pack.leak_a[7] = 6.0
    assert certain(pack.run(300)) == [7]


@pytest.mark.parametrize("voltage_v", [np.nan, 0.0, 65.535])
def test_a_voltage_that_no_cell_has_teaches_nothing(voltage_v):
    pack = Pack()
    pack.run(300)
    pack.spoil = {3: voltage_v}
    drift = pack.run(600)
    pack.spoil = {}
    assert certain(drift) == []
    pack.leak_a[3] = 6.0
    assert certain(pack.run(300)) == [3]


def test_what_a_session_leaves_is_no_window_into_the_watch():
    pack = Pack()
    assert pack.watch.memory is None, "nothing to keep before the first look"
    pack.run(300)
    kept = pack.watch.memory
    before = kept.mean.copy()
    pack.leak_a[5] = 6.0
    pack.run(300)
    np.testing.assert_array_equal(kept.mean, before)


def test_a_leak_is_still_known_after_a_restart_before_anything_is_seen():
    pack = Pack()
    pack.leak_a[5] = 0.2
    before = pack.run(3 * 3600)
    after = ChargeWatch(pack.cell, SEGMENTS, pack.watch.memory).drift()
    assert after.leak_a[5] == pytest.approx(before.leak_a[5], abs=before.leak_sigma_a[5])


def test_what_a_dead_channel_showed_is_forgotten_and_what_leaked_is_not():
    pack = Pack()
    pack.leak_a[5] = 6.0
    before = pack.run(600)
    pack.watch.forget(np.arange(N) == 5)
    np.testing.assert_array_equal(pack.watch.drift().leak_a, before.leak_a)
    pack.soc[5] -= 0.1  # the channel stood still so long
    drift = pack.run(300)
    assert certain(drift) == [5]
    assert in_band(6.0, drift.leak_a[5], drift.leak_sigma_a[5])
