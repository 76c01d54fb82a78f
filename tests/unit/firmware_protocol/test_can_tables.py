from dataclasses import replace

import pytest

from firmware_protocol import can_tables, config_image
from firmware_protocol.errors import EncodeError
from firmware_protocol.memory_map import BYTE_UNUSED, CONFIG, FIELDS, MASTER_SIZE
from firmware_protocol.messages import Window

DEFAULT = config_image.default_image()
TX, RX = can_tables.tx_messages(DEFAULT), can_tables.rx_messages(DEFAULT)


def struct_with(**values):
    image = bytearray(MASTER_SIZE)
    for name, value in values.items():
        FIELDS[name.replace("__", ".")].pack_into(image, (value,))
    return image


def test_default_tables():
    assert [(tx.can_id, tx.is_extended, tx.enabled, tx.period_ms, tx.length) for tx in TX[:3]] == [
        (0x1806E5F4, True, False, 1000, 8),
        (0x100, False, True, 100, 8),
        (0x101, False, False, 100, 8),
    ]
    assert [rx.enabled for rx in RX] == [True] + [False] * 7
    assert (RX[0].can_id, RX[0].is_extended, RX[0].timeout_ms, RX[0].response) == (0x18FF50E5, True, 5000, 0)
    assert RX[1].response is None


def test_charger_command_leaves_big_endian():
    image = struct_with(charger__v_set=980, charger__i_set=160)
    # Elcon's own example for 98.0 V, 16.0 A
    assert can_tables.message_bytes(TX[0], image).hex(" ").upper() == "03 D4 00 A0 00 00 00 00"


def test_ecu_summary_carries_the_structs_own_order():
    image = struct_with(soc=9991, v_tot=39850, i_fs=-5)
    assert can_tables.message_bytes(TX[1], image) == bytes([0x07, 0x27, 0xAA, 0x9B, 0xFB, 0xFF, 0xFF, 0xFF])


def test_cell_extremes_carry_ids_and_flags():
    image = struct_with(v_min=40594, v_max=40794, v_min_id=6, v_max_id=95, t_max=-8, status__flags=0x41)
    assert can_tables.message_bytes(TX[2], image) == bytes([0x92, 0x9E, 0x5A, 0x9F, 6, 95, 0xF8, 0x41])


def test_an_unused_entry_and_one_beyond_the_struct_send_zero():
    tx = replace(TX[1], data_offsets=(BYTE_UNUSED, MASTER_SIZE, 5, 0, 0, 0, 0, 0), length=3)
    assert can_tables.message_bytes(tx, b"\xee" * MASTER_SIZE) == b"\0\0\xee"


def read(rx, data):
    """What the host reads out of a message that the master listens for."""
    reader = can_tables.TableReader(can_tables.with_rx_messages(DEFAULT, [rx]))
    return reader.windows(rx.can_id | rx.is_extended << 31, data)


def test_charger_status_lands_in_the_struct():
    image = bytearray(MASTER_SIZE)
    windows = read(RX[0], bytes([0x0F, 0xC0, 0x00, 0xA0, 0x08, 9, 9, 9]))
    for window in windows:
        image[window.offset : window.offset + len(window.data)] = window.data
    assert FIELDS["charger.v_out"].unpack(image) == (4032,)
    assert FIELDS["charger.i_out"].unpack(image) == (160,)
    assert FIELDS["charger.flags"].unpack(image) == (8,)
    assert windows == (Window(432, image[432:436]), Window(437, b"\x08"))
    assert sum(image) == sum(b for w in windows for b in w.data)


def test_short_message_writes_only_what_it_has():
    assert read(RX[0], b"\x0f\xc0\x01") == (Window(432, b"\xc0\x0f"), Window(435, b"\x01"))


def test_bytes_beyond_the_tables_length_are_ignored():
    assert read(replace(RX[0], length=1), b"\x0f" * 8) == (Window(433, b"\x0f"),)


