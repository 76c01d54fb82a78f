"""A lesson: corrected line by line, checked, with what each line reads."""

import time

import can
import pytest

from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.frames import frames_of
from app.sources.dbc.learn.lesson import Correction, Lesson
from app.sources.dbc.learn.lines import Choice
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
