"""A session is replayed with the cell file of then, and its cells' past is known after a jump."""

import numpy as np
import pytest

from app.analysis.replay import cause_of_trip_at, pipelines_of
from app.errors import ConfigError
from app.estimation.cell_model.cell_file import format_cell, load_cell
from app.live.pipeline_factory import PipelineFactory
from app.sessions.reading.reader import SessionFile
from app.sessions.replay import SESSION_CELL, ReplayOptions
from tests.recorded.arrays import START_S

OF_THEN = load_cell("sanyo-ur18650w")
OWN = format_cell(OF_THEN)
TIME_S = np.arange(0.0, 120.0, 0.5)
CURRENT_A = np.where(TIME_S > 5, 60 + 50 * np.sin(TIME_S), 0.0)


@pytest.fixture
def session(make_session):
    def session(cell_file=OWN):
        volts = 3.7 - CURRENT_A[:, None] * np.full(96, 0.002)
        volts[TIME_S > 40, 30] = 3.65
        opened.append(SessionFile(make_session(TIME_S, CURRENT_A, volts, cell_file=cell_file)))
        return opened[-1]

    opened = []
    yield session
    for each in opened:
        each.close()


def pipelines(session, **options):
    return pipelines_of(PipelineFactory("coulomb", "samsung-25r-10p"), session, ReplayOptions(**options))


def capacity_ah(pipeline, master):
    pipeline.feed(master.frame())
    return float(pipeline._estimator.capacity()[0].mean())


@pytest.mark.parametrize(
    ("chosen", "cell_file", "name", "expected"),
    [
        (None, OWN, SESSION_CELL, OF_THEN),
        (SESSION_CELL, OWN, SESSION_CELL, OF_THEN),
        (None, None, "samsung-25r-10p", load_cell("samsung-25r-10p")),
        (SESSION_CELL, None, "samsung-25r-10p", load_cell("samsung-25r-10p")),
        ("lco-pouch", OWN, "lco-pouch", load_cell("lco-pouch")),
    ],
)
def test_the_cell_is_that_of_then_unless_another_is_chosen_or_none_was_kept(
    session, master, chosen, cell_file, name, expected
):
    pipeline = pipelines(session(cell_file), cell_name=chosen)(None)
    assert pipeline.cell_name == name
    assert capacity_ah(pipeline, master) == pytest.approx(expected.capacity_ah)


def test_a_filter_that_is_none_is_refused(session):
    with pytest.raises(ConfigError):
        pipelines(session(), filter_name="kalman")


def test_after_a_jump_the_findings_of_before_are_known(session, master):
    pipeline = pipelines(session())
    (stuck,) = pipeline(START_S + 110.0).feed(master.frame()).snapshot.findings
    assert stuck.code == "cell-voltage-stuck"
    assert pipeline(START_S + 30.0).feed(master.frame()).snapshot.findings == ()


def test_a_session_without_a_trip_has_no_cause(session):
    assert cause_of_trip_at(session(), START_S + 100.0) is None
