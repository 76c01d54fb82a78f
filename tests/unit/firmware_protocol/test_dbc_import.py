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


def test_a_ninth_message_is_told():
    text = "\n".join(f'BO_ {i} M{i}: 2 MASTER\n SG_ soc : 0|16@1+ (0.0001,0) [0|1] "" X' for i in range(1, 10))
    imported = from_dbc(text)
    assert len(imported.tx) == 8
    assert imported.notes == ("id 0x9: all 8 messages sent are taken; left out",)


def summary(dbc_id, name="M", sender="MASTER", length=2):
    return f'BO_ {dbc_id} {name}: {length} {sender}\n SG_ soc : 0|16@1+ (0.0001,0) [0|1] "" X\n'


def test_what_has_no_place_is_told_and_takes_none():
    text = summary(1) + summary(0x900, "Wide") + summary(0xE0000000, "Wider") + "BO_ 2 Empty: 0 MASTER\n"
    imported = from_dbc(text + summary(1, "Twin"))
    assert [m.can_id for m in imported.tx] == [1]
    assert imported.tx[0].data_offsets[:2] == (2982, 2983), "the twin's signals are not the first one's"
    told = "; ".join(imported.notes)
    for words in ("Wide: id 0x900", "Wider: id 0x60000000", "Empty: it has no bytes", "Twin: M has its id already"):
        assert words in told
    assert from_dbc("BO_ 2 Empty: 0 MASTER").tx == ()


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
    assert any("id 0x100: now both sent and received" in note for note in notes)
    assert check(image) == []


@pytest.mark.parametrize("text", ["", 'VERSION ""', "BO_ x", "BO_ 3221225472 VECTOR__INDEPENDENT_SIG_MSG: 0 X"])
def test_a_file_without_a_message_is_an_error(text):
    with pytest.raises(DecodeError):
        from_dbc(text)


def test_every_value_has_a_name_and_only_one():
    names = [element_name(field, element) for field in FIELDS.values() for element in range(field.count)]
    assert len(names) == len(set(names))
    assert named_element("slave[3].cvr[5]")[0].name == "slave[3].cvr"
    assert named_element("v[36]")[1] == 36
    with pytest.raises(EncodeError):
        named_element("v[96]")