def test_host_learns_what_the_master_sent():
    image = struct_with(soc=9991, v_tot=39850, i_fs=-5, t_max=-31, v_min_id=7)
    shadow = bytearray(b"\x55" * MASTER_SIZE)
    for tx in TX[1:3]:
        for window in can_tables.windows_of_tx(tx, can_tables.message_bytes(tx, image)):
            shadow[window.offset : window.offset + len(window.data)] = window.data
    for name in ("soc", "v_tot", "i_fs", "t_max", "v_min_id"):
        assert FIELDS[name].unpack(shadow) == FIELDS[name].unpack(image)
    assert shadow.count(0x55) >= MASTER_SIZE - 16


@pytest.mark.parametrize(
    ("low", "value"), [(b"\x05\x00", 5), (b"\x05\x01", 261), (b"\xfb\xff", -5), (b"\x00\x80", -32768)]
)
def test_low_bytes_of_a_signed_number_bring_their_sign(low, value):
    tx = replace(TX[1], data_offsets=(1884, 1885) + (BYTE_UNUSED,) * 6, length=2)
    [window] = can_tables.windows_of_tx(tx, low)
    assert window.offset == 1884
    assert int.from_bytes(window.data, "little", signed=True) == value
    assert len(window.data) == 4


@pytest.mark.parametrize("offsets", [(1885, 1886), (1884, 1886), (1887, 2392), (1884, 2392)])
def test_other_parts_of_a_number_are_not_completed(offsets):
    tx = replace(TX[1], data_offsets=offsets + (BYTE_UNUSED,) * 6, length=2)
    assert sum(len(w.data) for w in can_tables.windows_of_tx(tx, b"\x80\x80")) == 2


def test_unsigned_number_is_not_completed():
    tx = replace(TX[1], data_offsets=(2392, 2393) + (BYTE_UNUSED,) * 6, length=2)
    assert can_tables.windows_of_tx(tx, b"\x01\x80") == (Window(2392, b"\x01\x80"),)


def test_the_later_of_two_bytes_for_one_place_counts():
    rx = replace(RX[0], data_offsets=(440, 440) + (BYTE_UNUSED,) * 6)
    assert read(rx, b"\x01\x02") == (Window(440, b"\x02"),)


def test_a_message_that_is_sent_and_listened_for_is_read_by_both_tables():
    both = can_tables.with_rx_messages(
        DEFAULT, [replace(RX[1], can_id=0x100, length=1, data_offsets=(440,) + (BYTE_UNUSED,) * 7)]
    )
    found = can_tables.TableReader(both).windows(0x100, b"\x07\x27")
    assert found == (Window(2982, b"\x07\x27"), Window(440, b"\x07"))


def test_an_entry_just_beyond_the_struct_takes_nothing():
    rx = replace(RX[0], data_offsets=(MASTER_SIZE, MASTER_SIZE - 1) + (BYTE_UNUSED,) * 6)
    assert read(rx, b"\x11\x22") == (Window(MASTER_SIZE - 1, b"\x22"),)


def test_tables_put_back_give_the_same_image():
    assert can_tables.with_tx_messages(DEFAULT, TX) == DEFAULT
    assert can_tables.with_rx_messages(DEFAULT, RX) == DEFAULT


def test_one_changed_message_changes_its_own_entries_only():
    tx = can_tables.TxMessage(5, True, 0x1ABCDEF0, True, 50, 3, (2280, 2281, 2286) + (BYTE_UNUSED,) * 5)
    image = can_tables.with_tx_messages(DEFAULT, [tx])
    assert can_tables.tx_messages(image)[5] == tx
    assert {c.field for c in config_image.difference(DEFAULT, image)} == {
        "can_tx_msg_en_startup",
        "can_tx_msg_id",
        "can_tx_msg_timing",
        "can_tx_msg_len",
        "can_tx_msg_data",
    }
    rx = can_tables.RxMessage(7, True, 0x7FF, False, 100, 1, (440,) + (BYTE_UNUSED,) * 7, 5)
    assert can_tables.rx_messages(can_tables.with_rx_messages(image, [rx]))[7] == rx
    assert config_image.check(can_tables.with_rx_messages(image, [rx])) == []


