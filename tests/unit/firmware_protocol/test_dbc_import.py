"""DBC files of others into tables: as far as their names are the struct's, the rest told."""

import pytest

from firmware_protocol.can_tables import named_element, rx_messages, tx_messages
from firmware_protocol.config_image import check, default_image
from firmware_protocol.dbc_import import from_dbc, into_tables
from firmware_protocol.errors import DecodeError, EncodeError
from firmware_protocol.memory_map import BYTE_UNUSED, FIELDS, element_name

UNUSED = [BYTE_UNUSED] * 8
FOREIGN = """\
VERSION ""
BU_: BMS ECU
BO_ 256 Summary: 8 BMS
 SG_ v_tot : 7|16@0+ (0.01,0) [0|655] "V" ECU
 SG_ soc : 16|16@1+ (0.0001,0) [0|1] "" ECU
 SG_ mystery : 32|8@1+ (1,0) [0|255] "" ECU
 SG_ t_max : 44|8@1- (1,0) [0|255] "" ECU
BO_ 2566869221 FromEcu: 2 ECU
 SG_ charger_v_out : 0|16@1+ (1,0) [0|0] "V" BMS
BA_ "GenMsgCycleTime" BO_ 256 50;
BA_ "GenMsgCycleTime" BO_ 2566869221 200;
"""


def test_a_foreign_dbc_is_taken_as_far_as_its_names_go():
    imported = from_dbc(FOREIGN, "BMS")
    [tx], [rx] = imported.tx, imported.rx
    assert (tx.can_id, tx.period_ms, tx.enabled, tx.length) == (256, 50, True, 8)
    assert tx.data_offsets == (2289, 2288, 2982, 2983, *UNUSED[:4])
    assert (rx.can_id, rx.is_extended, rx.timeout_ms) == (2566869221 & 0x7FFFFFFF, True, 1000)
    words = "; ".join(imported.notes)
    assert "mystery: no value of the master's has this name" in words
    assert "t_max: it does not fill whole bytes" in words
    assert "charger_v_out: scale 1, the master's is 0.1" in words


def summary(dbc_id, name="M", sender="MASTER", length=2):
    return f'BO_ {dbc_id} {name}: {length} {sender}\n SG_ soc : 0|16@1+ (0.0001,0) [0|1] "" X\n'


def test_the_same_number_in_11_and_in_29_bits_are_two_messages():
    imported = from_dbc(summary(0x100) + summary(0x80000100, "N"))
    assert [(m.can_id, m.is_extended) for m in imported.tx] == [(0x100, False), (0x100, True)]
    image, notes = into_tables(default_image(), imported)
    assert notes == ()
    assert sum(m.can_id == 0x100 and m.length > 0 for m in tx_messages(image)) == 2


def test_an_answer_follows_its_message_to_the_place_that_it_gets():
    text = summary(0x1A0) + summary(0x1A1, "Ask", "ECU")
    text += 'BA_ "VoltwallIndex" BO_ 416 0;\nBA_ "VoltwallAnswer" BO_ 417 0;\n'
    imported = from_dbc(text)
    image, notes = into_tables(default_image(), imported)  # where place 0 holds the charger command
    [sent] = [m for m in tx_messages(image) if m.can_id == 0x1A0]
    [asked] = [m for m in rx_messages(image) if m.can_id == 0x1A1]
    assert sent.index != 0
    assert asked.response == sent.index
    assert notes == ()
    image, notes = into_tables(default_image(), from_dbc(text.replace('Answer" BO_ 417 0', 'Answer" BO_ 417 5')))
    assert [m.response for m in rx_messages(image) if m.can_id == 0x1A1] == [None]
    assert notes == ("id 0x1a1: its answer, message 6 sent, is not in the file",)


def test_an_id_that_would_be_sent_and_received_is_told():
    image, notes = into_tables(default_image(), from_dbc(summary(0x100, "Summary", "BMS")))
    assert notes == ("id 0x100: now both sent and received, which no write allows: remove one of them",)
    assert check(image) == []


@pytest.mark.parametrize(
    "text", ["", 'VERSION ""', "BO_ x", "BO_ 3221225472 VECTOR__INDEPENDENT_SIG_MSG: 0 X\n SG_ soc : 0|16@1+ (1,0)"]
)
def test_a_file_without_a_message_is_an_error(text):
    with pytest.raises(DecodeError) as refused:
        from_dbc(text)
    assert (refused.value.what, refused.value.reason) == ("DBC", "no message (BO_) in it")


