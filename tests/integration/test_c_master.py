"""The C reference as a master: what it answers, what a power cut leaves, and the real service on it."""

import os
import signal
import socket
import subprocess
import time
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import pytest

from firmware_protocol.config_image import default_image, with_value
from firmware_protocol.eeprom import StoredConfig, encode_slot, newest, plan_store
from firmware_protocol.framing import Frame, FrameDecoder, encode_frame
from firmware_protocol.memory_map import CONFIG_SIZE
from firmware_protocol.messages import (
    NO_OFFSET,
    Command,
    CommandId,
    Data,
    EventCode,
    EventMessage,
    Ident,
    IdentRequest,
    Load,
    Read,
    Reply,
    Request,
    Result,
    Store,
    Write,
    decode_message,
    encode_request,
)
from tests.c_programs import build_program

OLD = with_value(default_image(), "v_cell_chrg", 4.1)
NEW = with_value(with_value(default_image(), "v_cell_chrg", 4.12), "telemetry_period", 50)
POWER_LOST = 9


class Raw(NamedTuple):
    """A request as no well-behaved host would send it."""

    kind: int
    body_hex: str


class Line:
    """The C master at the other end of a socket."""

    def __init__(self, program: Path, *arguments: str) -> None:
        ours, theirs = socket.socketpair()
        fd = theirs.fileno()
        self.process = subprocess.Popen(
            [program, "--fd", str(fd), *arguments], pass_fds=[fd], stdout=subprocess.DEVNULL
        )
        theirs.close()
        ours.settimeout(10)
        self._socket = ours
        self._decoder = FrameDecoder()
        self._sequence = 0
        self._seen: list[Frame] = []
        self.events: list[EventMessage] = []

    def send(self, data: bytes) -> None:
        self._socket.sendall(data)

    def frame(self) -> Frame | None:
        """The next frame, None when the master is gone."""
        while not self._seen:
            try:
                data = self._socket.recv(4096)
            except ConnectionResetError:
                data = b""
            if not data:
                return None
            self._seen += self._decoder.feed(data)
        frame = self._seen.pop(0)
        assert isinstance(frame, Frame)
        return frame

    def message(self) -> Data | Reply | EventMessage | None:
        frame = self.frame()
        return None if frame is None else decode_message(frame)

    def reply(self) -> Reply | None:
        while not isinstance(message := self.message(), Reply | None):
            if isinstance(message, EventMessage):
                self.events.append(message)
        return message

    def ask(self, request: Request | Raw) -> Reply | None:
        """The reply; None when the master is gone."""
        if isinstance(request, Raw):
            kind, body = request.kind, bytes.fromhex(request.body_hex)
        else:
            kind, body = encode_request(request)
        self._sequence = (self._sequence + 1) & 0xFF
        self.send(encode_frame(kind, self._sequence, 0, body))
        return self.reply()

    def config(self) -> bytes:
        return self.ask(Read(0, CONFIG_SIZE)).data

    def close(self) -> int:
        self._socket.close()
        return self.process.wait(10)


@pytest.fixture
def line(c_master_program):
    opened = []

    def open_one(*arguments, program=c_master_program):
        opened.append(Line(program, "--page-ms", "0", *arguments))
        return opened[-1]

    yield open_one
    for one in opened:
        one.close()


def result_of(reply):
    return Result(reply.result), reply.offset


def test_it_says_who_it_is_and_has_its_defaults(line):
    master = line()
    ident = Ident.from_bytes(master.ask(IdentRequest()).data)
    assert (ident.protocol, ident.map_hash, ident.boots) == (1, Ident((1, 0, 0)).map_hash, 1)
    assert master.config() == default_image()
    assert [event.code for event in master.events] == [EventCode.BOOT, EventCode.EEPROM_INVALID]


@pytest.mark.parametrize(
    ("request_", "expected"),
    [
        (Write(4, (50_000).to_bytes(2, "little")), (Result.OUT_OF_RANGE, 4)),
        (Write(2, (43_000).to_bytes(2, "little")), (Result.OUT_OF_RANGE, 2)),
        (Raw(0x12, "a30102006162"), (Result.OUT_OF_BOUNDS, 419)),
        (Raw(0x12, "00000000"), (Result.BAD_LENGTH, NO_OFFSET)),
        (Raw(0x13, "00"), (Result.BAD_LENGTH, NO_OFFSET)),
        (Raw(0x7F, ""), (Result.UNKNOWN_REQUEST, NO_OFFSET)),
        (Read(2983, 2), (Result.OUT_OF_BOUNDS, 2983)),
        (Read(0x8000 + 32_767, 2), (Result.OUT_OF_BOUNDS, 0x8000 + 32_767)),
        (Raw(0x11, "0000fc01"), (Result.BAD_LENGTH, NO_OFFSET)),
        (Load(), (Result.NOTHING_STORED, NO_OFFSET)),
        (Command(CommandId.SET_SOC, 10_001), (Result.OUT_OF_RANGE, NO_OFFSET)),
        (Command(CommandId.FAN_OVERRIDE, -2), (Result.OUT_OF_RANGE, NO_OFFSET)),
        (Command(99, 0), (Result.UNKNOWN_REQUEST, NO_OFFSET)),
    ],
    ids=lambda value: "" if type(value) is tuple else repr(value),
)
def test_a_refusal_has_a_code_and_an_offset_and_changes_nothing(line, request_, expected):
    master = line()
    before = master.config()
    assert result_of(master.ask(request_)) == expected
    assert master.config() == before


