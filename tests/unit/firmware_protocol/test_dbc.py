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


TEXT = """\
VERSION ""

NS_ :

BS_:

BU_: MASTER CHARGER

BO_ 2550588916 CHARGER_COMMAND: 5 MASTER
 SG_ charger_v_set : 7|16@0+ (0.1,0) [0|6553.5] "V" CHARGER
 SG_ charger_i_set : 23|16@0+ (0.1,0) [0|6553.5] "A" CHARGER
 SG_ charger_control : 32|8@1+ (1,0) [0|255] "" CHARGER

BO_ 256 MASTER_TX_1: 7 MASTER
 SG_ soc : 0|16@1+ (0.0001,0) [0|6.5535] "" Vector__XXX
 SG_ i_fs : 16|16@1- (0.01,0) [-327.68|327.67] "A" Vector__XXX
 SG_ t_95 : 32|8@1- (1,0) [-128|127] "degC" Vector__XXX
 SG_ dod_byte0 : 40|8@1+ (1,0) [0|255] "" Vector__XXX
 SG_ status_load : 48|1@1+ (1,0) [0|1] "" Vector__XXX

BO_ 2566869221 CHARGER_STATUS: 1 CHARGER
 SG_ n_slaves : 0|8@1+ (1,0) [0|255] "" MASTER

BO_ 769 MASTER_RX_6: 1 Vector__XXX
 SG_ charger_state : 0|8@1+ (1,0) [0|255] "" MASTER

CM_ "as written by hand";
CM_ SG_ 2550588916 charger_v_set "voltage requested from the charger";
CM_ SG_ 2550588916 charger_i_set "current requested from the charger";
CM_ SG_ 2550588916 charger_control "0 charge, 1 stop";
CM_ SG_ 256 soc "state of charge, the master's own count";
CM_ SG_ 256 i_fs "current, positive on discharge, mean of the last ts samples";
CM_ SG_ 256 t_95 "cell temperatures; -128 no measurement";
CM_ SG_ 256 dod_byte0 "byte 0 of dod";
CM_ SG_ 256 status_load "load flag in status.flags";
CM_ SG_ 2566869221 n_slaves "slaves that responded";
CM_ SG_ 769 charger_state "the master's charging state: 0 off, 1 waiting, 2 constant_current, 3 balancing, \
4 constant_voltage, 5 done, 6 fault";
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;
BA_DEF_ "Baudrate" INT 0 1000000;
BA_DEF_ BO_ "VoltwallIndex" INT -1 7;
BA_DEF_ BO_ "VoltwallEnabled" INT 0 1;
BA_DEF_ BO_ "VoltwallTimeout" INT 0 65535;
BA_DEF_ BO_ "VoltwallAnswer" INT -1 71;
BA_DEF_DEF_ "GenMsgCycleTime" 0;
BA_DEF_DEF_ "Baudrate" 500000;
BA_DEF_DEF_ "VoltwallIndex" -1;
BA_DEF_DEF_ "VoltwallEnabled" 0;
BA_DEF_DEF_ "VoltwallTimeout" 0;
BA_DEF_DEF_ "VoltwallAnswer" -1;
BA_ "Baudrate" 500000;
BA_ "GenMsgCycleTime" BO_ 2550588916 1000;
BA_ "VoltwallIndex" BO_ 2550588916 0;
BA_ "VoltwallEnabled" BO_ 2550588916 0;
BA_ "GenMsgCycleTime" BO_ 256 100;
BA_ "VoltwallIndex" BO_ 256 1;
BA_ "VoltwallEnabled" BO_ 256 1;
BA_ "VoltwallIndex" BO_ 2566869221 0;
BA_ "VoltwallEnabled" BO_ 2566869221 1;
BA_ "VoltwallTimeout" BO_ 2566869221 5000;
BA_ "VoltwallAnswer" BO_ 2566869221 0;
BA_ "VoltwallIndex" BO_ 769 6;
BA_ "VoltwallEnabled" BO_ 769 0;
BA_ "VoltwallTimeout" BO_ 769 70;
VAL_ 2550588916 charger_control 0 "charge" 1 "stop" ;
VAL_ 769 charger_state 0 "off" 1 "waiting" 2 "constant_current" 3 "balancing" 4 "constant_voltage" 5 "done" 6 "fault" ;
"""


def test_a_small_table_gives_this_file():
    rx = can_tables.rx_messages(DEFAULT)
    image = can_tables.with_tx_messages(
        DEFAULT,
        [
            replace(TX[0], length=5),
            replace(tx_of(2982, 2983, 1884, 1885, 2385, 2392, 421, index=1), can_id=0x100, period_ms=100),
            tx_of(index=2),
        ],
    )
    image = can_tables.with_rx_messages(
        image,
        [
            replace(rx[0], length=1, data_offsets=(440,) + (BYTE_UNUSED,) * 7),
            can_tables.RxMessage(6, False, 0x301, False, 70, 1, (438,) + (BYTE_UNUSED,) * 7, None),
        ],
    )
    assert dbc.to_dbc(image, "as written by hand") == TEXT


