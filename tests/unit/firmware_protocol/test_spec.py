"""SPEC.md says what the code does: its tables are generated, its numbers and hex are compared."""

import re

import pytest

from firmware_protocol import eeprom, framing, messages, schedule, spec_tables
from firmware_protocol.framing import Frame, FrameDecoder
from firmware_protocol.memory_map import CONFIG_FIELDS, STATUS_FLAGS
from firmware_protocol.messages import CommandId, EventCode, MessageType, Result
from tests.host_requests import decode_request

TEXT = spec_tables.SPEC.read_text(encoding="utf-8")
SECTIONS = dict(re.findall(r"^## (\d+)\. .*?\n(.*?)(?=^## |\Z)", TEXT, re.DOTALL | re.MULTILINE))


def rows(section):
    return [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in SECTIONS[section].splitlines()
        if line.startswith("| ") and not line.startswith("| ---")
    ]


FLAG_ROWS = [row for row in rows("11") if row[1] in STATUS_FLAGS and len(row) == 4]


def test_tables_are_current():
    assert spec_tables.main(["--check"]) == 0, "run: python -m firmware_protocol.spec_tables"


@pytest.mark.parametrize(
    ("members", "section"),
    [(Result, "5"), (EventCode, "5"), (CommandId, "6"), (MessageType, "5"), (MessageType, "6")],
)
def test_every_code_is_described(members, section):
    described = {(row[0], row[1]) for row in rows(section)}
    for member in members:
        if members is MessageType and (member < MessageType.IDENT) != (section == "5"):
            continue
        number = f"0x{member:02x}" if members is MessageType else str(int(member))
        assert (number, member.name) in described


def examples():
    found = [row for row in rows("12") if row[0] != "what"]
    assert len(found) >= 40
    return found


@pytest.mark.parametrize("row", examples(), ids=lambda row: f"{row[1]} {row[0]}")
def test_worked_example_is_what_the_codec_makes(row):
    _, kind, sequence, uptime_ms, body, wire = row
    raw = bytes.fromhex(wire.strip("`"))
    [frame] = FrameDecoder().feed(raw)
    assert (MessageType(frame.type).name, frame.sequence, frame.uptime_ms) == (kind, int(sequence), int(uptime_ms))
    assert (frame.body.hex(" ") or "-") == body.strip("`")
    assert framing.encode_frame(frame.type, frame.sequence, frame.uptime_ms, frame.body) == raw
    if frame.type < MessageType.IDENT:
        assert messages.decode_message(frame).to_body() == frame.body
    else:
        assert messages.encode_request(decode_request(frame)) == (frame.type, frame.body)


def test_payloads_taken_apart_are_those_of_the_examples():
    payloads = re.findall(r"payload `([0-9a-f ]+)`", SECTIONS["12"])
    assert len(payloads) == 2
    decoded = [framing.decode_chunk(framing.cobs_encode(bytes.fromhex(text))) for text in payloads]
    assert all(isinstance(frame, Frame) for frame in decoded)
    wires = {row[5].strip("`") for row in examples()}
    assert all(f"00 {frame.raw.hex(' ')} 00" in wires for frame in decoded)


def test_every_status_flag_is_explained_at_its_bit():
    explained = [(int(bit), name) for bit, name, one, zero in FLAG_ROWS if one and zero]
    assert explained == list(enumerate(STATUS_FLAGS))


def test_windows_of_the_stream():
    fast = [(int(row[0]), int(row[1])) for row in rows("8") if row[0].isdigit()]
    assert tuple(fast) == schedule.FAST_WINDOWS
    ranges = re.findall(r"(\d+)\.\.(\d+)", SECTIONS["8"].partition("in this order")[2].partition("Whenever")[0])
    assert tuple((int(a), int(b) - int(a) + 1) for a, b in ranges) == schedule.SLOW_RANGES


def test_numbers_in_the_text():
    assert f"at most {framing.MAX_ENCODED + 2} bytes" in SECTIONS["3"]
    assert f"0x{framing.crc16(b'123456789'):04X}" in SECTIONS["3"]
    assert f"chunk of at most {framing.MAX_ENCODED} bytes" in SECTIONS["4"]
    assert f"length u16 (1..{messages.MAX_READ})" in SECTIONS["6"]
    assert f"within {messages.TIMEOUT_S} s (STORE and LOAD {messages.STORE_TIMEOUT_S:.0f} s)" in SECTIONS["6"]
    assert f"again within {messages.REPEAT_WINDOW_S:.0f} s" in SECTIONS["6"]
    assert f"{schedule.frame_bytes(358)} bytes at most on the line" in SECTIONS["8"]
    assert f"If {schedule.FAST_PER_SLOW} fast frames" in SECTIONS["8"]
    assert f"0x{eeprom.crc32(b'123456789'):08X}" in SECTIONS["9"]
    assert f"each of {eeprom.JOURNAL_PAGES} pages" in SECTIONS["9"]


def test_live_fields_are_named():
    named = re.findall(r"`(\w+)`", SECTIONS["6"].partition("live ones:")[2].partition(".")[0])
    assert named == [field.name for field in CONFIG_FIELDS if field.is_live]
