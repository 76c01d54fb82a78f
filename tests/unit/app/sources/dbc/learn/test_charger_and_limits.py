"""Signals of the charger, and limits of the current that a battery tells."""

import pytest

from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.frames import frames_of
from app.sources.dbc.learn.readings import charger_proposals, limit_proposals
from app.sources.dbc.learn.survey import survey
from tests.peer_messages import HEAD

TEXT = (
    f"{HEAD}BO_ 1 Elcon_Status: 8 CHG\n"
    ' SG_ Output_Voltage : 0|16@1+ (0.1,0) [0|0] "V" X\n'
    ' SG_ Output_Current : 16|16@1+ (0.1,0) [0|0] "A" X\n'
    "BO_ 2 Elcon_Request: 8 BMS\n"
    ' SG_ Charger_Max_Voltage : 0|16@1+ (0.1,0) [0|0] "V" X\n'
    ' SG_ Charger_Max_Current : 16|16@1+ (0.1,0) [0|0] "A" X\n'
    "BO_ 3 BMS_Limits: 8 BMS\n"
    ' SG_ Pack_DCL : 0|16@1+ (1,0) [0|0] "A" X\n'
    ' SG_ Pack_CCL : 16|16@1+ (1,0) [0|0] "A" X\n'
)
SURVEY = survey(parse_definitions(TEXT.encode(), "x.dbc"), frames_of([]))


@pytest.mark.parametrize(
    ("kind", "signal"),
    [("charger_voltage", "Elcon_Status.Output_Voltage"), ("charger_current", "Elcon_Status.Output_Current")],
)
def test_what_the_charger_gives_is_not_what_it_is_asked_for(kind, signal):
    assert [str(each.reading.signal) for each in charger_proposals(SURVEY, kind, set())] == [signal]


@pytest.mark.parametrize(
    ("name", "signal"),
    [("discharge_current_max_a", "BMS_Limits.Pack_DCL"), ("charge_current_max_a", "BMS_Limits.Pack_CCL")],
)
def test_limits_of_the_current_are_found(name, signal):
    assert str(limit_proposals(SURVEY, name, set())[0].reading.signal) == signal


def surveyed(signal, message="Elcon_Status", unit="A", frames=(), factor="0.1"):
    text = f'{HEAD}BO_ 1 {message}: 8 CHG\n SG_ {signal} : 0|16@1+ ({factor},0) [0|0] "{unit}" X\n'
    return survey(parse_definitions(text.encode(), "x.dbc"), frames_of(list(frames)))


def limits(signal, name="discharge_current_max_a", **given):
    return [str(each.reading.signal) for each in limit_proposals(surveyed(signal, **given), name, set())]


@pytest.mark.parametrize("signal", ["Max_Output_Current", "Output_Current_Limit", "AC_Current", "Requested_Current"])
def test_what_a_charger_may_give_or_takes_from_the_wall_is_not_what_it_gives(signal):
    assert charger_proposals(surveyed(signal), "charger_current", set()) == []


def test_a_charger_is_known_by_its_message_and_a_voltage_is_no_current():
    assert charger_proposals(surveyed("Output_Current", message="Pumps"), "charger_current", set()) == []
    assert charger_proposals(surveyed("Output_Current"), "charger_voltage", set()) == []
    assert charger_proposals(surveyed("Output_Current", unit="V"), "charger_current", set()) == []


def test_what_a_line_has_already_is_proposed_for_no_other():
    assert charger_proposals(SURVEY, "charger_current", {(1, "Output_Current")}) == []
    assert limit_proposals(SURVEY, "discharge_current_max_a", {(3, "Pack_DCL")}) == []


def test_of_two_signals_of_a_charger_the_measured_one_comes_first():
    text = TEXT.replace("Output_Voltage", "Charger_Current").replace(
        '"V" X\n SG_ Output_Current', '"A" X\n SG_ Output_Current'
    )
    both = survey(parse_definitions(text.encode(), "x.dbc"), frames_of([]))
    found = [each.reading.signal.signal for each in charger_proposals(both, "charger_current", set())]
    assert set(found) == {"Output_Current", "Charger_Current"}


@pytest.mark.parametrize(
    ("signal", "name"),
    [
        ("Max_Discharge_Current", "discharge_current_max_a"),
        ("Discharge_Current_Limit", "discharge_current_max_a"),
        ("Max_Charge_Current", "charge_current_max_a"),
        ("Regen_Current_Allowed", "charge_current_max_a"),
    ],
)
def test_a_limit_is_that_of_its_direction_only(signal, name):
    other = {"discharge_current_max_a": "charge_current_max_a", "charge_current_max_a": "discharge_current_max_a"}
    assert limits(signal, name, message="BMS") == [f"BMS.{signal}"]
    assert limits(signal, other[name], message="BMS") == []


@pytest.mark.parametrize(
    ("signal", "unit"),
    [
        ("Max_Discharge_Power", "kW"),
        ("Max_Discharge_Cell_Current", "A"),
        ("Discharge_Current", "A"),
        ("Discharge_Voltage_Max", "V"),
    ],
)
def test_a_power_a_cell_a_measured_current_and_a_voltage_are_no_limit_of_the_current(signal, unit):
    assert limits(signal, message="BMS", unit=unit) == []


def test_what_was_heard_of_a_limit_is_shown_with_it_and_silence_speaks_against_it():
    frames = [(k * 10**8, 1, (2000 + k).to_bytes(2, "little")) for k in range(11)]
    (found,) = limit_proposals(surveyed("Pack_DCL", message="BMS", frames=frames), "discharge_current_max_a", set())
    assert (found.low, found.high) == (pytest.approx(200.0), pytest.approx(201.0))
    other = [(k * 10**9, 9, bytes(8)) for k in range(120)]
    heard = limit_proposals(surveyed("Pack_DCL", message="BMS", frames=other), "discharge_current_max_a", set())
    assert heard == [], "two minutes, and never heard"