def test_while_driving_only_live_fields_are_taken(line):
    master = line("--driving")
    live = with_value(default_image(), "fan_ramp_max", 1.0)
    assert result_of(master.ask(Write(0, with_value(live, "t_cell_max", 50)))) == (Result.NOT_NOW, NO_OFFSET)
    assert master.config() == default_image()
    assert result_of(master.ask(Write(0, live))) == (Result.DONE, NO_OFFSET)
    assert master.config() == live
    assert result_of(master.ask(Store())) == (Result.NOT_NOW, NO_OFFSET)
    assert result_of(master.ask(Load())) == (Result.NOT_NOW, NO_OFFSET)


def test_while_charging_too(line):
    master = line()
    assert result_of(master.ask(Command(CommandId.CHARGE_START, 0))) == (Result.DONE, NO_OFFSET)
    assert result_of(master.ask(Write(0, NEW))) == (Result.NOT_NOW, NO_OFFSET)
    assert result_of(master.ask(Load())) == (Result.NOT_NOW, NO_OFFSET)
    assert master.config() == default_image()
    master.ask(Command(CommandId.CHARGE_STOP, 0))
    assert result_of(master.ask(Write(0, NEW))) == (Result.DONE, NO_OFFSET)


def test_a_write_is_in_force_at_once_and_forgotten_at_a_reset(line):
    master = line()
    assert result_of(master.ask(Write(0, NEW))) == (Result.DONE, NO_OFFSET)
    assert master.config() == NEW
    assert EventMessage(EventCode.CONFIG_WRITTEN, 0, NO_OFFSET, 0, CONFIG_SIZE) in master.events
    assert result_of(master.ask(Command(CommandId.RESET, 0))) == (Result.DONE, NO_OFFSET)
    assert master.message() == EventMessage(EventCode.BOOT, 0, NO_OFFSET, 3, 0)
    assert master.config() == default_image()
    ident = Ident.from_bytes(master.ask(IdentRequest()).data)
    assert (ident.reset_cause, ident.boots) == (3, 2)


def test_what_was_stored_is_there_after_the_power_was_off(line, tmp_path):
    eeprom = ("--eeprom", str(tmp_path / "eeprom.bin"))
    first = line(*eeprom)
    for image in (OLD, NEW):
        assert result_of(first.ask(Write(0, image))) == (Result.DONE, NO_OFFSET)
        assert result_of(first.ask(Store())) == (Result.DONE, NO_OFFSET)
    first.close()
    stored = newest((tmp_path / "eeprom.bin").read_bytes())
    assert (stored.image, stored.counter, stored.slot) == (NEW, 2, 1)
    again = line(*eeprom)
    assert again.config() == NEW
    assert again.ask(Read(0x8000, 4)).data == b"VWCF"
    assert [event.code for event in again.events] == [EventCode.BOOT]


BLANK = b"\xff" * 32_768


@pytest.mark.parametrize(
    ("slots", "at_start", "slot", "counter"),
    [
        (b"", default_image(), 0, 1),
        (bytes(1024), default_image(), 0, 1),
        (BLANK[:512] + encode_slot(OLD, 5), OLD, 0, 6),
        (encode_slot(OLD, 8) + encode_slot(default_image(), 8), OLD, 1, 9),
    ],
    ids=["never written", "zeros", "only slot 1", "the same counter in both"],
)
def test_a_store_goes_into_the_slot_that_the_specification_names(line, tmp_path, slots, at_start, slot, counter):
    path = tmp_path / "eeprom.bin"
    path.write_bytes(slots + BLANK[len(slots) :])
    before = path.read_bytes()
    master = line("--eeprom", str(path))
    assert master.config() == at_start
    assert result_of(master.ask(Write(0, NEW))) == (Result.DONE, NO_OFFSET)
    assert result_of(master.ask(Store())) == (Result.DONE, NO_OFFSET)
    master.close()
    after = path.read_bytes()
    assert newest(after) == StoredConfig(NEW, counter, slot)
    other = slice(512 * (1 - slot), 512 * (2 - slot))
    assert after[other] == before[other]


def test_load_brings_back_what_is_stored(line):
    master = line()
    master.ask(Write(0, OLD))
    master.ask(Store())
    master.ask(Write(0, NEW))
    assert result_of(master.ask(Load())) == (Result.DONE, NO_OFFSET)
    assert master.config() == OLD


