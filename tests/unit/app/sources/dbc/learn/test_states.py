"""States by the naming habits of teams, by the texts of their values, and by the current that flows meanwhile."""

import numpy as np
import pytest

from app.battery.profile import read_document, understand
from app.battery.source import STATES
from app.sources.dbc.battery_decoder import BatteryDecoder
from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.frames import frames_of
from app.sources.dbc.learn.learning import learn
from app.sources.dbc.learn.lines import Choice
from app.sources.dbc.learn.profile_text import profile_text
from app.sources.dbc.learn.states import Flow, state_proposals
from app.sources.dbc.learn.survey import Heard, survey
from tests.naming_habits import HABITS
from tests.peer_messages import HEAD

CONFIRMED = {f"state.{name}": Choice(is_taken=True) for name in STATES}


@pytest.mark.parametrize("make", HABITS, ids=[make.__name__ for make in HABITS])
def test_a_battery_is_learned_without_an_edit_whatever_its_signals_are_called(make):
    peer = make()
    definitions = parse_definitions(peer.dbc().encode(), "x.dbc")
    frames = frames_of(peer.frames(8.0))
    learned = learn(survey(definitions, frames), frames, "x", ("x.dbc",), CONFIRMED)
    profile = understand(read_document(profile_text(learned), "x.toml", lambda name: None))
    assert (profile.battery.n_cells, profile.battery.n_sensors) == (peer.n_cells, peer.n_sensors)
    found = BatteryDecoder(profile.battery, profile.source, definitions).decode(frames)
    cells = found["voltage"]
    true = [peer.voltage(i, t / 1e9) for i, t in zip(cells.index.tolist(), cells.t_ns.tolist(), strict=True)]
    np.testing.assert_allclose(cells.value, true, atol=0.51 * peer.resolution_v + 1e-9)
    current = found["current"]
    np.testing.assert_allclose(current.value, [peer.current(t / 1e9) for t in current.t_ns.tolist()], atol=0.06)
    told = {
        name: f"{each.signal.signal}={','.join(map(str, each.equals))}" for name, each in profile.source.states.items()
    }
    expected = {name: peer.truth[name] for name in STATES if name in peer.truth}
    assert set(told) == set(expected)
    assert [name for name, each in expected.items() if not told[name].startswith(each)] == []
    assert profile.source.soc.signal.signal == peer.truth["soc"]


def proposals(lines, frames=(), flow=None, texts=""):
    text = f"{HEAD}BO_ 1 BMS_Status: 8 BMS\n" + "".join(f" SG_ {each} X\n" for each in lines) + texts
    definitions = parse_definitions(text.encode(), "x.dbc")
    return state_proposals(survey(definitions, frames_of(list(frames))), flow, set())


def bit(name, at=0, length=1):
    return f'{name} : {at}|{length}@1+ (1,0) [0|0] ""'


@pytest.mark.parametrize(
    ("name", "state"),
    [
        ("AIR_Plus_Closed", "closed"),
        ("MainContactor", "closed"),
        ("Precharge_Relay", "precharge"),
        ("BMS_Fault", "fault"),
        ("Is_Charging", "charging"),
        ("Balancing_Active", "balancing"),
    ],
)
def test_a_bit_is_known_by_its_name(name, state):
    assert list(proposals([bit(name)])) == [state]


@pytest.mark.parametrize(
    "name",
    ["Inverter_Fault", "Precharge_Done", "Charge_Allowed", "Cell_3_Balancing", "IMD_OK", "Contactor_Fault_Count"],
)
def test_a_bit_of_something_else_is_no_state_that_is_sure(name):
    assert all(each[0].score < 2.5 for each in proposals([bit(name)]).values())


def test_the_texts_of_values_tell_which_of_them_mean_yes():
    texts = (
        'VAL_ 1 BmsState 0 "Idle" 1 "Precharge" 2 "Precharge_Failed" 3 "Drive" 4 "Charging" 5 "Balancing" 6 "Fault" ;\n'
    )
    found = proposals([bit("BmsState", length=8)], texts=texts)
    assert {name: each[0].state.equals for name, each in found.items()} == {
        "closed": (3, 4),
        "precharge": (1,),
        "fault": (2, 6),
        "charging": (4,),
        "balancing": (5,),
    }


def test_what_is_open_while_a_heavy_current_flows_is_not_closed():
    frames = [(k * 10**8, 1, bytes([1 if k < 20 else 2])) for k in range(40)]
    times = np.array([t for t, _, _ in frames])
    heavy = Flow.of(Heard(times, np.where(np.arange(40) < 20, 0.0, 100.0), np.zeros(40, np.int64)))
    found = proposals([bit("AIR_Positive"), bit("AIR_Negative", 1)], frames, heavy)
    assert [str(each.state.signal) for each in found["closed"]] == ["BMS_Status.AIR_Negative"]
    assert Flow.of(None) is None


def test_relays_in_a_number_are_closed_at_the_values_of_a_heavy_current():
    frames = [(k * 10**8, 1, bytes([0 if k < 20 else 5])) for k in range(40)]
    times = np.array([t for t, _, _ in frames])
    heavy = Flow.of(Heard(times, np.where(np.arange(40) < 25, 0.0, 100.0), np.zeros(40, np.int64)))
    found = proposals([bit("Relay_State", 0, 8)], frames, heavy)
    assert found["closed"][0].state.equals == (5,)