def test_a_file_without_an_end_is_an_error():
    text = "BO_ 1 M: 1 MASTER".ljust(1_000_000)
    assert len(from_dbc(text).tx) == 1
    with pytest.raises(DecodeError) as refused:
        from_dbc(text + " ")
    assert (refused.value.what, refused.value.reason) == ("DBC", "1000001 characters, at most 1000000")


def signal(name, start, bits, order="1", sign="+", scale="1"):
    return f' SG_ {name} : {start}|{bits}@{order}{sign} ({scale},0) [0|0] "" X\n'


def one(*signals, length=8, sender="MASTER"):
    return from_dbc(f"BO_ 1 M: {length} {sender}\n" + "".join(signals))


@pytest.mark.parametrize(
    ("text", "offsets"),
    [
        (signal("soc", 0, 16, scale="0.0001"), (2982, 2983)),
        (signal("soc", 7, 16, "0", scale="0.0001"), (2983, 2982)),
        (signal("soc_2", 0, 16, scale="1e-4"), (2982, 2983)),
        (signal("i_fs", 0, 32, sign="-", scale="0.01"), (1884, 1885, 1886, 1887)),
        (signal("i_fs", 0, 16, sign="-", scale="0.01"), (1884, 1885)),
        (signal("i_fs", 7, 24, "0", "-", "0.01"), (1886, 1885, 1884)),
        (signal("v_95", 0, 16, scale="0.0001"), (2086, 2087)),
        (signal("slave_7_cvr_11", 0, 16, scale="0.0001"), (1808, 1809)),
        (signal("t_0", 0, 8, sign="-"), (2290,)),
        (signal("dod_byte2", 0, 8), (2394,)),
        (signal("dod_byte2_2", 0, 8), (2394,)),
        (signal("i_fs_byte3", 0, 8), (1887,)),
        (signal("status_load", 0, 1), (421,)),
        (signal("status_fit", 5, 1), (420,)),
        (signal("charger_timeout_2", 3, 1), (437,)),
    ],
)
def test_a_signal_of_our_names_takes_its_bytes(text, offsets):
    imported = one(text)
    assert imported.notes == ()
    assert imported.tx[0].data_offsets == (*offsets, *UNUSED[len(offsets) :])


@pytest.mark.parametrize(
    ("text", "offset"),
    [
        (signal("status_load", 57, 1), 421),
        (signal("charger_battery", 56, 1), 437),
        (signal("dod_byte3", 56, 8), 2395),
        (signal("v_10_byte1", 56, 8), 1917),
        (signal("n_slaves", 56, 8), 440),
    ],
)
def test_the_last_byte_of_a_message_is_taken_as_the_first(text, offset):
    imported = one(text)
    assert (imported.notes, imported.tx[0].data_offsets) == ((), (*UNUSED[:7], offset))


@pytest.mark.parametrize(
    ("text", "note"),
    [
        (signal("mystery", 0, 8), "mystery: no value of the master's has this name"),
        (signal("soc_byte2", 0, 8), "soc_byte2: no value of the master's has this name"),
        (signal("soc_byte0", 0, 16), "soc_byte0: no value of the master's has this name"),
        (signal("status_load", 0, 2), "status_load: no value of the master's has this name"),
        (signal("t_max", 4, 8, sign="-"), "t_max: it does not fill whole bytes"),
        (signal("t_max", 0, 7, sign="-"), "t_max: it does not fill whole bytes"),
        (signal("soc", 0, 16, "0"), "soc: it does not fill whole bytes"),
        (signal("soc", 7, 16), "soc: it does not fill whole bytes"),
        (signal("soc", 0, 8), "soc: 8 bits, the master's has 16"),
        (signal("soc", 0, 24), "soc: 24 bits, the master's has 16"),
        (signal("soc", 0, 0), "soc: 0 bits, the master's has 16"),
        (signal("i_fs", 0, 8, sign="-"), "i_fs: 8 bits, the master's has 32"),
        (signal("i_fs", 0, 40, sign="-"), "i_fs: 40 bits, the master's has 32"),
        (signal("soc", 0, 16, sign="-"), "soc: it is signed, the master's is not"),
        (signal("i_fs", 0, 32), "i_fs: it is unsigned, the master's is not"),
        (signal("soc", 56, 16, scale="0.0001"), "soc: ends beyond the message"),
    ],
)
def test_a_signal_without_a_place_is_told_and_its_bytes_stay_unused(text, note):
    imported = one(text, signal("n_slaves", 48, 8))
    assert imported.notes == (f"M.{note}; its bytes stay unused",)
    assert imported.tx[0].data_offsets == (*UNUSED[:6], 440, BYTE_UNUSED), "the others are taken all the same"


