"""Signals of the charger, and limits of the current that a battery tells."""

import pytest

from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.frames import frames_of
from app.sources.dbc.learn.charger_and_limits import charger_proposals, limit_proposals
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
