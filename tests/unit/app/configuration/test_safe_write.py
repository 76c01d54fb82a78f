"""The safe write against a master in memory whose line is cut, or lies, at chosen requests."""

import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest

from app.clock import Clock
from app.configuration.rules import Context
from app.configuration.safe_write import (
    Busy,
    ConfigurationWriter,
    Draft,
    HashMismatch,
    ReasonRequired,
    Rejected,
    Unverified,
)
from app.errors import LinkError, LinkLost, MasterRefused, NotNow
from app.estimation.cell_model.cell_file import load_cell
from app.sessions.errors import RecordingFailed
from app.sources.master.client import MasterClient
from app.telemetry import Identity
from app.words import render
from firmware_protocol.can_tables import rx_messages, tx_messages
from firmware_protocol.config_image import default_image, difference, image_hash, with_raw
from firmware_protocol.eeprom import EEPROM_SIZE, newest, plan_store
from firmware_protocol.framing import Frame, FrameDecoder
from firmware_protocol.memory_map import FIELDS
from firmware_protocol.messages import (
    EEPROM_READ_BASE,
    IdentRequest,
    Load,
    MessageType,
    Read,
    Reply,
    Result,
    Store,
    Write,
)
from tests.fake_clock import FakeClock
from tests.fake_write_log import FakeWriteLog
from tests.host_requests import decode_request

SAME_MAP = Identity("1.0.0", 1, "00", is_compatible=True, boots=1)


class MemoryMaster:
    """Holds an image and an EEPROM; `lose` names requests (by count) whose reply or doing is lost."""

    def __init__(self) -> None:
        self.image = bytearray(2984)
        self.image[:420] = default_image()
        self.eeprom = bytearray(b"\xff" * EEPROM_SIZE)
        self.decoder = FrameDecoder()
        self.client = MasterClient(self.send, Clock())
        self.refuse: Result | None = None
        self.cut_writes = False  # never arrive
        self.deaf_after_write = False
        self.spoil_writes = False
        self.deaf = False
        self.requests: list[object] = []

    def send(self, data: bytes) -> None:
        if self.deaf:
            raise LinkLost("cut")
        for frame in self.decoder.feed(data):
            if isinstance(frame, Frame):
                reply = self.answer(frame)
                if reply is not None:
                    item = Frame(MessageType.REPLY, 0, 0, reply.to_body())
                    threading.Thread(target=self.client.on_frame, args=(item,)).start()

    def answer(self, frame: Frame) -> Reply | None:
        request = decode_request(frame)
        self.requests.append(request)
        data = b""
        if isinstance(request, Write):
            if self.refuse is not None:
                return Reply(frame.type, frame.sequence, self.refuse, 4)
            if self.cut_writes:
                self.deaf = True
                raise LinkLost("cut before")
            self.image[request.offset : request.offset + len(request.data)] = request.data
            if self.spoil_writes:
                self.image[9] ^= 1
            if self.deaf_after_write:
                self.deaf = True
                raise LinkLost("cut after")
        elif isinstance(request, Read):
            memory, base = (self.eeprom, EEPROM_READ_BASE) if request.offset >= EEPROM_READ_BASE else (self.image, 0)
            start = request.offset - base
            data = bytes(memory[start : start + request.length])
        elif isinstance(request, Store):
            for page in plan_store(self.eeprom, bytes(self.image[:420])):
                self.eeprom[page.offset : page.offset + len(page.data)] = page.data
        elif isinstance(request, Load):
            self.image[:420] = newest(self.eeprom).image
        else:
            assert isinstance(request, IdentRequest)
        return Reply(frame.type, frame.sequence, Result.DONE, data=data)


@pytest.fixture
def master():
    return MemoryMaster()


CELL = load_cell()


def configuration(master, identity=SAME_MAP, log=None):
    master.client.identity = identity
    return ConfigurationWriter(master.client, lambda: Context(CELL), log or FakeWriteLog(), FakeClock())


HOTTER = {"t_cell_max": 55}
HOT_IMAGE = with_raw(default_image(), "t_cell_max", 55)


def write(config, raw, expected="*", *, dry_run=False, reason=""):
    return config.write(Draft(raw=raw, reason=reason), expected, "anna", dry_run=dry_run)


def test_a_write_is_read_back_and_its_difference_told(master):
    written = write(configuration(master), HOTTER, image_hash(default_image()))
    assert written.written
    assert [(c.field, c.before, c.after) for c in written.changes] == [("t_cell_max", 45, 55)]
    assert bytes(master.image[:420]) == HOT_IMAGE


def test_a_dry_run_and_an_empty_change_write_nothing(master):
    config = configuration(master)
    assert not write(config, HOTTER, dry_run=True).written
    assert not write(config, {}).written
    assert not any(isinstance(request, Write) for request in master.requests)