def test_a_signal_may_end_with_its_message():
    assert one(signal("soc", 8, 16, scale="0.0001"), length=3).tx[0].data_offsets[:4] == (BYTE_UNUSED, 2982, 2983,
                                                                                     BYTE_UNUSED)  # fmt: skip
    assert one(signal("soc", 8, 16, scale="0.0001"), length=2).notes == (
        "M.soc: ends beyond the message; its bytes stay unused",
    )


@pytest.mark.parametrize(
    ("scale", "notes"),
    [
        ("0.0001", ()),
        ("0.00010000001", ()),
        ("0.0002", ("M.soc: scale 0.0002, the master's is 0.0001",)),
        ("0", ("M.soc: scale 0, the master's is 0.0001",)),
        ("x", ("M.soc: scale nan, the master's is 0.0001",)),
    ],
)
def test_another_scale_is_told_and_the_bytes_are_taken(scale, notes):
    imported = one(signal("soc", 0, 16, scale=scale))
    assert imported.notes == notes
    assert imported.tx[0].data_offsets[:2] == (2982, 2983)


def test_a_message_longer_than_a_can_frame_is_cut_and_told():
    imported = one(signal("n_slaves", 56, 8), signal("soc", 64, 16), length=64)
    assert imported.tx[0].length == 8
    assert imported.tx[0].data_offsets[7] == 440
    assert imported.notes == (
        "M: 64 bytes; only the first 8 fit a CAN frame",
        "M.soc: ends beyond the message; its bytes stay unused",
    )


def attributes(**values):
    return "".join(f'BA_ "{name}" BO_ 1 {value};\n' for name, value in values.items())


@pytest.mark.parametrize(
    ("values", "enabled", "period_ms", "index", "notes"),
    [
        ({}, False, 0, 0, ()),
        ({"GenMsgCycleTime": 50}, True, 50, 0, ()),
        ({"GenMsgCycleTime": 60000, "VoltwallEnabled": 0}, False, 60000, 0, ()),
        ({"VoltwallEnabled": 1, "VoltwallIndex": 7}, True, 0, 7, ()),
        ({"VoltwallIndex": 8}, False, 0, 0, ()),
        ({"GenMsgCycleTime": 60001}, False, 0, 0, ("M: GenMsgCycleTime = 60001, allowed: 0..60000; 0 taken",)),
        ({"GenMsgCycleTime": -1}, False, 0, 0, ("M: GenMsgCycleTime = -1, allowed: 0..60000; 0 taken",)),
    ],
)
def test_attributes_of_a_sent_message(values, enabled, period_ms, index, notes):
    imported = from_dbc("BO_ 1 M: 1 MASTER\n" + attributes(**values))
    [tx] = imported.tx
    assert (tx.enabled, tx.period_ms, tx.index, imported.notes) == (enabled, period_ms, index, notes)


@pytest.mark.parametrize(
    ("values", "enabled", "timeout_ms", "index", "response", "notes"),
    [
        ({}, True, 0, 0, None, ()),
        ({"VoltwallTimeout": 60000, "VoltwallAnswer": 0, "VoltwallIndex": 3}, True, 60000, 3, 0, ()),
        ({"VoltwallEnabled": 0, "VoltwallAnswer": 7}, False, 0, 0, 7, ()),
        ({"VoltwallAnswer": 8}, True, 0, 0, None, ()),
        ({"GenMsgCycleTime": 100}, True, 500, 0, None, ()),
        ({"GenMsgCycleTime": 20000}, True, 60000, 0, None, ()),
        ({"GenMsgCycleTime": -5}, True, 0, 0, None, ()),
        ({"GenMsgCycleTime": 100, "VoltwallTimeout": 0}, True, 0, 0, None, ()),
        ({"VoltwallTimeout": 60001, "GenMsgCycleTime": 100}, True, 0, 0, None,
         ("M: VoltwallTimeout = 60001, allowed: 0..60000; 0 taken",)),
    ],
)  # fmt: skip
def test_attributes_of_a_received_message(values, enabled, timeout_ms, index, response, notes):
    imported = from_dbc("BO_ 1 M: 1 ECU\n" + attributes(**values))
    [rx] = imported.rx
    assert (rx.enabled, rx.timeout_ms, rx.index, rx.response) == (enabled, timeout_ms, index, response)
    assert imported.notes == notes


