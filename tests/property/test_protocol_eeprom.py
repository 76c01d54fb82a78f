"""A power cut at any byte of a store leaves the old or the new configuration."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_protocol import config_image, eeprom
from tests.campaign import examples

OLD = config_image.default_image()
NEW = config_image.with_value(config_image.with_value(OLD, "telemetry_period", 50), "can_rx_msg_id", list(range(8)))
BLANK = b"\xff" * (2 * eeprom.SLOT_SIZE)


def apply(memory, writes):
    out = bytearray(memory)
    for write in writes:
        out[write.offset : write.offset + len(write.data)] = write.data
    return bytes(out)


def histories():
    memory = BLANK
    yield memory
    for image in (OLD, OLD, NEW):
        memory = apply(memory, eeprom.plan_store(memory, image))
        yield memory


@pytest.mark.parametrize("memory", [*histories()], ids=["blank", "one slot", "both the same", "both"])
def test_cut_after_any_byte_leaves_old_or_new(memory):
    before = eeprom.newest(memory)
    allowed = {None if before is None else before.image, NEW}
    writes = eeprom.plan_store(memory, NEW)
    for done, write in enumerate(writes):
        start = apply(memory, writes[:done])
        for cut in range(len(write.data) + 1):
            torn = apply(start, [eeprom.PageWrite(write.offset, write.data[:cut])])
            found = eeprom.newest(torn)
            assert (None if found is None else found.image) in allowed
            assert before is None or found is not None
    assert eeprom.newest(apply(memory, writes)).image == NEW


@pytest.mark.parametrize("memory", [*histories()], ids=["blank", "one slot", "both the same", "both"])
def test_store_after_a_cut_store_succeeds(memory):
    writes = eeprom.plan_store(memory, NEW)
    for done, write in enumerate(writes):
        torn = apply(apply(memory, writes[:done]), [eeprom.PageWrite(write.offset, write.data[:7])])
        assert eeprom.newest(apply(torn, eeprom.plan_store(torn, NEW))).image == NEW


@settings(max_examples=examples(200))
@given(st.data())
def test_page_torn_into_any_mixture_leaves_old_or_new(data):
    memory = apply(BLANK, eeprom.plan_store(BLANK, OLD))
    writes = eeprom.plan_store(memory, NEW)
    done = data.draw(st.integers(0, len(writes) - 1))
    write = writes[done]
    start = apply(memory, writes[:done])
    was = start[write.offset : write.offset + len(write.data)]
    arrived = data.draw(st.lists(st.booleans(), min_size=len(was), max_size=len(was)))
    noise = data.draw(st.binary(min_size=len(was), max_size=len(was)))
    kinds = data.draw(st.lists(st.integers(0, 9), min_size=len(was), max_size=len(was)))
    page = bytes(noise[i] if kinds[i] == 0 else (write.data[i] if arrived[i] else was[i]) for i in range(len(was)))
    found = eeprom.newest(apply(start, [eeprom.PageWrite(write.offset, page)]))
    assert found.image in (OLD, NEW)


@given(st.binary(max_size=4 * eeprom.PAGE_SIZE), st.integers(0, 2 * eeprom.SLOT_SIZE - 1))
def test_any_bytes_in_memory_are_survived(noise, at):
    memory = bytearray(apply(BLANK, eeprom.plan_store(BLANK, OLD)))
    noise = noise[: len(memory) - at]
    memory[at : at + len(noise)] = noise
    found = eeprom.newest(memory)
    assert found is None or found.image == OLD
