"""DBC import: our own file without loss, any text without a crash."""

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from firmware_protocol import elcon
from firmware_protocol.can_tables import (
    RxMessage,
    TxMessage,
    offsets_of,
    rx_messages,
    tx_messages,
    with_rx_messages,
    with_tx_messages,
)
from firmware_protocol.config_image import check, default_image
from firmware_protocol.dbc import to_dbc
from firmware_protocol.dbc_import import from_dbc
from firmware_protocol.errors import DecodeError
from firmware_protocol.memory_map import BYTE_UNUSED, FIELDS

UNUSED = [BYTE_UNUSED] * 8
ELEMENTS = [
    (field, element)
    for field in FIELDS.values()
    if not field.name.startswith("conf.")
    for element in range(field.count)
]


@st.composite
def rows(draw):
    """A length and bytes as a person picks them: whole values in either order, with spare bytes between."""
    row, length = list(UNUSED), 0
    while length < 8 and draw(st.booleans()):
        field, element = draw(st.sampled_from(ELEMENTS))
        offsets = offsets_of(field, element, is_big_endian=draw(st.booleans()))
        start = length + draw(st.integers(0, 1))
        if start + len(offsets) > 8:
            break
        row[start : start + len(offsets)] = offsets
        length = start + len(offsets)
    length = draw(st.integers(length, 8)) if length else draw(st.integers(1, 8))
    return length, tuple(row)


@st.composite
def tables(draw):
    ids = draw(st.lists(st.integers(0, 0x1FFFFFFF), min_size=6, max_size=6, unique=True))
    tx, rx = [], []
    for index in range(3):
        extended = draw(st.booleans()) or ids[index] > 0x7FF
        length, row = draw(rows())
        period = draw(st.integers(0, 60000))
        tx.append(TxMessage(index * 2, draw(st.booleans()), ids[index], extended, period, length, row))
        length, row = draw(rows())
        extended = draw(st.booleans()) or ids[3 + index] > 0x7FF
        answer = draw(st.none() | st.integers(0, 7))
        timeout = draw(st.integers(0, 60000))
        rx.append(RxMessage(7 - index, draw(st.booleans()), ids[3 + index], extended, timeout, length, row, answer))
    return tx, rx


def image_of(tx, rx):
    empty = with_tx_messages(default_image(), [replace(m, length=0) for m in tx_messages(default_image())])
    empty = with_rx_messages(empty, [replace(m, length=0) for m in rx_messages(empty)])
    return with_rx_messages(with_tx_messages(empty, tx), rx)


def test_flags_picked_twice_come_back_twice():
    flags = FIELDS["status.flags"].offset
    row = (flags, flags + 1, flags, *UNUSED[3:])
    tx = [TxMessage(0, True, 0x10, False, 100, 3, row)]
    assert list(from_dbc(to_dbc(image_of(tx, []))).tx) == tx


def test_the_chargers_ids_in_the_other_table_stay_there():
    tx = [TxMessage(0, True, elcon.STATUS_ID, True, 100, 1, tuple(UNUSED))]
    rx = [RxMessage(0, True, elcon.COMMAND_ID, True, 100, 1, tuple(UNUSED), None)]
    imported = from_dbc(to_dbc(image_of(tx, rx)))
    assert (list(imported.tx), list(imported.rx)) == (tx, rx)


@given(tables())
def test_our_own_dbc_gives_the_same_tables_again(both):
    tx, rx = both
    imported = from_dbc(to_dbc(image_of(tx, rx)))
    assert list(imported.tx) == sorted(tx, key=lambda m: m.index)
    assert list(imported.rx) == sorted(rx, key=lambda m: m.index)
    assert imported.notes == ()


@given(
    st.text(max_size=400) | st.lists(st.sampled_from(to_dbc(default_image()).splitlines()), max_size=20).map("\n".join)
)
def test_any_text_gives_tables_that_fit_or_an_error(text):
    try:
        imported = from_dbc(text)
    except DecodeError:
        return
    image = with_rx_messages(with_tx_messages(default_image(), imported.tx), imported.rx)
    assert all(error.field == "can_rx_msg_data" for error in check(image))


NUMBER = st.integers(0, 10**10).map(str) | st.sampled_from(["1e400", "nan", "-1", ""])


@given(st.lists(st.tuples(NUMBER, NUMBER, NUMBER, NUMBER, NUMBER), min_size=1, max_size=12))
def test_any_number_in_a_line_gives_tables_that_fit_or_an_error(numbers):
    text = "\n".join(
        f'BO_ {a} M{i}: {b} MASTER\n SG_ v_tot : {c}|{d}@1+ ({e},0) [0|0] "V" X\nBA_ "GenMsgCycleTime" BO_ {a} {e};'
        for i, (a, b, c, d, e) in enumerate(numbers)
    )
    test_any_text_gives_tables_that_fit_or_an_error.hypothesis.inner_test(text)
