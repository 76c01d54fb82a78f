"""Frames that number what they tell: right for any base, order, unit and number of segments, or said to be unknown."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.frames import frames_of
from app.sources.dbc.infer.bus_survey import survey_bus
from app.sources.dbc.infer.frame_numbers import UNKNOWN_COUNT, frame_number_proposals
from tests.campaign import examples
from tests.peer_messages import HEAD, Bits, Peer, Sent, fixed, others
from tests.unit.app.sources.dbc.infer.test_inference import assert_learned_rightly

UNITS = (("V", 1.0, 0.0001), ("mV", 1000.0, 1.0), ("", 1000.0, 1.0), ("", 1e4, 1.0), ("V", 1e4, 1.0))
CELL_NAMES = (("Cell_ID", "Cell_Voltage"), ("CellNumber", "CellVolt"), ("cell_index", "voltage"), ("ZellNr", "Zelle_U"))
SEGMENT_NAMES = ("module_num", "SegmentID", "ic_id", "Slave_Number")
PERIOD_S = 0.02  # between two frames


def number(name, value, start, order):
    return Bits(name, start if order else start + 7, 8, fixed(value), order=order)


def value(name, peer, cell, unit, start, order):
    unit_text, per_volt, factor = unit
    of = lambda t: peer.voltage(cell, t) * per_volt  # noqa: E731
    return Bits(name, start if order else start + 7, 16, of, factor, unit=unit_text, order=order)


def sent(peer, turns):
    peer.sent = [Sent(0x310, "BMS_Cells", 8, PERIOD_S * len(turns), turns), *others(peer)]
    return peer


def new_peer(draw, n, segments=None):
    unit, order = draw(st.sampled_from(UNITS)), draw(st.integers(0, 1))
    positive = draw(st.sampled_from(["discharge", "charge"]))
    peer = Peer("x", n, 0, segments=segments, resolution_v=unit[2] / unit[1], positive=positive)
    return peer, unit, order


@st.composite
def with_a_cell_number(draw):
    peer, unit, order = new_peer(draw, draw(st.integers(8, 150)))
    base, (name, volts) = draw(st.integers(0, 1)), draw(st.sampled_from(CELL_NAMES))
    turns = [[number(name, c + base, 0, order), value(volts, peer, c, unit, 8, order)] for c in range(peer.n_cells)]
    return sent(peer, turns)


@st.composite
def with_pack_and_cell(draw):
    segments = tuple(draw(st.lists(st.integers(6, 18), min_size=2, max_size=8)))
    peer, unit, order = new_peer(draw, sum(segments), segments)
    base_s, base_c = draw(st.integers(0, 1)), draw(st.integers(0, 1))
    (name, volts), pack = draw(st.sampled_from(CELL_NAMES)), draw(st.sampled_from(SEGMENT_NAMES))
    places = [(s, c) for s, size in enumerate(segments) for c in range(size)]
    turns = [
        [
            number(pack, s + base_s, 0, order),
            number(name, c + base_c, 8, order),
            value(volts, peer, i, unit, 16, order),
        ]
        for i, (s, c) in enumerate(places)
    ]
    return sent(peer, turns)


@st.composite
def with_a_base_number(draw):
    k, groups = draw(st.integers(2, 3)), draw(st.integers(4, 40))
    peer, unit, order = new_peer(draw, k * groups)
    base, counts_cells = draw(st.integers(0, 1)), draw(st.booleans())
    name = "StartCell" if counts_cells else draw(st.sampled_from(["Group", "PageIndex", "Mux"]))
    low = draw(st.integers(0, 1))
    turns = [
        [
            number(name, (k * g if counts_cells else g) + base, 0, order),
            *(value(f"CellV{j + low}", peer, k * g + j, unit, 8 + 16 * j, order) for j in range(k)),
        ]
        for g in range(groups)
    ]
    return sent(peer, turns)


@settings(max_examples=examples(20))
@given(with_a_cell_number())
def test_cells_that_a_frame_numbers_are_all_found(peer):
    assert_learned_rightly(peer, 13)


@settings(max_examples=examples(20))
@given(with_pack_and_cell())
def test_segments_of_any_size_are_found_with_their_cells(peer):
    assert_learned_rightly(peer, 13)


@settings(max_examples=examples(20))
@given(with_a_base_number())
def test_a_group_or_a_first_cell_with_several_values_is_understood(peer):
    assert_learned_rightly(peer, 13)


def best(text, frames=()):
    definitions = parse_definitions((HEAD + text).encode(), "x.dbc")
    found = frame_number_proposals(survey_bus(definitions, frames_of(list(frames))), "voltage")
    return max(found, key=lambda each: each.score, default=None)


CELLS = 'BO_ 1 Cells: 8 BMS\n SG_ Cell_ID : 0|8@1+ (1,0) [0|{most}] "" X\n'
CELLS += ' SG_ Cell_Voltage : 8|16@1+ (0.001,0) [0|5] "V" X\n'


def told(numbers):
    return [(k, 1, bytes([each]) + (3700).to_bytes(2, "little")) for k, each in enumerate(numbers)]


@pytest.mark.parametrize(
    ("most", "texts", "numbers", "n"),
    [
        (71, 0, (), 72),  # the highest number of the DBC
        (0, 0, (), None),
        (255, 0, (), None),
        (0, 30, (), 30),  # texts of its numbers
        (71, 0, range(96), 96),  # what is received counts more
        (255, 0, [*range(1, 25), 255], 24),  # a lone number far beyond the others is no cell
        (255, 0, [k for k in range(24) if k % 5 != 2], 24),  # cells that were not received between others are counted
    ],
)
def test_the_number_of_cells_is_heard_or_in_the_dbc_or_said_to_be_unknown(most, texts, numbers, n):
    named = " ".join(f'{k} "Cell{k + 1}"' for k in range(texts))
    found = best(CELLS.format(most=most) + (f"VAL_ 1 Cell_ID {named} ;\n" if texts else ""), told(numbers))
    assert (found.n, found.entries[0].numbers) == (n or UNKNOWN_COUNT, {"cell": "Cell_ID"})
    assert [reason.code for reason in found.reasons] == ["infer-cell-number"] + ["infer-count-unknown"] * (n is None)


WORDS = (("8|16@1+", "16|16@1+"), ("0|8@1+", "0|16@1+"))  # a number and a value of 16 bits
OTHER = (("Cells:", "Motor:"), ('"V"', '""'), *WORDS)


@pytest.mark.parametrize(
    ("changes", "most", "numbers"),
    [
        *(([("Cell_ID", name)], 71, range(24)) for name in ("Alive_Counter", "CRC", "Status_Flags", "Rolling_Count")),
        ([("Cell_ID", "Fault_Number")], 71, range(24)),
        *(([("0|8@1+ (1,0)", f"0|8@1+ {scale}")], 71, range(24)) for scale in ("(2,0)", "(1,0.5)", "(0.1,0)")),
        ([('[0|71] ""', '[0|71] "degC"')], 71, ()),
        ([], 71, [1, 1, 1]),  # a single number
        *(([("0|8@1+", f"0|{bits}@1+"), ("8|16", "32|16")], 1, ()) for bits in (1, 24)),
        (WORDS, 16384, ()),  # no battery has so many cells
        (
            [("Cell_ID", "KNEE_ID"), ("Cell_Voltage", "LEFT_ANGLE"), *OTHER],
            16384,
            (),
        ),
        ([("Cell_ID", "Steer_Num"), ("Cell_Voltage", "Torque_Output"), *OTHER], 1000, ()),
        ([("Cell_ID", "StatId"), ("Cell_Voltage", "PreInjV"), *OTHER], 255, ()),
    ],
)
def test_counters_quantities_words_and_numbers_of_other_things_number_no_cells(changes, most, numbers):
    text = CELLS.format(most=most)
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    assert best(text, told(numbers)) is None


def test_numbers_that_mean_not_measured_are_invalid_and_not_zero_volts():
    frames = [*told(range(24)), (30, 1, bytes([5, 0, 0])), (31, 1, bytes([6, 0xFF, 0xFF]))]
    assert set(best(CELLS.format(most=71), frames).entries[0].invalid) == {0, 0xFFFF}


@pytest.mark.parametrize("unit", ["#", "ID", "Num"])
def test_what_stands_for_a_unit_of_a_cell_number_is_none(unit):
    found = best(CELLS.format(most=71).replace('[0|71] ""', f'[0|71] "{unit}"'), told(range(24)))
    assert (found.n, found.entries[0].numbers) == (24, {"cell": "Cell_ID"})


@given(st.permutations(range(24)), st.integers(0, 1))
def test_the_order_in_which_cells_are_told_does_not_matter(order, base):
    found = best(CELLS.format(most=255), told([cell + base for cell in order]))
    assert (found.n, found.entries[0].base) == (24, {"cell": 1} if base else {})


def test_without_a_log_segments_and_cells_are_those_of_the_dbc():
    text = (
        'BO_ 1 Cells: 8 BMS\n SG_ Cell_ID : 0|8@1+ (1,0) [1|14] "" X\n SG_ Module_ID : 8|8@1+ (1,0) [1|5] "" X\n'
        ' SG_ Cell_Voltage : 16|16@1+ (0.001,0) [0|5] "V" X\n'
    )
    found = best(text)
    assert (found.n, found.segments) == (70, (14,) * 5)
    assert found.entries[0].base == {"pack": 1, "cell": 1}


def test_a_segment_that_nothing_was_heard_of_counts_as_large_as_the_largest():
    text = CELLS.format(most=255).replace("8|16", "16|16") + ' SG_ Module_ID : 8|8@1+ (1,0) [0|0] "" X\n'
    volts = (3700).to_bytes(2, "little")
    places = [(s, c) for s in (0, 1, 3) for c in range(6)]
    found = best(text, [(k, 1, bytes([c, s]) + volts) for k, (s, c) in enumerate(places)])
    assert found.segments == (6, 6, 6, 6)
    assert found.entries[0].numbers == {"pack": "Module_ID", "cell": "Cell_ID"}
    assert [reason.code for reason in found.reasons] == ["infer-two-numbers"]


def base_number(names, number="Group", frames=()):
    lines = "".join(f' SG_ {name} : {8 + 16 * k}|16@1+ (0.001,0) [0|5] "V" X\n' for k, name in enumerate(names))
    return best(f'BO_ 1 Cells: 8 BMS\n SG_ {number} : 0|8@1+ (1,0) [0|0] "" X\n{lines}', frames)


def grouped(numbers, k):
    return [(t, 1, bytes([each]) + (3700).to_bytes(2, "little") * k) for t, each in enumerate(numbers)]


def test_values_that_end_in_letters_or_numbers_follow_each_other():
    by_letter = base_number(["CellVolt_A", "CellVolt_B", "CellVolt_C"], frames=grouped(range(8), 3))
    by_number = base_number(["Cell1_Volt", "Cell2_Volt", "Cell3_Volt"], frames=grouped(range(8), 3))
    assert (by_letter.n, by_letter.entries[0].signal) == (24, "CellVolt_{cell:a}")
    assert (by_number.n, by_number.entries[0].signal) == (24, "Cell{cell}_Volt")
    assert (by_letter.entries[0].group_cells, by_number.entries[0].group_cells) == (3, 3)


def test_values_whose_numbers_do_not_run_on_are_no_group():
    assert base_number(["CellVolt_1", "CellVolt_2", "CellVolt_7"], frames=grouped(range(8), 3)) is None


@settings(max_examples=examples(20))
@given(st.lists(st.tuples(st.integers(0, 255), st.integers(0, 0xFFFF)), max_size=40))
def test_whatever_numbers_are_heard_a_proposal_has_cells_for_them(pairs):
    frames = [(k, 1, bytes([number]) + raw.to_bytes(2, "little")) for k, (number, raw) in enumerate(pairs)]
    found = best(CELLS.format(most=255), frames)
    if found is not None:
        assert found.n >= 2
        assert found.n <= max(256, UNKNOWN_COUNT)
        assert found.segments is None
