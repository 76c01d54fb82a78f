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
