"""States by the naming habits of teams, by the texts of their values, and by the current that flows meanwhile."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.battery.source import STATES
from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.frames import frames_of
from app.sources.dbc.infer.bus_survey import ReceivedSignal, survey_bus
from app.sources.dbc.infer.lines import Choice
from app.sources.dbc.infer.states import Flow, state_proposals
from tests.campaign import examples
from tests.naming_habits import HABITS
from tests.peer_messages import HEAD
from tests.unit.app.sources.dbc.infer.test_inference import assert_cells_decode, learned_of

CONFIRMED = {f"state.{name}": Choice(is_taken=True) for name in STATES}


@pytest.mark.parametrize("make", HABITS, ids=[make.__name__ for make in HABITS])
def test_a_battery_is_learned_without_an_edit_whatever_its_signals_are_called(make):
    peer = make()
    profile, found = assert_cells_decode(peer, *learned_of(peer, 8.0, CONFIRMED))
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
    return state_proposals(survey_bus(definitions, frames_of(list(frames))), flow, set())


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
    heavy = flow_of([0.0] * 20 + [100.0] * 20)
    found = proposals([bit("AIR_Positive"), bit("AIR_Negative", 1)], frames, heavy)
    assert [str(each.state.signal) for each in found["closed"]] == ["BMS_Status.AIR_Negative"]
    assert Flow.of(None) is None


def test_relays_in_a_number_are_closed_at_the_values_of_a_heavy_current():
    frames = [(k * 10**8, 1, bytes([0 if k < 20 else 5])) for k in range(40)]
    heavy = flow_of([0.0] * 25 + [100.0] * 15)
    found = proposals([bit("Relay_State", 0, 8)], frames, heavy)
    assert found["closed"][0].state.equals == (5,)


def flow_of(currents, step_ns=10**8):
    values = np.array(currents, float)
    return Flow.of(ReceivedSignal(np.arange(len(values)) * step_ns, values, np.zeros(len(values), np.int64)))


@pytest.mark.parametrize("currents", [[], [0.0] * 10, [50.0] * 10, [float("nan")] * 5])
def test_a_current_that_never_changes_tells_nothing_of_contactors(currents):
    with np.errstate(all="ignore"):
        assert flow_of(currents) is None


@settings(max_examples=examples(30))
@given(st.lists(st.floats(-500, 500, allow_nan=False).map(lambda a: round(a, 1)), min_size=1, max_size=30))
def test_the_sign_of_the_current_does_not_matter_to_its_size(currents):
    one, other = flow_of(currents), flow_of([-each for each in currents])
    assert (one is None) == (other is None)
    if one is not None:
        np.testing.assert_array_equal(one.is_heavy, other.is_heavy)
        assert one.is_heavy[np.argmax(np.abs(currents))]


@pytest.mark.parametrize(
    "line",
    [
        'BMS_Fault : 0|8@1+ (0.1,0) [0|0] "" X',
        'BMS_Fault : 0|8@1+ (1,5) [0|0] "" X',
        'BMS_Fault : 0|8@1+ (1,0) [0|0] "V" X',
        'BMS_Fault : 0|40@1+ (1,0) [0|0] "" X',
        'BMS_Fault M : 0|8@1+ (1,0) [0|0] "" X',
    ],
)
def test_a_quantity_a_long_number_and_a_multiplexer_are_no_states(line):
    assert proposals([line.removesuffix(" X")]) == {}


def test_what_another_line_has_is_no_state():
    definitions = parse_definitions(f"{HEAD}BO_ 1 BMS: 8 BMS\n SG_ {bit('BMS_Fault')} X\n".encode(), "x.dbc")
    received = survey_bus(definitions, frames_of([]))
    assert "fault" in state_proposals(received, None, set())
    assert state_proposals(received, None, {(1, "BMS_Fault")}) == {}


def test_any_bit_of_a_word_of_faults_is_a_fault():
    state = proposals([bit("BMS_Faults", length=12)])["fault"][0].state
    assert state.mask == 0xFFF


@pytest.mark.parametrize("texts", ['0 "Closed" 1 "Active"', '0 "Open" 1 "Welded"', '7 "Drive"'])
def test_texts_that_all_say_yes_or_none_do_tell_nothing(texts):
    found = proposals([bit("BmsState", length=8)], texts=f"VAL_ 1 BmsState {texts} ;\n")
    assert "closed" not in found


def test_a_state_that_takes_many_values_is_a_counter():
    frames = [(k * 10**8, 1, bytes([k])) for k in range(40)]
    texts = 'VAL_ 1 BmsState 0 "Open" 1 "Closed" 2 "Fault" ;\n'
    assert proposals([bit("BmsState", length=8)], frames, texts=texts) == {}


def test_a_precharge_is_over_while_a_heavy_current_flows():
    heavy = flow_of([0.0] * 20 + [100.0] * 20)

    def told(of):
        frames = [(k * 10**8, 1, bytes([of(k)])) for k in range(40)]
        return proposals([bit("Precharge_Relay")], frames, heavy)

    assert "precharge" in told(lambda k: k < 10)
    assert "precharge" not in told(lambda k: k >= 20)


def test_a_bit_that_never_changed_says_so_and_its_value():
    frames = [(k * 10**8, 1, b"\x01") for k in range(10)]
    (found,) = proposals([bit("Is_Charging")], frames)["charging"]
    (constant,) = [each for each in found.reasons if each.code == "infer-state-constant"]
    assert constant.args["value"] == 1


def test_a_fault_that_is_there_most_of_the_time_is_less_likely_one():
    def score(raw):
        return proposals([bit("BMS_Fault")], [(k * 10**8, 1, bytes([raw if k else 1 - raw])) for k in range(10)])[
            "fault"
        ][0].score

    assert score(0) > score(1)


@settings(max_examples=examples(25), deadline=None)
@given(st.lists(st.binary(max_size=8), max_size=30), st.lists(st.floats(-300, 300), max_size=10))
def test_whatever_a_bus_says_the_proposals_name_signals_of_the_dbc_the_best_first(datas, currents):
    frames = [(k * 10**8, 1, data) for k, data in enumerate(datas)]
    found = proposals(
        [bit("AIR_Plus"), bit("BMS_Fault", 1, 7), bit("BmsState", 8, 8)], frames, flow_of(currents),
        'VAL_ 1 BmsState 0 "Idle" 1 "Precharge" 3 "Drive" 4 "Charging" 6 "Fault" ;\n',
    )  # fmt: skip
    assert set(found) <= set(STATES)
    for each in found.values():
        assert {str(one.state.signal).partition(".")[2] for one in each} <= {"AIR_Plus", "BMS_Fault", "BmsState"}
        assert [one.score for one in each] == sorted((one.score for one in each), reverse=True)
        assert all(one.reasons for one in each)
