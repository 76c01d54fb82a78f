import binascii

import pytest

from firmware_protocol import config_image, eeprom
from firmware_protocol.errors import DecodeError, EncodeError
from firmware_protocol.memory_map import CONFIG

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


SAME = eeprom.encode_slot(FIRST, 8) + eeprom.encode_slot(SECOND, 8) + BLANK[2 * eeprom.SLOT_SIZE :]


@pytest.mark.parametrize(
    ("memory", "slot", "counter"),
    [
        (BLANK, 0, 1),
        (bytes(eeprom.EEPROM_SIZE), 0, 1),
        (BLANK[: eeprom.SLOT_SIZE] + eeprom.encode_slot(FIRST, 5) + BLANK[2 * eeprom.SLOT_SIZE :], 0, 6),
        (SAME, 1, 9),
    ],
    ids=["never written", "zeros", "only slot 1", "the same counter in both"],
)
def test_a_store_goes_into_the_slot_that_the_specification_names(memory, slot, counter):
    after = apply(memory, eeprom.plan_store(memory, THIRD))
    assert eeprom.newest(after) == eeprom.StoredConfig(THIRD, counter, slot)
    start = (1 - slot) * eeprom.SLOT_SIZE
    assert after[start : start + eeprom.SLOT_SIZE] == memory[start : start + eeprom.SLOT_SIZE]


def test_of_two_slots_with_the_same_counter_slot_0_counts():
    assert eeprom.newest(SAME) == eeprom.StoredConfig(FIRST, 8, 0)


def test_the_slot_before_stays_as_a_fallback():
    assert [s.image for s in eeprom.valid_slots(stored(FIRST, SECOND, THIRD))] == [THIRD, SECOND]


def test_slot_layout_is_the_written_one():
    slot = eeprom.encode_slot(FIRST, 0x01020304)
    assert slot[:12] == b"VWCF" + bytes([0xA4, 0x01, 2, 0, 4, 3, 2, 1])
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
    writes = eeprom.plan_store(memory, config_image.with_value(FIRST, "telemetry_period", 50))
    field = CONFIG["telemetry_period"]
    assert [write.offset for write in writes] == [0, 64 + field.offset // 64 * 64, 0], "the image begins on page 1"


def test_padding_is_stored_as_zero():
    noisy = FIRST[:225] + b"a" + FIRST[226:]
    assert eeprom.newest(stored(noisy)).image == FIRST


@pytest.mark.parametrize("counter", [0, -1, 1 << 32])
def test_a_counter_outside_its_range_is_refused(counter):
    with pytest.raises(EncodeError) as refused:
        eeprom.encode_slot(FIRST, counter)
    assert (refused.value.field, refused.value.value, refused.value.limit) == ("counter", counter, "1..4294967295")


def test_the_highest_counter_is_stored_and_the_next_store_is_refused():
    memory = eeprom.encode_slot(FIRST, 0xFFFFFFFF) + bytes(eeprom.EEPROM_SIZE - 512)
    assert eeprom.newest(memory) == eeprom.StoredConfig(FIRST, 0xFFFFFFFF, 0)
    with pytest.raises(EncodeError):
        eeprom.plan_store(memory, SECOND)


def test_a_slot_with_the_counter_0_is_none_though_its_checksum_is_right():
    slot = bytearray(eeprom.encode_slot(FIRST, 1))
    slot[8:12] = bytes(4)
    slot[12:16] = binascii.crc32(bytes(slot[:12]) + FIRST).to_bytes(4, "little")
    assert eeprom.decode_slot(slot, 0) is None


@pytest.mark.parametrize("size", [0, 511, 513])
def test_a_slot_of_another_size_is_none(size):
    assert eeprom.decode_slot(eeprom.encode_slot(FIRST, 1).ljust(513, b"\0")[:size], 0) is None


def test_a_memory_too_short_for_both_slots_is_refused():
    with pytest.raises(DecodeError) as refused:
        eeprom.newest(bytes(1023))
    assert (refused.value.what, refused.value.reason) == ("EEPROM", "1023 bytes, at least 1024")
    with pytest.raises(DecodeError):
        eeprom.plan_store(BLANK, FIRST[:-1])


def test_a_store_wipes_the_header_first_and_writes_it_last():
    used = eeprom.encode_slot(FIRST, 1) + b"\x55" * (eeprom.EEPROM_SIZE - eeprom.SLOT_SIZE)
    writes = eeprom.plan_store(used, SECOND)
    assert writes[0] == eeprom.PageWrite(512, bytes(64))
    assert [write.offset for write in writes[1:-1]] == [512 + 64 * page for page in range(1, 8)]
    assert (writes[-1].offset, writes[-1].data[:12]) == (512, b"VWCF" + bytes([0xA4, 0x01, 2, 0, 2, 0, 0, 0]))
    assert {len(write.data) for write in writes} == {64}


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


def test_journal_entry_layout_is_the_written_one():
    write = eeprom.journal_write(eeprom.JournalEntry(0x01020303, 0, 0), 0x0A0B0C0D, 0x0102)
    body = bytes.fromhex("04030201 0d0c0b0a 0201 0200 00000000")
    assert write.data == body + binascii.crc32(body).to_bytes(4, "little")
    assert write.offset == 1024 + 0x01020303 % 496 * 64


def test_journal_values_at_their_limits_are_read_back():
    highest = eeprom.journal_write(eeprom.JournalEntry(0xFFFFFFFE, 0, 0), 0xFFFFFFFF, 0xFFFF)
    assert eeprom.newest_journal(apply(BLANK, [highest])) == eeprom.JournalEntry(0xFFFFFFFF, 0xFFFFFFFF, 0xFFFF)
    lowest = eeprom.journal_write(None, 0, 0)
    assert lowest.offset == 1024
    assert eeprom.newest_journal(apply(BLANK, [lowest])) == eeprom.JournalEntry(1, 0, 0)


def test_the_newest_journal_entry_is_found_wherever_it_stands():
    entries = [eeprom.journal_write(eeprom.JournalEntry(n, 0, 0), 100 * n, n) for n in (990, 496, 3)]
    assert eeprom.newest_journal(apply(BLANK, entries)) == eeprom.JournalEntry(991, 99_000, 990)
    assert eeprom.newest_journal(apply(BLANK, entries[::-1])) == eeprom.JournalEntry(991, 99_000, 990)


def test_a_journal_in_a_cut_read_is_understood_as_far_as_it_goes():
    writes = [eeprom.journal_write(eeprom.JournalEntry(n, 0, 0), 7, 7) for n in (0, 1)]
    memory = apply(BLANK, writes)
    assert eeprom.newest_journal(memory[: 1024 + 64 + 20]).counter == 2
    assert eeprom.newest_journal(memory[: 1024 + 64 + 19]).counter == 1
    assert eeprom.newest_journal(memory[:1024]) is None


@pytest.mark.parametrize("values", [(-1, 0), (1 << 32, 0), (0, -1), (0, 65536)])
def test_journal_value_that_does_not_fit_is_refused(values):
    with pytest.raises(EncodeError) as refused:
        eeprom.journal_write(None, *values)
    assert (refused.value.field, refused.value.value) == ("journal", (1, *values))
    assert refused.value.limit == "counter and dod below 2**32, soc below 2**16"
    with pytest.raises(EncodeError):
        eeprom.journal_write(eeprom.JournalEntry(0xFFFFFFFF, 0, 0), 0, 0)
