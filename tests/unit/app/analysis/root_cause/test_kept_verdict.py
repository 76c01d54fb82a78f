"""A verdict is made once and kept with its session; a file from elsewhere is not trusted, a short one is revised."""

import json
from dataclasses import asdict

import numpy as np
import pytest

from app.analysis.root_cause.from_session import causes_of, incidents_of, is_later_evidence, make_verdict, verdict_of
from app.analysis.root_cause.kept_verdict import keep_verdict, kept_verdicts
from app.estimation.cell_model.cell_file import load_cell
from app.sessions.errors import RecordingFailed
from app.sessions.reading.reader import SessionFile
from app.sessions.reading.session_info import write_note

CELL, WALL_NS = load_cell("samsung-25r-10p"), 1_790_000_100 * 10**9
KEY = "verdict 20260921T141335.000Z-trip-cell-undervoltage"


@pytest.fixture
def tripped(make_session):
    time_s = np.arange(0.0, 30.0, 0.1)
    event = {"severity": "trip", "code": "trip-cell-undervoltage", "text": "under", "cell": 3, "at_s": 15.0}
    return make_session(time_s, np.full(300, 50.0), 3.7, 25, 0.8, events=[event])


def made(path):
    with SessionFile(path) as session:
        (group,) = incidents_of(session)
        return group, make_verdict(session, group, CELL, WALL_NS)


def test_a_verdict_is_kept_with_the_session_and_made_once(tripped, monkeypatch):
    group, verdict = made(tripped)
    monkeypatch.setattr("app.analysis.root_cause.from_session.judge", lambda *_: pytest.fail("judged again"))
    with SessionFile(tripped) as session:
        assert kept_verdicts(session, group) == [verdict]
        assert verdict_of(session, group) == verdict


def test_the_causes_of_a_session_are_the_verdicts_that_it_keeps(tripped):
    _, verdict = made(tripped)
    row = asdict(verdict) | {"code": "overload", "confidence": 0.7}
    write_note(tripped, KEY, [row], t_wall_ns=WALL_NS, who=None)
    with SessionFile(tripped) as session:
        assert [(each.code, each.confidence) for each in causes_of(session)][:1] == [("overload", 0.7)]


def test_a_verdict_that_lacked_the_seconds_after_the_trip_is_revised_with_its_time(tripped):
    group, verdict = made(tripped)
    early = asdict(verdict) | {"judged": verdict.judged - 4.0, "code": "overload"}
    write_note(tripped, KEY, [early], t_wall_ns=WALL_NS, who=None)
    _, revised = made(tripped)
    assert (revised.code, revised.judged, revised.revised) == (verdict.code, verdict.judged, True)
    with SessionFile(tripped) as session:
        assert [each.code for each in kept_verdicts(session, group)] == ["overload", verdict.code]
        assert verdict_of(session, group) == revised


@pytest.mark.parametrize(
    "change",
    [{"cell": 96}, {"cell": "3"}, {"size": "much"}, {"code": 3}, {"unit": 3}, {"others": 3}, {"revised": "yes"}],
)
def test_what_another_program_wrote_is_no_verdict(tripped, change):
    group, verdict = made(tripped)
    for value in ([asdict(verdict) | change], json.dumps(change), {"a": 1}, [3], 7):
        write_note(tripped, KEY, value, t_wall_ns=WALL_NS, who=None)
        with SessionFile(tripped) as session:
            assert kept_verdicts(session, group) == []
            assert verdict_of(session, group) == verdict


def test_a_file_that_takes_nothing_costs_the_note_and_not_the_verdict(tripped, monkeypatch, caplog):
    def refuse(*_, **__):
        raise RecordingFailed("read only")

    monkeypatch.setattr("app.analysis.root_cause.from_session.keep_verdict", refuse)
    group, verdict = made(tripped)
    assert verdict.code == "unknown"
    assert "was not written" in caplog.text
    with SessionFile(tripped) as session:
        assert kept_verdicts(session, group) == []
    keep_verdict(tripped, group, verdict, (), t_wall_ns=WALL_NS)
    with SessionFile(tripped) as session:
        assert kept_verdicts(session, group) == [verdict]


def test_a_trip_that_nothing_explained_is_explained_by_driving_on(make_session):
    """The joint parts as the current ends: only the drive after the trip shows it."""
    time_s = np.arange(0.0, 110.0, 0.2)
    is_driving = (time_s < 30.0) | (time_s > 50.0)
    current_a = np.where((time_s // 4) % 2 == 0, 90.0, 10.0) * is_driving
    voltage_v = np.repeat((3.8 - 2e-3 * current_a)[:, None], 96, axis=1)
    voltage_v[:, 3] -= np.where(time_s > 29.9, 3e-3 * current_a, 0.0)
    trip = {"severity": "trip", "code": "trip-cell-undervoltage", "text": "under", "cell": 3, "at_s": 30.5}
    mean = {"i_fc": np.round(100 * current_a).astype(int)[:, None]}
    path = make_session(time_s, current_a, voltage_v, 25, 0.8, events=[trip], fields=mean, closed=False)
    with SessionFile(path) as session:
        (group,) = incidents_of(session)
        verdict = verdict_of(session, group)
    assert (verdict.code, verdict.cell, verdict.revised) == ("joint-resistance-high", 3, True)
    assert verdict.judged - verdict.at > 60.0
    assert verdict.low <= 3e-3 <= verdict.high


@pytest.mark.parametrize(
    ("code", "cell", "counts"),
    [
        ("finding-joint-resistance-high", 3, True),
        ("finding-joint-resistance-high", 4, False),
        ("finding-ended", 3, False),
        ("joint-resistance-high", 3, False),
        ("finding-joint-resistance-high", None, False),
    ],
)
def test_what_is_found_of_the_cell_that_tripped_is_later_evidence(code, cell, counts):
    assert is_later_evidence(code, cell, 3) == counts