def test_another_configuration_in_force_refuses_the_write(master):
    with pytest.raises(HashMismatch) as caught:
        write(configuration(master), HOTTER, "0" * 16)
    assert caught.value.in_force == default_image()
    assert bytes(master.image[:420]) == default_image()


def test_a_draft_starts_from_its_base_or_from_what_is_in_force(master):
    in_force = with_raw(default_image(), "fan_ramp_stop", 40)
    draft = Draft(values={"t_cell_max": 50}, raw={"can_brp": 15})
    assert draft.applied_to(in_force) == with_raw(with_raw(in_force, "can_brp", 15), "t_cell_max", 50)
    assert Draft(default_image()).applied_to(in_force) == default_image()
    sent, received = tx_messages(in_force)[1], rx_messages(in_force)[0]
    can = Draft(can_sent=[replace(sent, period_ms=70)], can_received=[replace(received, timeout_ms=900)])
    wanted = can.applied_to(in_force)
    assert [change.field for change in difference(in_force, wanted)] == ["can_tx_msg_timing", "can_rx_msg_timeout"]
    assert configuration(master).write(Draft(HOT_IMAGE), "*", "anna", dry_run=False).image == HOT_IMAGE


def test_values_outside_their_range_never_leave(master):
    with pytest.raises(Rejected) as caught:
        write(configuration(master), {"t_cell_max": 127})
    assert caught.value.findings[0].error.field == "t_cell_max"
    assert not any(isinstance(request, Write) for request in master.requests)


def test_a_warning_needs_a_reason_once(master):
    config, wider = configuration(master), {"i_disc_max": 21000}
    with pytest.raises(ReasonRequired) as caught:
        write(config, wider)
    assert [found.error.field for found in caught.value.findings] == ["i_disc_max"]
    assert bytes(master.image[:420]) == default_image()
    assert write(config, wider, reason="short pulses").written
    assert write(config, HOTTER).written, "what stands already is not asked for again"


@pytest.mark.parametrize(
    ("field", "raw", "doing"),
    [
        ("status.flags", 1 << 8, "contactors are closed"),
        ("status.flags", 1 << 6, "accumulator is charging"),
        ("i_fs", -500, "current of -5.0 A"),
    ],
)
def test_at_work_only_what_is_safe_to_change_live_is_written(master, field, raw, doing):
    FIELDS[field].pack_into(master.image, (raw,))
    config = configuration(master)
    with pytest.raises(Busy, match=doing) as caught:
        write(config, HOTTER)
    assert caught.value.fields == ["t_cell_max"]
    assert doing in render(write(config, HOTTER, dry_run=True).block_reason)
    assert bytes(master.image[:420]) == default_image()
    assert write(config, {"fan_ramp_stop": 40}).written
    with pytest.raises(Busy):
        write(config, HOTTER | {"telemetry_period": 200})


def test_a_conflict_knows_what_the_draft_started_from(master):
    config = configuration(master)
    base = config.show(default_image())
    write(config, HOTTER)
    with pytest.raises(HashMismatch) as caught:
        write(config, {"telemetry_period": 50}, base)
    assert caught.value.base == default_image()
    assert caught.value.in_force == HOT_IMAGE
    assert caught.value.wanted == with_raw(HOT_IMAGE, "telemetry_period", 50)


def test_any_number_of_pages_may_ask_what_is_stored_at_once(master, monkeypatch):
    config = configuration(master)
    config.store("anna")
    asked, gate = threading.Semaphore(0), threading.Event()
    answer = master.answer
    monkeypatch.setattr(master, "answer", lambda frame: gate.wait(30) and answer(frame))

    def ask() -> bytes:
        asked.release()
        return config.read_stored().image

    with ThreadPoolExecutor(12) as pages:
        found = [pages.submit(ask) for _ in range(12)]
        for _ in found:
            asked.acquire()
        gate.set()
        assert {each.result() for each in found} == {default_image()}


def test_loading_is_refused_at_work_and_without_anything_stored(master):
    config = configuration(master)
    with pytest.raises(NotNow, match="no valid configuration"):
        config.load("anna")
    config.store("anna")
    write(config, HOTTER)
    FIELDS["status.flags"].pack_into(master.image, (1 << 8,))
    with pytest.raises(Busy):
        config.load("anna")
    FIELDS["status.flags"].pack_into(master.image, (0,))
    assert config.load("anna") == default_image()
    assert config.read() == default_image()


def test_a_master_with_another_map_is_never_written(master):
    other = Identity("9.9.9", 1, "ff", is_compatible=False, boots=1)
    for identity in (other, None):
        with pytest.raises(NotNow):
            write(configuration(master, identity), HOTTER)
    assert bytes(master.image[:420]) == default_image()


def test_a_refusal_is_told_with_its_offset(master):
    master.refuse = Result.NOT_NOW
    with pytest.raises(MasterRefused) as caught:
        write(configuration(master), HOTTER)
    assert (caught.value.result, caught.value.offset) == ("NOT_NOW", 4)