@pytest.mark.parametrize(
    ("change", "field", "value", "limit"),
    [
        ({"index": 8}, "index", 8, "0..7"),
        ({"index": -1}, "index", -1, "0..7"),
        ({"can_id": 1 << 31}, "can_id", 1 << 31, "0..0x1fffffff"),
        ({"can_id": -1}, "can_id", -1, "0..0x1fffffff"),
        ({"length": 9}, "length", 9, "0..8"),
        ({"length": -1}, "length", -1, "0..8"),
        ({"data_offsets": (1, 2)}, "can_{}_msg_data", [1, 2], "an array of 8 by 8"),
    ],
)
def test_message_that_does_not_fit_the_image_is_refused(change, field, value, limit):
    for put, message, table in (
        (can_tables.with_tx_messages, TX[0], "tx"),
        (can_tables.with_rx_messages, RX[0], "rx"),
    ):
        with pytest.raises(EncodeError) as refused:
            put(DEFAULT, [replace(message, **change)])
        error = refused.value
        assert (error.field, error.value, error.limit) == (field.format(table), value, limit)


@pytest.mark.parametrize(
    ("put", "message", "field"),
    [
        (can_tables.with_tx_messages, replace(TX[7], period_ms=65536), "can_tx_msg_timing[7]"),
        (can_tables.with_rx_messages, replace(RX[7], timeout_ms=65536), "can_rx_msg_timeout[7]"),
        (can_tables.with_rx_messages, replace(RX[7], response=256), "can_rx_msg_response[7]"),
    ],
)
def test_a_number_that_its_field_cannot_hold_is_refused(put, message, field):
    with pytest.raises(EncodeError) as refused:
        put(DEFAULT, [message])
    assert refused.value.field == field


def test_messages_at_their_limits_fit():
    tx = can_tables.TxMessage(0, False, 0x1FFFFFFF, True, 60_000, 0, (BYTE_UNUSED,) * 8)
    image = can_tables.with_tx_messages(DEFAULT, [tx])
    assert can_tables.tx_messages(image) == (tx, *TX[1:])
    rx = can_tables.RxMessage(0, False, 0, False, 0, 8, (2983,) * 8, None)
    assert can_tables.rx_messages(can_tables.with_rx_messages(image, [rx])) == (rx, *RX[1:])


def test_a_length_beyond_a_can_frame_reads_as_eight():
    image = config_image.with_raw(DEFAULT, "can_tx_msg_len", [9] * 8)
    image = config_image.with_raw(image, "can_rx_msg_len", [255] * 8)
    assert {m.length for m in (*can_tables.tx_messages(image), *can_tables.rx_messages(image))} == {8}


def test_a_response_that_names_no_message_reads_as_none():
    image = config_image.with_raw(DEFAULT, "can_rx_msg_response", [7, 8, 255, 0, 1, 2, 3, 4])
    assert [rx.response for rx in can_tables.rx_messages(image)] == [7, None, None, 0, 1, 2, 3, 4]


@pytest.mark.parametrize(
    ("name", "little", "big"),
    [
        ("i_fs", (1884, 1885, 1886, 1887), (1887, 1886, 1885, 1884)),
        ("v[1]", (1898, 1899), (1899, 1898)),
        ("t[95]", (2385,), (2385,)),
        ("slave[1].cvr[2]", (710, 711), (711, 710)),
    ],
)
def test_a_named_value_has_its_bytes_in_either_order(name, little, big):
    field, element = can_tables.named_element(name)
    assert can_tables.offsets_of(field, element, is_big_endian=False) == little
    assert can_tables.offsets_of(field, element, is_big_endian=True) == big


def test_a_name_that_the_struct_does_not_have_is_refused():
    with pytest.raises(EncodeError) as refused:
        can_tables.named_element("v[96]" + "!" * 80)
    assert (refused.value.field, refused.value.value) == ("signal", "v[96]" + "!" * 55)
    assert refused.value.limit == "a value of the memory map, such as v_tot, v[36], slave[3].cvr[5]"


