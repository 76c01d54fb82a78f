"""What was learned is saved every five minutes and at the end, once there is an estimate."""

import threading

import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.live.learned_state import load_learned_state
from app.live.pipeline_factory import PipelineFactory
from app.live.prediction import Predictor
from app.service import learned_state_saver
from app.service.learned_state_saver import EVERY_S, LearnedStateSaver
from tests.service_process import WAIT_S, until


@pytest.fixture
def predictor():
    return Predictor(load_cell("samsung-25r-10p"), (12,) * 8)


@pytest.fixture
def pipeline(predictor):
    return PipelineFactory("coulomb", "samsung-25r-10p").pipeline("serial", predictor=predictor)


def test_before_the_first_estimate_nothing_is_saved(tmp_path, pipeline, predictor, clock):
    LearnedStateSaver(tmp_path / "cells.npz", pipeline, predictor, clock).save()
    assert not (tmp_path / "cells.npz").exists()


def test_it_is_saved_after_five_minutes_and_not_before(tmp_path, pipeline, predictor, clock, master):
    path = tmp_path / "cells.npz"
    saver = LearnedStateSaver(path, pipeline, predictor, clock)
    output = pipeline.feed(master.frame())
    clock.advance(EVERY_S)
    saver.on_output(output, clock.monotonic_ns())
    assert not path.exists()
    clock.advance(1)
    saver.on_output(output, clock.monotonic_ns())
    until(path.exists)
    found = load_learned_state(path, 96)
    assert found.charge.t_wall_ns == output.snapshot.t_wall_ns, "when it was measured, not when it was saved"
    assert found.charge.soc == pytest.approx(pipeline.estimates.soc)
    path.unlink()
    clock.advance(1)
    saver.on_output(output, clock.monotonic_ns())
    assert not path.exists()


def test_a_disk_that_hangs_delays_no_output_and_is_asked_once(
    tmp_path, pipeline, predictor, clock, master, monkeypatch
):
    go_on, asked = threading.Event(), []

    def hang(path, state):
        asked.append(state)
        assert go_on.wait(WAIT_S)

    monkeypatch.setattr(learned_state_saver, "save_learned_state", hang)
    saver = LearnedStateSaver(tmp_path / "cells.npz", pipeline, predictor, clock)
    output = pipeline.feed(master.frame())
    for _ in range(3):
        clock.advance(EVERY_S + 1)
        saver.on_output(output, clock.monotonic_ns())
    assert len(asked) == 1
    go_on.set()
    saver.save()
    assert len(asked) == 2
