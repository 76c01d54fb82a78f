"""One code for one condition: its names, the faults of the simulator, and what earlier versions kept."""

import pytest

from app.words import Message, condition_of, message_from_json, render, table
from app.words.conditions import CONDITIONS
from simulator.fault_kinds import FAULTS, today


def test_every_condition_has_one_name_in_every_language():
    assert all(render(Message(code)) != code and render(Message(code), language="nb") != code for code in CONDITIONS)
    assert len(set(CONDITIONS)) == len(CONDITIONS)


def test_the_faults_of_the_simulator_have_the_codes_of_the_conditions():
    assert sorted(set(FAULTS) - set(CONDITIONS)) == []


@pytest.mark.parametrize(
    ("kept", "code"),
    [
        ("joint-loose", "joint-resistance-high"),
        ("weak-joint", "joint-resistance-high"),
        ("finding-joint-grown", "finding-joint-resistance-high"),
        ("cause-weak-joint", "joint-resistance-high"),
        ("cause-slave-lost", "slave-lost"),
        ("cause-unknown", "cause-unknown"),
        ("trip-v-min", "trip-cell-undervoltage"),
        ("trip-slave-lost", "trip-slave-lost"),
        ("current-low", "charge-overcurrent"),
        ("recording-started", "recording-started"),
    ],
)
def test_a_code_of_an_earlier_version_is_read(kept, code):
    assert condition_of(kept) == code
    assert condition_of(code) == code


def test_a_message_of_an_earlier_version_has_today_s_words():
    kept = {
        "code": "cause-at-cell",
        "args": {"cause": {"code": "cause-lost-capacity", "args": {}}, "cell": {"index": 3}},
    }
    assert render(message_from_json(kept), [12]) == "low cell capacity at pack 1, cell 4"


@pytest.mark.parametrize(
    ("kept", "name"), [("loose-joint", "joint-resistance-high"), ("reset", "master-watchdog-reset")]
)
def test_a_fault_of_an_earlier_scenario_is_read(kept, name):
    assert today(kept) == name
    assert name in FAULTS


def test_no_condition_has_a_second_name():
    assert [code for code in table("en") if code.startswith("cause-") and code[6:] in CONDITIONS] == []
