"""How much speaks for signals to carry cell voltages or temperatures: names, declarations, what was heard."""

import pytest

from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.frames import frames_of
from app.sources.dbc.learn.proposal import heard_of, judged
from app.sources.dbc.learn.survey import survey
from app.words import Message
from tests.peer_messages import HEAD
from tests.unit.app.sources.dbc.learn.test_families import proposals

GOOD, BAD = (3700).to_bytes(2, "little") * 4, (9000).to_bytes(2, "little") * 4


def judgement(name, unit="mV", message="BMS", kind="voltage", frames=(), n=None, bits=16):
    lines = "".join(f' SG_ {name}{k} : {bits * k}|{bits}@1+ (1,0) [0|0] "{unit}" X\n' for k in range(4))
    definitions = parse_definitions(f"{HEAD}BO_ 1 {message}: 8 BMS\n{lines}".encode(), "x.dbc")
    members = tuple((definitions.messages[0], signal) for signal in definitions.messages[0].signals)
    return judged(survey(definitions, frames_of(list(frames))), kind, members, n or 4)


def score(*args, **kwargs):
    return judgement(*args, **kwargs)[0]


@pytest.mark.parametrize(
    ("better", "worse"),
    [
        ("Cell_Voltage_", "Voltage_"),
        ("Cell_Voltage_", "Channel_"),
        ("Cell_Voltage_", "Cell_Reference_Voltage_"),
        ("Cell_Voltage_", "LV_Voltage_"),
        ("Cell_Voltage_", "Cell_Temp_"),
    ],
)
def test_a_name_that_says_cell_voltage_scores_more(better, worse):
    assert score(better) > score(worse)


def test_a_temperature_scores_more_as_temperature():
    assert score("Cell_Temp_", "degC", kind="temperature") > score("Cell_", "degC", kind="temperature")
    assert judgement("Cell_Temp_", "degC", kind="voltage") is None


@pytest.mark.parametrize(
    "name",
    ["Min_Cell_Voltage_", "Cell_Voltage_Limit_", "Cell_OCV_Open_", "Motor_Voltage_", "Cell_Current_", "Cell_SOC_"],
)
def test_a_name_that_says_something_else_is_out(name):
    assert judgement(name) is None


def test_a_unit_speaks_for_it_and_a_wrong_one_rules_it_out():
    assert score("Cell_", "mV") > score("Cell_", "")
    assert judgement("Cell_", "A") is None
    assert judgement("Cell_", "mV", bits=6) is None


def test_what_was_heard_counts_most():
    good = [(k, 1, GOOD) for k in range(5)]
    bad = [(k, 1, BAD) for k in range(5)]
    assert score("Cell_", frames=good) > score("Cell_") > score("Cell_", frames=bad)
    other = [(k, 2, GOOD) for k in range(5)]
    assert score("Cell_", frames=other) < score("Cell_")
    assert judgement("Cell_", frames=good)[1].share == 1.0
    assert judgement("Cell_", frames=other)[1] is None


def test_more_cells_score_more():
    assert score("Cell_", n=96) > score("Cell_", n=12)


def test_a_message_of_debug_or_simulation_scores_less():
    assert score("Cell_", message="BMS_Debug") < score("Cell_")
    assert score("Cell_", message="Simulation_BMS") < score("Cell_")


def test_only_signals_that_were_heard_are_looked_at():
    text = 'BO_ 1 M: 8 BMS\n SG_ Cell_0 : 0|16@1+ (1,0) [0|0] "mV" X\n SG_ Cell_1 : 48|16@1+ (1,0) [0|0] "mV" X\n'
    definitions = parse_definitions((HEAD + text).encode(), "x.dbc")
    members = tuple((definitions.messages[0], signal) for signal in definitions.messages[0].signals)
    found = heard_of(survey(definitions, frames_of([(0, 1, b"\x74\x0e")])), members)
    assert [(signal.name, heard.values.tolist()) for signal, heard in found] == [("Cell_0", [3700.0])]


def test_a_reason_is_added_and_nothing_else_changes():
    text = "BO_ 1 M: 8 BMS\n" + "".join(f' SG_ Cell_{k}_V : {16 * k}|16@1+ (0.001,0) [0|0] "V" X\n' for k in range(4))
    best = proposals(text)[0]
    more = best.with_reason(Message("learn-nothing-heard"))
    assert [reason.code for reason in more.reasons] == ["learn-names", "learn-nothing-heard"]
    assert (more.entries, more.score, more.n) == (best.entries, best.score, best.n)
