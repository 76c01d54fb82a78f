"""The recordings of pure physics that benchmarks/pybamm_recordings.py makes."""

import numpy as np
import pytest

from app.sources.recordings.dataset import load_recording
from tests.numeric.pybamm_cells import CELLS, held, race_current, save, simulate


def test_levels_follow_each_other_for_their_time():
    np.testing.assert_array_equal(held([(0.0, 2.0), (3.0, 1.0)], 0.5), [0, 0, 0, 0, 3, 3])


@pytest.mark.parametrize("cell", CELLS.values(), ids=lambda cell: cell.name)
def test_a_race_rests_first_stays_within_the_peak_and_draws_its_mean(cell):
    current = race_current(cell, 2) / cell.capacity_ah
    assert (current[:190] == 0.0).all()
    assert (current[-500:] == 0.0).all()
    assert current.max() <= 1.4 * cell.peak_c
    assert current.min() < 0.0
    assert current[200:-600].mean() == pytest.approx(cell.mean_c, rel=0.15)
    assert (race_current(cell, 2) / cell.capacity_ah == current).all()


def test_a_simulated_pulse_costs_charge_voltage_and_heat_and_reads_back(tmp_path):
    pytest.importorskip("pybamm", reason="PyBaMM is the extra voltwall[pybamm], 800 MB")
    cell = CELLS["Ecker2015"]
    current = held([(0.0, 10.0), (2.0 * cell.capacity_ah, 30.0), (0.0, 20.0)], 1.0)
    found = simulate(cell, current, 1.0, 0.8, 25.0, False, "pulse")
    save(found, tmp_path / "pulse.csv.gz")
    read = load_recording(tmp_path / "pulse.csv.gz")
    assert read.soc[0] - read.soc[-1] == pytest.approx(2.0 * 30.0 / 3600.0, rel=0.05)
    assert read.voltage_v[35] < read.voltage_v[5] - 0.01
    assert read.voltage_v[-1] > read.voltage_v[38]
    assert read.temperature_degc[38] >= read.temperature_degc[5]
