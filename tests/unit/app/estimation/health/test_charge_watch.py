import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.errors import ShapeError
from app.estimation.health.charge_watch import ChargeMemory, ChargeWatch

N, PER_PACK = 24, 12
DT_S = 1.0
DAY_S = 86_400.0


class Pack:
    """Cells that follow the cell file's OCV, with a resistance, a capacity each and what leaks; seen with noise."""

    def __init__(self, watch=None, seed=1):
        self.cell = load_cell()
        self.rng = np.random.default_rng(seed)
        self.watch = watch or ChargeWatch(self.cell, N, PER_PACK)
        self.soc = 0.8 + 0.004 * self.rng.normal(size=N)
        self.capacity_ah = self.cell.capacity_ah * (1 + 0.01 * self.rng.normal(size=N))
        self.leak_a = np.zeros(N)
        self.bias_v = 4e-4 * self.rng.normal(size=N)
        self.time_s = 0.0
        self.balancing = None

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
            self.pass_time(DT_S, current_a)
            v = self.cell.ocv.voltage(self.soc) - 2e-3 * (current_a + self.leak_a) + self.bias_v
            v += self.rng.normal(0, 1e-4, N)
            self.watch.step(self.time_s, DT_S, current_a, v, self.balancing)
        return self.watch.drift()


DRIVING = (-40.0, 0.0, 30.0, 60.0, 120.0)


def certain(drift):
    return np.flatnonzero(drift.leak_a > 5 * drift.leak_noise_a).tolist()


def in_band(value, size, sigma):
    return abs(value - size) <= 3 * sigma


@pytest.mark.parametrize("leak_a", [4.0, 6.0, 20.0])
def test_a_short_that_begins_at_rest_is_sized_within_minutes(leak_a):
    pack = Pack()
    pack.run(120)
    pack.leak_a[5] = leak_a
    drift = pack.run(240)
    assert certain(drift) == [5]
    assert in_band(leak_a, drift.leak_a[5], drift.leak_sigma_a[5])


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
        pack.watch = ChargeWatch(pack.cell, N, PER_PACK, pack.watch.memory)
    assert certain(drift) == [5]
    assert in_band(pack.leak_a[5], drift.leak_a[5], drift.leak_sigma_a[5])


def test_lost_capacity_is_no_leak():
    pack = Pack()
    pack.capacity_ah[5] *= 0.7
    pack.run(120)
    pack.run(900, DRIVING)
    drift = pack.run(600)
    assert certain(drift) == []
    assert in_band(0.3, drift.lost[5], drift.lost_sigma[5])
    assert np.flatnonzero(drift.lost > 4 * drift.lost_sigma).tolist() == [5]


def test_sound_cells_leak_nothing():
    pack = Pack(seed=4)
    pack.run(120)
    pack.run(600, DRIVING)
    assert certain(pack.run(3600)) == []


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
        ChargeWatch(load_cell(), N, PER_PACK, ChargeMemory(0.0, 0.0, 0.5, np.zeros((5, 7)), np.zeros((5, 5, 7))))
