import binascii

import pytest

from firmware_protocol import config_image, eeprom
from firmware_protocol.errors import DecodeError, EncodeError

FIRST = config_image.default_image()
SECOND = config_image.with_value(FIRST, "v_cell_max", 4.15)
THIRD = config_image.with_value(FIRST, "can_tx_msg_id", [7] * 8)
BLANK = b"\xff" * eeprom.EEPROM_SIZE


def apply(memory, writes):
    out = bytearray(memory)
    for write in writes:
        out[write.offset : write.offset + len(write.data)] = write.data
    return bytes(out)


def stored(*images):
    memory = BLANK
    for image in images:
        memory = apply(memory, eeprom.plan_store(memory, image))
    return memory


@pytest.mark.parametrize("fill", [0x00, 0xFF, 0x56])
def test_memory_without_a_configuration_holds_none(fill):
    memory = bytes([fill]) * eeprom.EEPROM_SIZE
    assert eeprom.newest(memory) is None
    assert eeprom.newest_journal(memory) is None


def test_stores_alternate_between_the_slots_and_the_last_counts():
    found = [eeprom.newest(stored(*images)) for images in ([FIRST], [FIRST, SECOND], [FIRST, SECOND, THIRD])]
    assert [(f.image, f.counter, f.slot) for f in found] == [(FIRST, 1, 0), (SECOND, 2, 1), (THIRD, 3, 0)]


def test_the_slot_before_stays_as_a_fallback():
    assert [s.image for s in eeprom.valid_slots(stored(FIRST, SECOND, THIRD))] == [THIRD, SECOND]


def test_slot_layout_is_the_written_one():
    slot = eeprom.encode_slot(FIRST, 0x01020304)
    assert slot[:12] == b"VWCF" + bytes([0xA4, 0x01, 1, 0, 4, 3, 2, 1])
    assert slot[64 : 64 + 420] == FIRST
    assert slot[16:64] == bytes(48)
    assert len(slot) == 512


@pytest.mark.parametrize("position", [*range(16), *range(64, 64 + 420)])
def test_any_changed_byte_makes_the_older_slot_count(position):
    memory = bytearray(stored(FIRST, SECOND))
    memory[512 + position] ^= 0x10
    assert eeprom.newest(memory).image == FIRST


def test_slot_of_another_layout_is_not_understood():
    slot = bytearray(eeprom.encode_slot(FIRST, 1))
    slot[6] = eeprom.LAYOUT_VERSION + 1
    slot[12:16] = binascii.crc32(bytes(slot[:12]) + FIRST).to_bytes(4, "little")
    assert eeprom.decode_slot(slot, 0) is None


def test_page_writes_stay_inside_a_page_and_off_the_newest_slot():
    memory = stored(FIRST, SECOND)
    for write in eeprom.plan_store(memory, THIRD):
        assert write.offset // 64 == (write.offset + len(write.data) - 1) // 64
        assert write.offset < 512


def test_unchanged_pages_are_not_written_again():
    memory = stored(FIRST, SECOND)
    writes = eeprom.plan_store(memory, config_image.with_value(FIRST, "ts", 50))
    assert [write.offset for write in writes] == [0, 64, 0]


def test_padding_is_stored_as_zero():
    noisy = FIRST[:225] + b"abc" + FIRST[228:]
    assert eeprom.newest(stored(noisy)).image == FIRST


def test_wrong_sizes_and_counters_are_refused():
    with pytest.raises(DecodeError):
        eeprom.newest(bytes(1023))
    with pytest.raises(DecodeError):
        eeprom.plan_store(BLANK, FIRST[:-1])
    for counter in (0, 1 << 32):
        with pytest.raises(EncodeError):
            eeprom.encode_slot(FIRST, counter)
    assert eeprom.decode_slot(b"", 0) is None


def test_host_can_tell_the_slots_from_the_first_two_kilobytes():
    assert eeprom.newest(stored(FIRST)[: 2 * eeprom.SLOT_SIZE]).image == FIRST


def test_journal_gives_the_last_entry_and_goes_round_all_pages():
    memory, entry, offsets = bytearray(stored(FIRST)), None, []
    for n in range(eeprom.JOURNAL_PAGES + 3):
        write = eeprom.journal_write(entry, 1000 * n, 10_000 - n)
        memory[write.offset : write.offset + len(write.data)] = write.data
        offsets.append(write.offset)
        entry = eeprom.JournalEntry(n + 1, 1000 * n, 10_000 - n)
    assert eeprom.newest_journal(memory) == entry
    assert len(set(offsets)) == eeprom.JOURNAL_PAGES
    assert min(offsets) == 1024
    assert max(offsets) == eeprom.EEPROM_SIZE - 64
    assert eeprom.newest(memory).image == FIRST


def test_cut_journal_entry_leaves_the_one_before():
    write = eeprom.journal_write(None, 5000, 9000)
    memory = apply(BLANK, [write])
    last = eeprom.newest_journal(memory)
    following = eeprom.journal_write(last, 6000, 8999)
    for cut in range(len(following.data)):
        torn = apply(memory, [eeprom.PageWrite(following.offset, following.data[:cut])])
        assert eeprom.newest_journal(torn) == last


@pytest.mark.parametrize("values", [(-1, 0), (1 << 32, 0), (0, -1), (0, 65536)])
def test_journal_value_that_does_not_fit_is_refused(values):
    with pytest.raises(EncodeError):
        eeprom.journal_write(None, *values)
