"""The numbers in names as columns, and which of them tell cells apart."""

from hypothesis import given
from hypothesis import strategies as st

from app.sources.dbc.definitions import Condition, Layout, MessageDefinition, Signal
from app.sources.dbc.learn.columns import Column, columns_of, cut_name, roles_of, telling


def member(message, signal, *mux):
    conditions = (Condition("Mux", tuple(mux)),) if mux else ()
    each = Signal(signal, Layout(0, 16), conditions=conditions)
    return MessageDefinition(1, message, 8, (each,)), each


def roles(*members):
    columns = columns_of(members)
    chosen = telling(columns, len(members))
    return None if chosen is None else list(zip((c.where for c in chosen), roles_of(chosen), strict=True))


@given(st.integers(0, 99), st.integers(0, 999))
def test_a_cut_name_is_the_name_again(segment, cell):
    name = f"Seg{segment:02d}_Cell{cell}_mV"
    cut = cut_name(name)
    assert cut.values == (segment, cell)
    joined = "".join(piece + text for piece, text in zip(cut.pieces, (*cut.texts, ""), strict=True))
    assert joined == name
    assert cut.skeleton == "Seg#_Cell#_mV"


def test_letters_count_where_they_stand_for_a_segment_and_nowhere_else():
    assert cut_name("SegA_Cell3").values == (0, 3)
    assert cut_name("SegmentC5").values == (2, 5)
    assert cut_name("Stack_B_3").values == (1, 3)
    assert cut_name("BMS_A").values == (0,)
    assert cut_name("ACC_V3").values == (3,)
    assert cut_name("Segment").values == ()
    assert cut_name("SegAlpha").values == ()


def test_one_running_number_is_the_cell():
    assert roles(*(member("M", f"V{k}") for k in range(1, 9))) == [("signal", "cell")]


def test_a_segment_and_a_cell_in_the_name_are_both_found():
    found = roles(*(member("M", f"Seg{s}_V{c}") for s in range(3) for c in range(4)))
    assert found == [("signal", "segment"), ("signal", "cell")]
    assert roles(*(member("M", f"Seg{s}_V{c}") for s in "ABC" for c in range(4))) == found


def test_a_module_in_the_message_and_a_cell_in_the_signal_are_both_found():
    found = roles(*(member(f"Module_{m}", f"V{c}") for m in range(1, 7) for c in range(1, 13)))
    assert found == [("message", "segment"), ("signal", "cell")]


def test_frames_that_continue_each_other_are_groups():
    found = roles(*(member(f"CellFrame_{f}", f"V{c}") for f in range(5) for c in range(4)))
    assert found == [("message", "group"), ("signal", "cell")]


def test_a_multiplexer_counts_where_the_names_do_not_tell():
    found = roles(*(member("M", "V", m) for m in range(8)))
    assert found == [("mux", "cell")]
    assert roles(*(member("M", f"V{3 * m + k}", m) for m in range(8) for k in range(3))) == [("signal", "cell")]


def test_segment_message_and_cell_are_three_columns():
    found = roles(*(member(f"Module_{m}_Frame_{f}", f"V{c}") for m in range(3) for f in range(2) for c in range(4)))
    assert [role for _, role in found] == ["segment", "group", "cell"]


def test_members_that_nothing_tells_apart_have_no_columns():
    assert roles(member("M", "V"), member("N", "V")) is None
    assert roles(member("M1", "V1"), member("M1", "V1"), member("M1", "V2")) is None


def test_a_number_that_all_share_is_no_column():
    assert [column.place for column in columns_of([member("BMS2", f"HV2_V{k}") for k in range(4)])] == [1]


def test_a_lone_number_that_jumps_far_does_not_number_cells():
    assert roles(*(member("M", f"V{k}") for k in (1, 2, 700, 900))) is None


@given(st.integers(2, 8), st.integers(2, 20), st.integers(0, 1), st.integers(0, 1))
def test_segments_and_cells_of_any_number_and_base_are_told_apart(segments, cells, low_segment, low_cell):
    members = [member("M", f"Seg{s + low_segment}_V{c + low_cell}") for s in range(segments) for c in range(cells)]
    chosen = telling(columns_of(members), len(members))
    assert roles_of(chosen) == ["segment", "cell"]
    assert [set(column.values) for column in chosen] == [
        set(range(low_segment, segments + low_segment)),
        set(range(low_cell, cells + low_cell)),
    ]


def test_a_column_knows_whether_it_varies_and_is_written_in_letters():
    column = Column("signal", 0, (0, 1), ("A", "B"), "seg")
    assert column.varies
    assert column.is_letter
    assert not Column("mux", 0, (3, 3), (), "mux").varies
    assert not Column("mux", 0, (3, 4), (), "mux").is_letter