def test_every_frame_of_the_tables_is_read_and_no_other():
    reader = can_tables.TableReader(DEFAULT)
    assert reader.windows(0x9806E5F4, bytes.fromhex("03D400A000000000")) == (
        Window(428, bytes.fromhex("D403A000")),
        Window(436, b"\0"),
    )
    assert reader.windows(0x98FF50E5, bytes.fromhex("0FC000A008000000")) == (
        Window(432, bytes.fromhex("C00FA000")),
        Window(437, b"\x08"),
    )
    for can_id in (0x1806E5F4, 0x80000100, 0, 0x7FF):
        assert reader.windows(can_id, bytes(8)) == ()


def test_a_reader_completes_signs_only_of_what_the_master_sends():
    low_bytes = (1884, 1885) + (BYTE_UNUSED,) * 6
    image = can_tables.with_tx_messages(DEFAULT, [replace(TX[3], can_id=0x300, length=2, data_offsets=low_bytes)])
    image = can_tables.with_rx_messages(image, [replace(RX[1], can_id=0x301, length=2, data_offsets=low_bytes)])
    reader = can_tables.TableReader(image)
    assert reader.windows(0x300, b"\xfb\xff") == (Window(1884, b"\xfb\xff\xff\xff"),)
    assert reader.windows(0x301, b"\xfb\xff") == (Window(1884, b"\xfb\xff"),)


def test_two_messages_of_one_id_are_both_read():
    twice = can_tables.with_tx_messages(
        DEFAULT, [replace(TX[3], can_id=0x100, length=1, data_offsets=(440,) + (BYTE_UNUSED,) * 7)]
    )
    assert can_tables.TableReader(twice).windows(0x100, b"\x07\x27") == (
        Window(2982, b"\x07\x27"),
        Window(440, b"\x07"),
    )


@pytest.mark.parametrize(("can_brp", "rate"), [(3, 1_000_000), (7, 500_000), (15, 250_000), (31, 125_000)])
def test_bit_rate(can_brp, rate):
    assert can_tables.bit_rate(can_brp) == rate


@pytest.mark.parametrize(
    ("length", "is_extended", "bits"), [(8, False, 135), (8, True, 160), (0, False, 55), (0, True, 80), (1, False, 65)]
)
def test_worst_case_frame_length_is_the_published_one(length, is_extended, bits):
    assert can_tables.worst_case_bits(length, is_extended) == bits


def test_bus_load_counts_cyclic_and_answering_messages():
    # ECU summary 10 a second of 135 bits, charger command 1 a second of 160 bits, at 500 kbit/s
    assert can_tables.bus_load(DEFAULT) == pytest.approx((1350 + 160) / 500_000)
    often = can_tables.with_tx_messages(DEFAULT, [replace(TX[1], period_ms=1, length=0)])
    assert can_tables.bus_load(often) == pytest.approx((55_000 + 160) / 500_000)
    on_demand = can_tables.with_tx_messages(DEFAULT, [replace(TX[1], period_ms=0)])
    assert can_tables.bus_load(config_image.with_raw(on_demand, "can_brp", 31)) == pytest.approx(160 / 125_000)
    silent = can_tables.with_tx_messages(DEFAULT, [replace(TX[1], enabled=False)])
    silent = can_tables.with_rx_messages(silent, [replace(RX[0], enabled=False)])
    assert can_tables.bus_load(silent) == 0


def test_a_message_to_charge_by_keeps_its_response_and_needs_one():
    first = replace(RX[0], charges=True)
    image = can_tables.with_rx_messages(DEFAULT, [first])
    assert CONFIG["can_rx_msg_response"].unpack(image)[0] == 64
    assert can_tables.rx_messages(image)[0] == first
    with pytest.raises(EncodeError, match="charges"):
        can_tables.with_rx_messages(DEFAULT, [replace(first, response=None)])