def test_a_stored_image_that_breaks_a_limit_is_not_loaded(line, tmp_path):
    bad = bytearray(OLD)
    bad[4:6] = (50_000).to_bytes(2, "little")
    content = bytearray(b"\xff" * 32_768)
    for image in (OLD, bytes(bad)):
        for page in plan_store(bytes(content), image):
            content[page.offset : page.offset + len(page.data)] = page.data
    (tmp_path / "eeprom.bin").write_bytes(content)
    master = line("--eeprom", str(tmp_path / "eeprom.bin"))
    assert master.config() == OLD
    assert result_of(master.ask(Load())) == (Result.OUT_OF_RANGE, 4)
    assert master.config() == OLD


@pytest.mark.parametrize("fault", ["--worn", "--no-eeprom"])
def test_an_eeprom_that_does_not_keep_it_is_said(line, fault):
    master = line(fault)
    master.ask(Write(0, NEW))
    assert result_of(master.ask(Store())) == (Result.EEPROM_FAILED, NO_OFFSET)
    assert master.config() == NEW


def test_a_repeated_request_is_answered_and_not_done_twice(line):
    master = line()
    kind, body = encode_request(Command(CommandId.SET_SOC, 5000))
    for _ in range(3):
        master.send(encode_frame(kind, 77, 0, body))
        assert result_of(master.reply()) == (Result.DONE, NO_OFFSET)
    master.ask(IdentRequest())
    assert [event.value for event in master.events if event.code == EventCode.SOC_SET] == [5000]
    master.send(encode_frame(kind, 78, 0, body))
    assert master.reply().request_sequence == 78
    master.ask(IdentRequest())
    assert [event.value for event in master.events if event.code == EventCode.SOC_SET] == [5000, 5000]


def test_a_repeated_store_gets_one_reply_when_it_is_done(line):
    master = line("--page-ms", "5")
    kind, body = encode_request(Store())
    for _ in range(3):
        master.send(encode_frame(kind, 9, 0, body))
    master.ask(IdentRequest())
    seen = [master.reply()]
    master.send(encode_frame(kind, 9, 0, body))
    seen.append(master.reply())
    assert [(reply.request_sequence, reply.result) for reply in seen] == [(9, Result.DONE)] * 2
    master.ask(IdentRequest())
    assert [event.value for event in master.events if event.code == EventCode.CONFIG_STORED] == [1]


def test_a_computer_that_is_busy_elsewhere_makes_no_pass_of_the_master_longer(line):
    """So that what it measures and tells by its own clock does not hang on the computer's load."""
    master = line()
    master.send(b"x")
    uptimes = [master.frame().uptime_ms]
    os.kill(master.process.pid, signal.SIGSTOP)
    time.sleep(0.7)  # as long as the rest of the computer takes it away
    os.kill(master.process.pid, signal.SIGCONT)
    while uptimes[-1] - uptimes[0] < 1500:
        uptimes.append(master.frame().uptime_ms)
    assert max(b - a for a, b in pairwise(uptimes)) <= 110  # the telemetry's period and a pass of the loop


def test_the_stream_brings_the_whole_struct(line):
    master = line()
    master.send(b"x")
    covered, uptimes, sequences = set(), [], []
    while len(covered) < 2984:
        frame = master.frame()
        sequences.append(frame.sequence)
        uptimes.append(frame.uptime_ms)
        message = decode_message(frame)
        if isinstance(message, Data):
            for window in message.windows:
                covered |= set(range(window.offset, window.offset + len(window.data)))
    assert uptimes == sorted(uptimes)
    assert all((b - a) % 256 == 1 for a, b in pairwise(sequences))
    master.send(b"y")
    master.ask(IdentRequest())
    master.send(encode_frame(0x10, 200, 0, b""))
    assert isinstance(master.message(), Reply)


@pytest.fixture(scope="module")
def quick_program():
    """Without sanitizers: it starts in a millisecond."""
    return build_program("host", sanitized=False)


def test_a_power_cut_at_any_byte_of_a_store_leaves_the_old_or_the_new(quick_program, tmp_path):
    content = bytearray(b"\xff" * 32_768)
    for image in (OLD, OLD):
        for page in plan_store(bytes(content), image):
            content[page.offset : page.offset + len(page.data)] = page.data
    n_bytes = sum(len(page.data) for page in plan_store(bytes(content), NEW))
    path = tmp_path / "eeprom.bin"
    found = []
    for cut in range(n_bytes):
        path.write_bytes(content)
        master = Line(
            quick_program, "--eeprom", str(path), "--page-ms", "0", "--cut-after", str(cut), "--cut-byte", "90"
        )
        assert master.ask(Write(0, NEW)).result == Result.DONE
        assert master.ask(Store()) is None
        assert master.close() == POWER_LOST
        after = Line(quick_program, "--eeprom", str(path), "--page-ms", "0")
        in_force = after.config()
        assert in_force in (OLD, NEW), f"cut after byte {cut}"
        assert EventCode.EEPROM_INVALID not in [event.code for event in after.events]
        after.close()
        found.append(in_force == NEW)
    assert found == sorted(found)
    assert set(found) == {False, True}
