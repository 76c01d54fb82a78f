"""Configuration images and CAN tables: any bytes are judged, what is put in comes out."""

from dataclasses import replace

from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_protocol import can_tables, config_image, dbc
from firmware_protocol.can_tables import RxMessage, TxMessage
from firmware_protocol.config_image import FieldError
from firmware_protocol.memory_map import BYTE_UNUSED, CONFIG, CONFIG_FIELDS, CONFIG_SIZE, MASTER_SIZE
from tests.campaign import examples

DEFAULT = config_image.default_image()
IMAGES = st.binary(min_size=CONFIG_SIZE, max_size=CONFIG_SIZE)
SCALARS = st.sampled_from([field for field in CONFIG_FIELDS if not field.shape])
OFFSETS = st.lists(st.integers(0, MASTER_SIZE - 1) | st.just(BYTE_UNUSED), min_size=8, max_size=8).map(tuple)
STRUCTS = st.binary(min_size=MASTER_SIZE, max_size=MASTER_SIZE)


@st.composite
def tx_messages(draw):
    is_extended = draw(st.booleans())
    can_id = draw(st.integers(0, config_image.MAX_ID_EXTENDED if is_extended else config_image.MAX_ID_STANDARD))
    index, length, period_ms = draw(st.integers(0, 7)), draw(st.integers(0, 8)), draw(st.integers(0, 60000))
    return TxMessage(index, draw(st.booleans()), can_id, is_extended, period_ms, length, draw(OFFSETS))


@st.composite
def rx_messages(draw):
    tx = draw(tx_messages())
    offsets = tuple(max(offset, CONFIG_SIZE) for offset in tx.data_offsets)
    response = draw(st.none() | st.integers(0, 7))
    return RxMessage(tx.index, tx.enabled, tx.can_id, tx.is_extended, tx.period_ms, tx.length, offsets, response)


@given(IMAGES)
def test_any_image_is_judged(image):
    errors = config_image.check(image)
    assert all(isinstance(error, FieldError) and error.message for error in errors)
    assert [error.offset for error in errors] == sorted(error.offset for error in errors)
    assert all(0 <= error.offset < CONFIG_SIZE for error in errors)


@given(SCALARS, st.data())
def test_a_single_value_in_its_range_is_refused_only_beside_another(field, data):
    raw = data.draw(st.integers(field.minimum, field.maximum))
    errors = config_image.check(config_image.with_raw(DEFAULT, field.name, raw))
    assert all("allowed" in error.message and str(error.limit).startswith(("below", "at most")) for error in errors)


@given(SCALARS, st.data())
def test_value_in_unit_comes_back_within_half_a_count(field, data):
    low, high = field.minimum * field.scale, field.maximum * field.scale
    value = data.draw(st.floats(low, high) if field.scale != 1 else st.integers(int(low), int(high)))
    image = config_image.with_value(DEFAULT, field.name, value)
    assert abs(config_image.unit_value(image, field.name) - value) <= field.scale * 0.5000001
    assert {change.field for change in config_image.difference(DEFAULT, image)} <= {field.name}


@given(IMAGES)
def test_every_count_survives_its_unit(image):
    for field in CONFIG_FIELDS:
        for raw in field.unpack(image):
            if field.minimum <= raw <= field.maximum:
                assert config_image.to_raw(field, config_image.to_unit(field, raw)) == raw


@given(IMAGES, IMAGES)
def test_difference_is_empty_exactly_where_the_hash_is_the_same(before, after):
    same = config_image.image_hash(before) == config_image.image_hash(after)
    assert (config_image.difference(before, after) == []) is same
    assert config_image.difference(before, before) == []


@given(IMAGES, IMAGES)
def test_difference_names_every_byte_that_differs(before, after):
    named = bytearray(config_image.canonical(before))
    for change in config_image.difference(before, after):
        size = CONFIG[change.field].item_size
        named[change.offset : change.offset + size] = after[change.offset : change.offset + size]
    assert bytes(named) == config_image.canonical(after)


@settings(max_examples=examples(40))
@given(st.lists(tx_messages(), max_size=8), st.lists(rx_messages(), max_size=8))
def test_tables_put_into_an_image_come_out_and_are_accepted(tx, rx):
    image = can_tables.with_rx_messages(can_tables.with_tx_messages(DEFAULT, tx), rx)
    assert config_image.check(image) == []
    assert all(can_tables.tx_messages(image)[m.index] == m for m in {m.index: m for m in tx}.values())
    assert all(can_tables.rx_messages(image)[m.index] == m for m in {m.index: m for m in rx}.values())
    assert can_tables.bus_load(image) >= 0
    assert dbc.to_dbc(image).startswith("VERSION")


@given(IMAGES)
def test_tables_of_any_image_are_readable(image):
    assert len(can_tables.tx_messages(image)) == len(can_tables.rx_messages(image)) == 8
    for message in can_tables.tx_messages(image):
        assert len(can_tables.message_bytes(message, bytes(MASTER_SIZE))) == message.length


@given(tx_messages(), STRUCTS)
def test_host_learns_exactly_the_bytes_that_were_sent(tx, struct):
    sent = can_tables.message_bytes(tx, struct)
    windows = can_tables.windows_of_tx(tx, sent)
    told = {window.offset + i: byte for window in windows for i, byte in enumerate(window.data)}
    carried = [offset for offset in tx.data_offsets[: tx.length] if offset != BYTE_UNUSED]
    assert all(told[offset] == struct[offset] for offset in carried)
    assert [window.offset for window in windows] == sorted(window.offset for window in windows)


@given(tx_messages())
def test_signals_cover_no_byte_twice(tx):
    found = [signal for signal in dbc.signals(replace(tx, length=8)) if signal.n_bits > 1]
    covered = [byte for signal in found for byte in range(signal.start_byte, signal.start_byte + signal.length)]
    assert len(covered) == len(set(covered))
    assert all(tx.data_offsets[byte] != BYTE_UNUSED for byte in covered)
