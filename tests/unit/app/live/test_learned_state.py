from dataclasses import replace

import numpy as np

from app.estimation.cell_model.cell_file import load_cell
from app.live.learned_state import LearnedState, load_learned_state, save_learned_state
from app.live.prediction import Predictor
from firmware_protocol.memory_map import N_CELLS

CELL = load_cell("samsung-25r-10p")
FACTOR = np.linspace(0.9, 1.7, N_CELLS)


def state(resistance):
    cells = replace(Predictor(CELL, N_CELLS).learned_cells, resistance=resistance)
    return LearnedState(10, np.full(N_CELLS, 0.7), np.full(N_CELLS, 0.01), cells)


def test_learned_resistances_survive_a_restart_and_are_counted_with_at_once(tmp_path):
    file = tmp_path / "past.npz"
    save_learned_state(file, state(np.array((FACTOR, np.full(N_CELLS, 0.02)))))
    predictor = Predictor(CELL, N_CELLS, load_learned_state(file).cells)
    assert predictor.learned.has_resistance.all()
    np.testing.assert_allclose(predictor.learned.resistance_factor, FACTOR)


def test_a_file_of_an_older_version_knows_no_resistances_and_is_read(tmp_path):
    file = tmp_path / "past.npz"
    save_learned_state(file, state(None))
    with np.load(file) as new:
        old = {name: new[name] for name in new if name != "resistance"}
    np.savez(file, **old)
    found = load_learned_state(file)
    assert found.soc[0] == 0.7
    assert not Predictor(CELL, N_CELLS, found.cells).learned.has_resistance.any()