def test_without_a_comment_the_file_has_none_of_its_own():
    assert '\nCM_ "' not in dbc.to_dbc(DEFAULT)


def test_of_two_messages_with_one_id_the_sent_one_is_in_the_file():
    rx = can_tables.rx_messages(DEFAULT)[1]
    both = can_tables.with_rx_messages(DEFAULT, [replace(rx, can_id=0x100, length=1)])
    assert dbc.to_dbc(both) == dbc.to_dbc(DEFAULT)


@pytest.mark.parametrize(
    ("can_id", "is_extended", "sent", "listened"),
    [
        (0x1806E5F4, True, "CHARGER_COMMAND", "MASTER_RX_3"),
        (0x18FF50E5, True, "MASTER_TX_3", "CHARGER_STATUS"),
        (0x1806E5F4, False, "MASTER_TX_3", "MASTER_RX_3"),
        (0x18FF50E5, False, "MASTER_TX_3", "MASTER_RX_3"),
    ],
)
def test_a_message_is_named_by_its_id_or_its_place(can_id, is_extended, sent, listened):
    tx = replace(tx_of(), can_id=can_id, is_extended=is_extended)
    rx = can_tables.RxMessage(3, True, can_id, is_extended, 0, 0, (BYTE_UNUSED,) * 8, None)
    assert (dbc.message_name(tx), dbc.message_name(rx)) == (sent, listened)


@pytest.mark.parametrize(
    ("offsets", "data", "expected"),
    [
        ((1884, 1885), "fbff", [("i_fs", (-0.05, None))]),
        ((1885, 1884), "fffb", [("i_fs", (-0.05, None))]),
        ((2283, 2282), "9f5a", [("v_max", (4.0794, None))]),
        ((2387,), "f8", [("t_max", (-8.0, None))]),
        ((436,), "01", [("charger_control", (1.0, "stop"))]),
        ((436,), "07", [("charger_control", (7.0, None))]),
        ((421,), "01", [("status_load", (1.0, None))]),
        ((421,), "fe", [("status_load", (0.0, None))]),
        ((2392,), "80", [("dod_byte0", (128.0, None))]),
        ((440, 2982, 2983), "0807", [("n_slaves", (8.0, None)), ("soc", None)]),
    ],
)
def test_a_signal_is_decoded_in_its_unit_and_word(offsets, data, expected):
    raw = bytes.fromhex(data)
    assert [(s.name, dbc.decode(s, raw)) for s in dbc.signals(tx_of(*offsets))] == expected


def test_every_flag_of_a_byte_is_its_own_bit():
    flags = dbc.signals(tx_of(440, 437))[1:]
    assert [(s.name, s.start_byte, s.first_bit, s.n_bits, s.is_signed) for s in flags] == [
        ("charger_hardware", 1, 0, 1, False),
        ("charger_over_temperature", 1, 1, 1, False),
        ("charger_input_voltage", 1, 2, 1, False),
        ("charger_battery", 1, 3, 1, False),
        ("charger_timeout", 1, 4, 1, False),
    ]
    values = [dbc.decode(s, b"\0" + bytes([0b01010])) for s in flags]
    assert values == [(0.0, None), (1.0, None), (0.0, None), (1.0, None), (0.0, None)]


def test_a_byte_of_flags_without_a_name_is_a_plain_byte():
    [signal] = dbc.signals(tx_of(422))
    assert (signal.name, signal.n_bits, signal.meaning, signal.is_cut) == (
        "status_flags_byte2",
        8,
        "byte 2 of status.flags",
        True,
    )


def test_a_torn_number_says_so_and_a_whole_one_does_not():
    torn, whole = dbc.signals(tx_of(2289, 440))
    assert (torn.name, torn.is_cut, torn.scale, torn.unit) == ("v_tot_byte1", True, 1.0, "")
    assert (whole.name, whole.is_cut) == ("n_slaves", False)


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


def test_three_low_bytes_of_a_signed_number_are_that_number():
    assert names(tx_of(1884, 1885, 1886)) == [("i_fs", 0, 3, "little")]
    assert names(tx_of(440, 1886, 1885, 1884)) == [("n_slaves", 0, 1, "little"), ("i_fs", 1, 3, "big")]


def test_numbers_that_touch_are_told_apart():
    assert names(tx_of(2281, 2280, 2283, 2282, 2284, 2285)) == [
        ("v_min", 0, 2, "big"),
        ("v_max", 2, 2, "big"),
        ("v_avg", 4, 2, "little"),
    ]


def test_a_number_that_the_length_cuts_off_is_bytes():
    cut_off = replace(tx_of(440, 2982, 2983), length=2)
    assert names(cut_off) == [("n_slaves", 0, 1, "little"), ("soc_byte0", 1, 1, "little")]


def test_unused_entries_and_padding_have_no_signal():
    assert names(tx_of(BYTE_UNUSED, 225, 2286)) == [("v_min_id", 2, 1, "little")]


def test_second_copy_gets_a_number():
    assert [s.name for s in dbc.signals(tx_of(2982, 2983, 2982, 2983, 440, 2983, 2982))] == [
        "soc",
        "soc_2",
        "n_slaves",
        "soc_3",
    ]


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
