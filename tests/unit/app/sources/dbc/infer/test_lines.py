"""Lines of a suggestion, and a person's corrections of them."""

from functools import cache

import pytest

from app.battery.battery import SignalName
from app.battery.profile import read_document, understand
from app.battery.source import ScalarSignal, StateSignal
from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.frames import frames_of
from app.sources.dbc.infer.bus_survey import survey_bus
from app.sources.dbc.infer.inference import infer_profile
from app.sources.dbc.infer.lines import Choice, find_signal, line_of, title
from app.sources.dbc.infer.profile_text import profile_text
from app.sources.dbc.infer.readings import ReadingProposal
from app.sources.dbc.infer.states import StateProposal
from tests.naming_habits import pairs_in_fd_frames

PEER = pairs_in_fd_frames()
DEFINITIONS = parse_definitions(PEER.dbc().encode(), "x.dbc")
FRAMES = frames_of(PEER.frames(3.0))
SURVEY = survey_bus(DEFINITIONS, FRAMES)


def inferred(choices=None, **shape):
    return infer_profile(SURVEY, FRAMES, "x", ("x.dbc",), choices or {}, **shape)


@cache
def suggested():
    """What is inferred without a person's word."""
    return inferred()


def profile(choices=None, **shape):
    return understand(read_document(profile_text(inferred(choices, **shape)), "x.toml", lambda name: None))


def test_states_and_limits_are_proposed_but_not_taken():
    lines = suggested().lines
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
    other = title(suggested().lines["state.closed"].candidates[1])
    assert other == "AMS_Pack.AIR_N"
    states = profile({"state.closed": Choice(other, is_taken=True), "state.fault": Choice("AMS_Pack.IMD_Error", True)})
    assert str(states.source.states["closed"].signal) == other
    assert str(states.source.states["fault"].signal) == "AMS_Pack.IMD_Error"
    assert title(inferred({"current": Choice("NO.SUCH")}).lines["current"].chosen) == "AMS_Pack.PackCurrent"


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


def test_a_signal_is_named_with_its_message_whatever_white_space_is_around():
    message, signal = find_signal(DEFINITIONS, " AMS_Pack . AIR_P\n")
    assert (message.name, signal.name) == ("AMS_Pack", "AIR_P")
    for name in ("PackCurrent", "AMS_Pack.Nothing", "", "Nobody.PackCurrent"):
        assert find_signal(DEFINITIONS, name) is None


def test_a_correction_of_something_else_changes_nothing_and_adds_no_line():
    assert profile_text(inferred({"nonsense": Choice("AMS_Pack.AIR_P", is_taken=True)})) == profile_text(suggested())


def test_values_that_a_person_names_take_the_place_of_a_mask():
    signal = next(each for each in DEFINITIONS.by_id().values() if each.name == "AMS_Pack").signals[0].name
    chosen = StateProposal(StateSignal(SignalName("AMS_Pack", signal), (1,), 0xFF), (), 1.0)
    corrected = line_of("state.fault", [chosen], {"state.fault": Choice(equals=(3, 4))}, DEFINITIONS).chosen
    assert (corrected.state.equals, corrected.state.mask) == ((3, 4), 0)
    untouched = line_of("state.fault", [chosen], {}, DEFINITIONS).chosen
    assert untouched == chosen


def test_a_signal_that_a_person_named_says_so_among_its_reasons():
    line = inferred({"soc": Choice("AMS_Pack.IMD_Error")}).lines["soc"]
    assert [each.code for each in line.chosen.reasons] == ["infer-by-person"]
    assert title(line.candidates[-1]) == "AMS_Pack.IMD_Error"


@pytest.mark.parametrize("key", ["state.fault", "limit.charge_current_max_a"])
def test_what_raises_alarms_is_taken_by_a_person_only_and_the_rest_may_be_left_out(key):
    given = ReadingProposal(ScalarSignal(SignalName("AMS_Pack", "AIR_P")), (), 1.0)
    for usual, name in ((False, key), (True, "soc")):
        assert line_of(name, [given], {}, DEFINITIONS).is_taken is usual
        for taken in (True, False):
            assert line_of(name, [given], {name: Choice(is_taken=taken)}, DEFINITIONS).is_taken is taken


def test_a_line_of_which_nothing_speaks_is_there_once_a_person_names_its_signal():
    assert line_of("soc", [], {}, DEFINITIONS) is None
    assert line_of("soc", [], {"soc": Choice("No.Such")}, DEFINITIONS) is None
    assert title(line_of("soc", [], {"soc": Choice("AMS_Pack.AIR_P")}, DEFINITIONS).chosen) == "AMS_Pack.AIR_P"


def test_a_unit_of_the_cells_is_that_of_all_their_signals():
    entries = inferred({"voltage": Choice(unit="mV")}).lines["voltage"].chosen.entries
    assert {each.unit for each in entries} == {"mV"}


@pytest.mark.parametrize(
    ("key", "choice"),
    [
        *(("voltage", Choice(unit=unit)) for unit in ("degC", "furlong", "")),
        *(("current", Choice(positive=side)) for side in ("", "both", "Charge")),
    ],
)
def test_a_unit_of_another_quantity_and_a_sign_that_is_none_leave_what_is_suggested(key, choice):
    assert inferred({key: choice}).lines[key].chosen == suggested().lines[key].chosen
