from dataclasses import replace

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.health.cell_finding import CellFinding
from app.estimation.health.cell_watch import CellWatchMemory
from app.estimation.health.charge_watch import STATES, ChargeMemory
from app.estimation.health.joint_watch import LooseJoints
from app.live.learned_state import LearnedState, digest_of, load_learned_state, save_learned_state
from app.live.prediction import Predictor
from app.live.remembered_charge import MasterCount, RememberedCharge
from firmware_protocol.memory_map import N_CELLS

CELL = load_cell("samsung-25r-10p")
NAN = float("nan")
COUNT = MasterCount(uptime_ms=5000, drawn_ah=7.5, soc=0.7)
FACTOR = np.linspace(0.9, 1.7, N_CELLS)


def state(resistance):
    cells = replace(Predictor(CELL, (12,) * 8).learned_cells, resistance=resistance)
    return LearnedState(RememberedCharge(10, np.full(N_CELLS, 0.7), np.full(N_CELLS, 0.01), COUNT), cells)


def test_learned_resistances_survive_a_restart_and_are_counted_with_at_once(tmp_path):
    file = tmp_path / "past.npz"
    save_learned_state(file, state(np.array((FACTOR, np.full(N_CELLS, 0.02)))))
    predictor = Predictor(CELL, (12,) * 8, load_learned_state(file, 96).cells)
    assert predictor.learned.has_resistance.all()
    np.testing.assert_allclose(predictor.learned.resistance_factor, FACTOR)


def test_resistances_learned_against_another_cell_file_are_dropped_with_a_message(tmp_path, caplog):
    file = tmp_path / "past.npz"
    learned = state(np.array((FACTOR, np.full(N_CELLS, 0.02))))
    save_learned_state(file, replace(learned, cell_file=digest_of(CELL)))
    assert load_learned_state(file, 96, CELL).cells.resistance is not None
    assert not caplog.records
    other = load_learned_state(file, 96, load_cell("panasonic-ncr18650pf"))
    assert other.cells.resistance is None
    np.testing.assert_array_equal(other.cells.capacity_state, learned.cells.capacity_state)
    assert "another cell file" in caplog.text


def test_a_file_of_an_older_version_knows_no_resistances_and_is_read(tmp_path):
    file = tmp_path / "past.npz"
    save_learned_state(file, state(None))
    with np.load(file) as new:
        old = {name: new[name] for name in new if name != "resistance"}
    np.savez(file, **old)
    found = load_learned_state(file, 96)
    assert found.charge.soc[0] == 0.7
    assert not Predictor(CELL, (12,) * 8, found.cells).learned.has_resistance.any()


@pytest.mark.parametrize("count", [COUNT, MasterCount(soc=0.6), MasterCount()])
def test_the_master_s_count_survives_a_restart(tmp_path, count):
    file = tmp_path / "past.npz"
    before = state(None)
    save_learned_state(file, replace(before, charge=replace(before.charge, count=count)))
    assert load_learned_state(file, 96).charge.count == count


def test_what_was_found_of_cells_and_their_charge_survives_a_restart(tmp_path):
    file = tmp_path / "past.npz"
    found = CellFinding("self-discharge-high", 22, 0.02, 0.003, "A", 1e9, 1.1e9, 1e5, NAN, 0.02, 0.0, (21, 23), 0.99)
    charge = ChargeMemory(1.1e9, 1e5, 0.8, np.full((STATES, N_CELLS), 0.5), np.ones((STATES, STATES, N_CELLS)))
    loose = LooseJoints(np.where(np.arange(N_CELLS) == 63, 14e-3, NAN), np.full(N_CELLS, 1e-4))
    watch = CellWatchMemory(np.zeros(N_CELLS), loose, charge, (found,))
    before = state(None)
    save_learned_state(file, replace(before, cells=replace(before.cells, watch=watch)))
    predictor = Predictor(CELL, (12,) * 8, load_learned_state(file, 96).cells)
    assert [(each.code, each.cell, each.size, each.since) for each in predictor.findings] == [
        ("self-discharge-high", 22, 0.02, 1e9)
    ]
    kept = predictor.learned_cells.watch
    np.testing.assert_array_equal(kept.charge.mean, charge.mean)
    np.testing.assert_array_equal(kept.loose.excess_ohm, loose.excess_ohm)


def test_a_file_of_an_older_version_knows_the_joints_alone(tmp_path):
    file = tmp_path / "past.npz"
    save_learned_state(file, state(None))
    with np.load(file) as new:
        old = {name: new[name] for name in new if not name.startswith(("findings", "loose", "charge"))}
    np.savez(file, **old)
    assert Predictor(CELL, (12,) * 8, load_learned_state(file, 96).cells).findings == ()


@pytest.mark.parametrize(
    ("kept", "value", "code"),
    [
        ("joint-grown", 0.016, "joint-resistance-high"),
        ("thermistor-off", 80.0, "temperature-sensor-fault"),
        ("thermistor-off", NAN, "temperature-sensor-open"),
        ("channel-stuck", NAN, "cell-voltage-missing"),
    ],
)
def test_a_finding_that_an_older_version_kept_has_today_s_code(tmp_path, kept, value, code):
    file = tmp_path / "past.npz"
    found = CellFinding(kept, 22, 0.02, 0.003, "ohm", 1e9, 1.1e9, 1e5, NAN, value, 0.0, (21, 23), 0.99)
    before = state(None)
    watch = CellWatchMemory(np.zeros(N_CELLS), findings=(found,))
    save_learned_state(file, replace(before, cells=replace(before.cells, watch=watch)))
    assert [each.code for each in load_learned_state(file, 96).cells.watch.findings] == [code]
