import pytest

from app.battery.profile import read_document, understand
from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.encoding.turns import turns_of
from app.sources.dbc.lanes import lanes_of

HEAD = 'VERSION ""\nNS_ :\nBS_:\nBU_: B\n'


def turns(signals, profile, segments=(6,), sensors=0):
    """The turns of message M (id 1), as (numbers, channels by kind)."""
    dbc = HEAD + "BO_ 1 M: 8 B\n" + "".join(f' SG_ {each} (1,0) [0|0] "" B\n' for each in signals)
    text = (
        f'[battery]\nname = "x"\nsegments = {list(segments)}\n[battery.temperatures]\nsensors = {sensors}\n'
        f'[source]\ndbc = "x.dbc"\n{profile}'
    )
    battery, source = (p := understand(read_document(text, "x.toml", lambda name: None))).battery, p.source
    lanes = lanes_of(battery, source, parse_definitions(dbc.encode(), "x.dbc"))
    found = turns_of(lanes.messages[1], lanes.by_id[1], lanes.segments)
    return [(turn.numbers, {(lane.kind, index) for lane, index in turn.slots}) for turn in found]


def cells(*indices):
    return {("voltage", index) for index in indices}


def test_a_message_without_numbers_has_one_turn():
    assert turns(["U0 : 0|16@1+", "U1 : 16|16@1+"], '[[source.voltage]]\nsignal = "U{cell}"\n') == [({}, cells(0, 1))]


def test_a_multiplexer_takes_turns_by_its_values():
    signals = ["X M : 0|8@1+", "U0 m0 : 8|16@1+", "U1 m0 : 24|16@1+", "U2 m3 : 8|16@1+"]
    assert turns(signals, '[[source.voltage]]\nsignal = "U{cell}"\n') == [({"X": 0}, cells(0, 1)), ({"X": 3}, cells(2))]


def test_a_cell_number_takes_a_turn_for_each_cell():
    found = turns(["N : 0|8@1+", "U : 8|16@1+"], '[[source.voltage]]\nsignal = "U"\nnumbers = {cell = "N"}\nbase = 1\n')
    assert found == [({"N": i + 1}, cells(i)) for i in range(6)]


def test_a_first_cell_and_three_values_overlap_in_no_turn():
    signals = ["N : 0|8@1+", "U_A : 8|16@1+", "U_B : 24|16@1+", "U_C : 40|16@1+"]
    profile = '[[source.voltage]]\nsignal = "U_{cell:a}"\nnumbers = {group = "N"}\nbase = {group = 1}\n'
    assert turns(signals, profile) == [({"N": 1}, cells(0, 1, 2)), ({"N": 4}, cells(3, 4, 5))]


def test_cells_that_are_no_multiple_of_a_turn_are_told_all_the_same():
    signals = ["N : 0|8@1+", "U_A : 8|16@1+", "U_B : 24|16@1+", "U_C : 40|16@1+"]
    profile = '[[source.voltage]]\nsignal = "U_{cell:a}"\nnumbers = {group = "N"}\nbase = {group = 1}\n'
    found = turns(signals, profile, segments=(7,))
    assert set().union(*(each for _, each in found)) == cells(*range(7))
    assert len(found) == 3


def test_segments_of_different_sizes_have_as_many_turns_as_cells():
    profile = '[[source.voltage]]\nsignal = "U"\nnumbers = {segment = "S", cell = "N"}\n'
    found = turns(["S : 0|4@1+", "N : 4|4@1+", "U : 8|16@1+"], profile, segments=(3, 1, 2))
    assert [(each["S"], each["N"]) for each, _ in found] == [(0, 0), (0, 1), (0, 2), (1, 0), (2, 0), (2, 1)]
    assert [index for _, slots in found for _, index in slots] == list(range(6))


def test_two_cells_with_their_own_numbers_tell_different_cells_of_the_same_chip():
    signals = ["S : 0|4@1+", "A : 4|4@1+", "B : 8|4@1+", "UA : 16|16@1+", "UB : 32|16@1+", "T : 48|8@1+"]
    profile = "".join(f'[[source.voltage]]\nsignal = "U{x}"\nnumbers = {{segment = "S", cell = "{x}"}}\n' for x in "AB")
    profile += '[[source.temperature]]\nsignal = "T"\nnumbers = {cell = "S"}\n'
    found = turns(signals, profile, segments=(4, 4), sensors=2)
    assert len(found) == 4
    for numbers, slots in found:
        told = sorted(index for kind, index in slots if kind == "voltage")
        assert told == sorted(4 * numbers["S"] + numbers[x] for x in "AB")
        assert told[0] != told[1]
        assert ("temperature", numbers["S"]) in slots


@pytest.mark.parametrize(("bits", "n"), [(2, 4), (3, 6)])
def test_numbers_that_the_signal_cannot_hold_are_not_spoken(bits, n):
    found = turns([f"N : 0|{bits}@1+", "U : 8|16@1+"], '[[source.voltage]]\nsignal = "U"\nnumbers = {cell = "N"}\n')
    assert len(found) == n