def test_an_attribute_of_no_message_is_ignored():
    assert from_dbc('BA_ "GenMsgCycleTime" BO_ 1 50;\nBO_ 1 M: 1 MASTER\n').tx[0].period_ms == 0


def test_ids_at_their_limits_have_a_place():
    text = "".join(f"BO_ {i} M: 1 MASTER\n" for i in (0, 0x7FF, 0x80000000, 0x9FFFFFFF))
    assert [(m.can_id, m.is_extended) for m in from_dbc(text).tx] == [
        (0, False), (0x7FF, False), (0, True), (0x1FFFFFFF, True)
    ]  # fmt: skip


def test_what_has_no_place_is_told_and_takes_none():
    text = "BO_ 2048 Wide: 1 MASTER\nBO_ 2684354560 Wider: 1 MASTER\nBO_ 2 Empty: 0 MASTER\n"
    imported = from_dbc(summary(1) + text + "BO_ 2 Twin: 1 MASTER\n")
    assert [m.can_id for m in imported.tx] == [1]
    assert imported.notes == (
        "Twin: Empty has its id already; left out",
        "Wide: id 0x800 is none of 11 bits; left out",
        "Wider: id 0x20000000 is none of 29 bits; left out",
        "Empty: it has no bytes; left out",
    )


def test_places_named_by_the_file_are_kept_and_the_others_fill_the_rest():
    text = "".join(f"BO_ {i} M{i}: 1 MASTER\n" for i in range(1, 6))
    text += 'BA_ "VoltwallIndex" BO_ 2 0;\nBA_ "VoltwallIndex" BO_ 3 5;\nBA_ "VoltwallIndex" BO_ 4 5;\n'
    assert [(m.index, m.can_id) for m in from_dbc(text).tx] == [(0, 2), (1, 1), (2, 4), (3, 5), (5, 3)]


@pytest.mark.parametrize(("sender", "table", "words"), [("ECU", "rx", "received"), ("MASTER", "tx", "sent")])
def test_a_ninth_message_is_noted(sender, table, words):
    imported = from_dbc("\n".join(f"BO_ {i} M{i}: 2 {sender}" for i in range(1, 11)))
    assert [m.can_id for m in getattr(imported, table)] == list(range(1, 9))
    assert imported.notes == tuple(f"id {i:#x}: all 8 messages {words} are taken; left out" for i in (9, 10))


def test_the_tables_keep_what_the_file_does_not_name():
    default = default_image()
    image, notes = into_tables(default, from_dbc(summary(0x300) + summary(0x101, "Own", length=3)))
    assert notes == ()
    tx = tx_messages(image)
    assert tx[:2] == tx_messages(default)[:2]
    assert (tx[2].can_id, tx[2].length, tx[2].data_offsets) == (0x101, 3, (2982, 2983, *UNUSED[:6])), "in its place"
    assert (tx[3].can_id, tx[3].length) == (0x300, 2), "in the first free place"
    assert rx_messages(image) == rx_messages(default)


def test_a_free_place_that_the_file_names_is_taken():
    text = summary(0x300) + summary(0x301, "N") + 'BA_ "VoltwallIndex" BO_ 768 6;\n'
    image, _ = into_tables(default_image(), from_dbc(text))
    assert [m.can_id for m in tx_messages(image)] == [0x1806E5F4, 0x100, 0x101, 0x301, 0, 0, 0x300, 0]


def test_messages_beyond_the_free_places_are_told():
    text = "".join(summary(0x300 + i, f"M{i}") for i in range(7))
    image, notes = into_tables(default_image(), from_dbc(text))
    assert [m.can_id for m in tx_messages(image)][3:] == [0x300, 0x301, 0x302, 0x303, 0x304]
    assert notes == tuple(f"id {i:#x}: all 8 messages sent are taken; left out" for i in (0x305, 0x306))
    text = "".join(summary(0x300 + i, f"M{i}", "ECU") for i in range(8))
    _, notes = into_tables(default_image(), from_dbc(text))
    assert notes == ("id 0x307: all 8 messages received are taken; left out",)


def test_every_value_has_a_name_and_only_one():
    names = [element_name(field, element) for field in FIELDS.values() for element in range(field.count)]
    assert len(names) == len(set(names))
    assert named_element("slave[3].cvr[5]")[0].name == "slave[3].cvr"
    assert named_element("v[36]")[1] == 36
    with pytest.raises(EncodeError):
        named_element("v[96]")
