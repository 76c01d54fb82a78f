from dataclasses import replace

import cantools
import pytest

from firmware_protocol import can_tables, config_image, dbc
from firmware_protocol.memory_map import BYTE_UNUSED, FIELDS, MASTER_SIZE

DEFAULT = config_image.default_image()
TX = can_tables.tx_messages(DEFAULT)


def database(image):
    return cantools.database.load_string(dbc.to_dbc(image), "dbc", strict=True)


def tx_of(*offsets, index=3):
    return can_tables.TxMessage(
        index, True, 0x200 + index, False, 20, len(offsets), offsets + (BYTE_UNUSED,) * (8 - len(offsets))
    )


def struct_with(values):
    image = bytearray(MASTER_SIZE)
    for name, raw in values.items():
        FIELDS[name].pack_into(image, (raw,))
    return image


def test_a_comment_of_the_file_leaves_it_readable():
    text = dbc.to_dbc(DEFAULT, "The default tables.")
    assert 'CM_ "The default tables.";' in text.splitlines()
    assert len(cantools.database.load_string(text, "dbc", strict=True).messages) == len(database(DEFAULT).messages)


def test_default_messages_are_all_there():
    db = database(DEFAULT)
    assert {(m.name, m.frame_id, m.is_extended_frame, m.length, m.cycle_time) for m in db.messages} == {
        ("CHARGER_COMMAND", 0x1806E5F4, True, 8, 1000),
        ("MASTER_TX_1", 0x100, False, 8, 100),
        ("MASTER_TX_2", 0x101, False, 8, 100),
        ("CHARGER_STATUS", 0x18FF50E5, True, 8, None),
    }
    assert db.dbc.attributes["Baudrate"].value == 500_000


def test_a_tool_reads_the_struct_out_of_the_messages():
    db = database(DEFAULT)
    image = struct_with(
        {
            "soc": 9991,
            "v_tot": 39850,
            "i_fs": -512,
            "v_min": 40594,
            "v_max": 40794,
            "v_min_id": 6,
            "v_max_id": 95,
            "t_max": -8,
            "status.flags": 0x41,
        }
    )
    summary = db.decode_message("MASTER_TX_1", can_tables.message_bytes(TX[1], image))
    assert summary == pytest.approx({"soc": 0.9991, "v_tot": 398.5, "i_fs": -5.12})
    extremes = db.decode_message("MASTER_TX_2", can_tables.message_bytes(TX[2], image))
    assert (extremes["v_min"], extremes["v_max"]) == pytest.approx((4.0594, 4.0794))
    assert (extremes["v_min_id"], extremes["v_max_id"], extremes["t_max"]) == (6, 95, -8)
    assert [name for name, value in extremes.items() if name.startswith("status_") and value] == [
        "status_fit",
        "status_charging",
    ]


def test_charger_messages_are_big_endian():
    db = database(DEFAULT)
    command = db.decode_message("CHARGER_COMMAND", bytes.fromhex("03D400A000000000"))
    assert (command["charger_v_set"], command["charger_i_set"]) == pytest.approx((98.0, 16.0))
    assert command["charger_control"] == "charge"
    status = db.decode_message("CHARGER_STATUS", bytes.fromhex("0FC000A008000000"))
    assert status["charger_v_out"] == pytest.approx(403.2)
    assert status["charger_i_out"] == pytest.approx(16.0)
    assert (status["charger_battery"], status["charger_hardware"]) == (1, 0)


def test_units_comments_and_names():
    message = database(DEFAULT).get_message_by_name("MASTER_TX_1")
    signal = message.get_signal_by_name("i_fs")
    assert (signal.unit, signal.is_signed, signal.length) == ("A", True, 32)
    assert "positive on discharge" in signal.comment


def names(message):
    return [(s.name, s.start_byte, s.length, s.byte_order) for s in dbc.signals(message)]


def test_cells_are_named_with_their_index():
    assert names(tx_of(1896 + 72, 1897 + 72, 2290 + 95)) == [("v_36", 0, 2, "little"), ("t_95", 2, 1, "little")]


def test_numbers_in_either_order():
    assert names(tx_of(1884, 1885, 1886, 1887, 2283, 2282)) == [("i_fs", 0, 4, "little"), ("v_max", 4, 2, "big")]


def test_low_bytes_of_a_signed_number_are_that_number():
    assert names(tx_of(1884, 1885)) == [("i_fs", 0, 2, "little")]
    assert names(tx_of(1885, 1884)) == [("i_fs", 0, 2, "big")]


def test_low_bytes_of_an_unsigned_number_and_torn_numbers_are_bytes():
    assert names(tx_of(2392, 2393)) == [("dod_byte0", 0, 1, "little"), ("dod_byte1", 1, 1, "little")]
    assert names(tx_of(2983, 440, 2982)) == [
        ("soc_byte1", 0, 1, "little"),
        ("n_slaves", 1, 1, "little"),
        ("soc_byte0", 2, 1, "little"),
    ]
    assert names(tx_of(1886, 1885)) == [("i_fs_byte2", 0, 1, "little"), ("i_fs_byte1", 1, 1, "little")]


def test_unused_entries_and_padding_have_no_signal():
    assert names(tx_of(BYTE_UNUSED, 225, 2286)) == [("v_min_id", 2, 1, "little")]


def test_second_copy_gets_a_number():
    assert [s.name for s in dbc.signals(tx_of(2982, 2983, 2982, 2983))] == ["soc", "soc_2"]


def test_slave_status_has_its_words():
    image = can_tables.with_tx_messages(DEFAULT, [tx_of(444 + 180 * 7)])
    message = database(image).get_message_by_name("MASTER_TX_3")
    assert message.decode(b"\xff") == {"slave_7_status": "fault"}


def test_message_without_bytes_and_second_message_with_an_id_are_left_out():
    twice = can_tables.with_tx_messages(DEFAULT, [replace(tx_of(2286), can_id=0x100), replace(tx_of(), index=4)])
    assert {m.name for m in database(twice).messages} == {m.name for m in database(DEFAULT).messages}


def test_every_byte_of_the_struct_can_be_sent_and_named():
    for start in range(0, MASTER_SIZE, 64):
        rows = [tuple(range(start + 8 * i, min(start + 8 * i + 8, MASTER_SIZE))) for i in range(8)]
        table = [tx_of(*row, index=i) for i, row in enumerate(rows)]
        for message in database(can_tables.with_tx_messages(DEFAULT, table)).messages:
            assert all(len(signal.name) <= 32 for signal in message.signals)