@pytest.mark.parametrize("attribute", ["cut_writes", "deaf_after_write"])
def test_a_cut_line_says_that_it_does_not_know_and_a_retry_is_safe(master, attribute):
    setattr(master, attribute, True)
    config = configuration(master)
    with pytest.raises(Unverified) as caught:
        write(config, HOTTER)
    assert caught.value.outcome == "unknown"
    assert bytes(master.image[:420]) in (default_image(), HOT_IMAGE)
    setattr(master, attribute, False)
    master.deaf = False
    write(config, HOTTER)
    assert bytes(master.image[:420]) == HOT_IMAGE


def test_a_byte_that_reads_back_differently_is_found(master):
    master.spoil_writes = True
    with pytest.raises(Unverified) as caught:
        write(configuration(master), HOTTER)
    assert caught.value.outcome == "other"


def test_store_reads_the_eeprom_back(master):
    config = configuration(master)
    assert config.read_stored() is None
    stored = config.store("anna")
    assert stored.image == default_image()
    write(config, HOTTER)
    assert config.store("anna").counter == stored.counter + 1
    assert config.read_stored().image == HOT_IMAGE


def test_a_deaf_master_is_an_error_and_not_a_hang(master):
    master.deaf = True
    with pytest.raises(LinkError):
        configuration(master).read()


def test_a_write_is_told_with_who_what_and_both_images(master):
    log = FakeWriteLog()
    config = configuration(master, log=log)
    write(config, HOTTER, reason="a hot day")
    ((kind, attempt, changes),) = log.told
    assert (kind, attempt.who, attempt.action, attempt.source, attempt.reason) == (
        "written",
        "anna",
        "write",
        "draft",
        "a hot day",
    )
    assert (attempt.before, attempt.after) == (default_image(), HOT_IMAGE)
    assert [change.field for change in changes] == ["t_cell_max"]


def test_dry_runs_and_drafts_that_break_limits_are_not_told(master):
    log = FakeWriteLog()
    config = configuration(master, log=log)
    write(config, HOTTER, dry_run=True)
    with pytest.raises(HashMismatch):
        write(config, HOTTER, "0" * 16)
    with pytest.raises(Rejected):
        write(config, {"t_cell_max": 127})
    master.deaf = True
    with pytest.raises(LinkError):
        write(config, HOTTER, dry_run=True)
    assert log.told == []


def test_what_failed_is_told_and_gets_a_result_where_the_master_was_asked(master):
    log = FakeWriteLog()
    config = configuration(master, log=log)
    FIELDS["status.flags"].pack_into(master.image, (1 << 8,))
    with pytest.raises(Busy):
        write(config, HOTTER)
    FIELDS["status.flags"].pack_into(master.image, (0,))
    master.refuse = Result.NOT_NOW
    with pytest.raises(MasterRefused):
        write(config, HOTTER)
    master.refuse, master.spoil_writes = None, True
    with pytest.raises(Unverified):
        write(config, HOTTER)
    results = [result for _, _, _, result in log.told]
    assert results[0] is None
    assert "not possible while driving" in results[1]
    assert results[2].startswith("not verified, neither the old nor the new one is in force")


def test_store_and_load_are_told_with_their_images(master):
    log = FakeWriteLog()
    config = configuration(master, log=log)
    config.store("anna")
    write(config, HOTTER)
    config.load("bob")
    stored, _, loaded = log.told
    assert (stored[0], stored[1].who, stored[1].after) == ("stored", "anna", default_image())
    assert (loaded[0], loaded[1].who, loaded[1].before) == ("loaded", "bob", HOT_IMAGE)
    assert [change.field for change in loaded[2]] == ["t_cell_max"]


def test_a_second_change_meanwhile_is_refused(master):
    class Log(FakeWriteLog):
        def begun(self, attempt):
            if attempt.action == "write":
                with pytest.raises(NotNow, match="another write"):
                    config.store("bob")

    config = configuration(master, log=Log())
    assert write(config, HOTTER).written
    assert config.store("bob").image == HOT_IMAGE


class FullLog(FakeWriteLog):
    """A history on a full disk."""

    def begun(self, attempt):
        raise RecordingFailed("no space left")


@pytest.mark.parametrize(
    "change",
    [
        lambda config: write(config, HOTTER),
        lambda config: config.store("anna"),
        lambda config: config.load("anna"),
    ],
    ids=["write", "store", "load"],
)
def test_without_its_intent_in_the_history_nothing_is_asked_of_the_master(master, change):
    configuration(master).store("anna")
    master.requests.clear()
    with pytest.raises(RecordingFailed):
        change(configuration(master, log=FullLog()))
    assert not any(isinstance(request, Write | Store | Load) for request in master.requests)
