"""A lesson: corrected line by line, checked, with what each line reads."""

import math
import time
import tomllib

import can
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.frames import frames_of
from app.sources.dbc.learn.lesson import Correction, Lesson
from app.sources.dbc.learn.lines import Choice
from app.sources.dbc.learn.profile_text import profile_text
from app.sources.dbc.listening import BusListener
from tests.naming_habits import letters_in_numbered_messages

PEER = letters_in_numbered_messages()
DEFINITIONS = parse_definitions(PEER.dbc().encode(), "x.dbc")
FRAMES = PEER.frames(3.0)


@pytest.fixture(scope="module")
def lesson():
    return Lesson(DEFINITIONS, ("x.dbc",), frames_of(FRAMES), "x")


def test_each_line_has_what_it_reads_also_those_that_are_not_taken(lesson):
    learned, doubts = lesson.learned(Correction())
    running = lesson.running(learned)
    assert doubts == []
    assert set(running) == set(learned.lines)
    assert len(running["voltage"].values) == 160
    assert running["voltage"].values[7] == pytest.approx(PEER.voltage(7, 2.9), abs=0.001)
    assert running["current"].values == (pytest.approx(PEER.current(2.98), abs=0.02),)
    closed = running["state.closed"]
    assert (closed.values, closed.raw, closed.text) == ((1.0,), 2, "TS_ACTIVE")
    assert 0 <= running["voltage"].age_s < 0.2


def test_a_correction_changes_the_suggestion_and_is_checked(lesson):
    learned, doubts = lesson.learned(Correction(choices={"current": Choice(is_taken=False)}))
    assert "current" not in learned.readings
    assert [each.what.code for each in doubts] == ["check-no-current"]
    learned, doubts = lesson.learned(Correction("ours", (40,) * 4, 3))
    assert (learned.battery.name, learned.battery.segments, learned.battery.parallel) == ("ours", (40,) * 4, 3)


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("[battery", "TOML"),
        ('[battery]\nname = "x"\nsegments = [0]\n[source]\ndbc = "x.dbc"\n', "battery.segments"),
        ('[battery]\nname = "x"\nsegments = [1]\n[source]\nkind = "master"\n', "source.kind"),
    ],
)
def test_errors_of_an_edited_text_are_told_with_their_field(lesson, text, field):
    assert [(each.field, each.is_error) for each in lesson.check(text)] == [(field, True)]


def test_a_bus_goes_on_to_be_heard():
    with can.Bus("voltwall-lesson", interface="virtual") as bus:
        lesson = Lesson(DEFINITIONS, ("x.dbc",), frames_of(FRAMES), "x")
        lesson.listener = BusListener("virtual:voltwall-lesson")
        learned, _ = lesson.learned(Correction())
        assert lesson.running(learned) == {}
        can_id, data = next((i, data) for _, i, data in FRAMES if i == 0x650)
        deadline_s = time.monotonic() + 10
        while not lesson.running(learned) and time.monotonic() < deadline_s:
            bus.send(can.Message(arbitration_id=can_id, is_extended_id=False, data=data))
        assert "current" in lesson.running(learned)
        lesson.close()


def test_nobody_asks_and_the_bus_is_given_free():
    with can.Bus("voltwall-idle", interface="virtual"):
        listener = BusListener("virtual:voltwall-idle", idle_s=0.0)
        listener.wait(30)  # ends at once
        listener.close()


def test_the_same_correction_is_learned_once(lesson):
    first, _ = lesson.learned(Correction(choices={"soc": Choice(is_taken=False)}))
    assert lesson.learned(Correction(choices={"soc": Choice(is_taken=False)}))[0] is first
    assert lesson.learned(Correction())[0] is not first


def test_fewer_cells_than_the_signals_have_is_told_at_the_signals(lesson):
    _, doubts = lesson.learned(Correction(segments=(40,)))
    assert "source.voltage[0].signal" in {each.field for each in doubts}


def test_more_cells_than_the_signals_have_is_told_as_well(lesson):
    _, doubts = lesson.learned(Correction(segments=(200,)))
    assert "source.voltage" in {each.field for each in doubts}


def test_the_edited_text_is_checked_by_what_was_heard_and_not_by_what_is_suggested(lesson):
    learned, _ = lesson.learned(Correction())
    text = profile_text(learned)
    assert lesson.check(text) == []
    wrong = lesson.check(text.replace("\nsegments", "\nsegment", 1))
    assert wrong
    assert all(each.is_error for each in wrong)


def test_without_frames_nothing_runs_and_a_profile_is_suggested_all_the_same():
    silent = Lesson(DEFINITIONS, ("x.dbc",), frames_of([]), "x")
    learned, _ = silent.learned(Correction())
    assert learned.battery.n_cells == PEER.n_cells
    assert silent.running(learned) == {}
    silent.close()


def test_a_cell_that_was_not_heard_has_no_value_and_not_zero():
    some = [each for each in FRAMES if each[1] != next(i for _, i, _ in FRAMES)]
    lesson = Lesson(DEFINITIONS, ("x.dbc",), frames_of(some), "x")
    running = lesson.running(lesson.learned(Correction(segments=(40,) * 4))[0])
    assert all(value is None or value > 2.0 for value in running["voltage"].values)


@settings(max_examples=6, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(sorted({i for _, i, _ in FRAMES})), st.binary(max_size=8)), max_size=60))
def test_whatever_a_bus_says_a_lesson_has_a_suggestion_that_can_be_read_or_none(said):
    lesson = Lesson(DEFINITIONS, ("x.dbc",), frames_of([(k * 10**6, i, d) for k, (i, d) in enumerate(said)]), "x")
    learned, doubts = lesson.learned(Correction())
    if learned is None:
        assert doubts == []
        return
    tomllib.loads(profile_text(learned))
    for key, each in lesson.running(learned).items():
        assert key in learned.lines
        assert all(value is None or math.isfinite(value) for value in each.values)
