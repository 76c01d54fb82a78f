"""Lines of a suggestion, and a person's corrections of them."""

import pytest

from app.battery.profile import read_document, understand
from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.frames import frames_of
from app.sources.dbc.learn.learning import learn
from app.sources.dbc.learn.lines import Choice, find_signal, title
from app.sources.dbc.learn.profile_text import profile_text
from app.sources.dbc.learn.survey import survey
from tests.naming_habits import pairs_in_fd_frames

PEER = pairs_in_fd_frames()
DEFINITIONS = parse_definitions(PEER.dbc().encode(), "x.dbc")
FRAMES = frames_of(PEER.frames(3.0))
SURVEY = survey(DEFINITIONS, FRAMES)


def learned(choices=None, **shape):
    return learn(SURVEY, FRAMES, "x", ("x.dbc",), choices or {}, **shape)


def profile(choices=None, **shape):
    return understand(read_document(profile_text(learned(choices, **shape)), "x.toml", lambda name: None))


def test_states_and_limits_are_proposed_but_not_taken():
    lines = learned().lines
    assert {key for key, line in lines.items() if not line.is_taken} == {
        f"state.{name}" for name in ("closed", "precharge", "fault", "charging", "balancing")
    }
    assert profile().source.states == {}
    assert all(line.chosen.reasons for line in lines.values())


def test_a_confirmed_state_is_in_the_profile_and_a_line_that_is_left_out_is_not():
    found = profile({"state.closed": Choice(is_taken=True), "soc": Choice(is_taken=False)})
    assert str(found.source.states["closed"].signal) == "AMS_Pack.AIR_P"
    assert found.source.soc is None


def test_another_candidate_can_be_chosen_and_any_other_signal():
    other = title(learned().lines["state.closed"].candidates[1])
    assert other == "AMS_Pack.AIR_N"
    states = profile({"state.closed": Choice(other, is_taken=True), "state.fault": Choice("AMS_Pack.IMD_Error", True)})
    assert str(states.source.states["closed"].signal) == other
    assert str(states.source.states["fault"].signal) == "AMS_Pack.IMD_Error"
    assert title(learned({"current": Choice("NO.SUCH")}).lines["current"].chosen) == "AMS_Pack.PackCurrent"


def test_unit_sign_values_and_shape_are_corrected():
    found = profile(
        {"current": Choice(unit="mA", positive="charge"), "state.closed": Choice(is_taken=True, equals=(0,))},
        segments=(80, 80),
        parallel=4,
    )
    assert (found.source.current.unit, found.source.current.positive) == ("mA", "charge")
    assert found.source.states["closed"].equals == (0,)
    assert (found.battery.segments, found.battery.parallel) == ((80, 80), 4)
    assert profile({"current": Choice(unit="furlong")}).source.current.unit == ""


@pytest.mark.parametrize("name", ["PackCurrent", "AMS_Pack.Nothing", "", "Nobody.PackCurrent"])
def test_a_signal_is_named_with_its_message(name):
    assert find_signal(DEFINITIONS, name) is None
