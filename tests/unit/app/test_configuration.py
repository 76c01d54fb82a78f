"""The safe write against a master in memory whose line is cut, or lies, at chosen requests."""

import threading

import pytest

from app.configuration import Configuration, HashMismatch, Rejected, Unverified
from app.errors import LinkError, LinkLost, MasterRefused, NotNow
from app.links.master import MasterClient
from app.telemetry import Identity
from firmware_protocol.config_image import default_image, image_hash, with_raw
from firmware_protocol.eeprom import EEPROM_SIZE, plan_store
from firmware_protocol.framing import CommandDecoder, Frame
from firmware_protocol.messages import (
    EEPROM_READ_BASE,
    IdentRequest,
    Load,
    Read,
    Reply,
    Result,
    Store,
    Write,
    decode_request,
)

SAME_MAP = Identity("1.0.0", 1, "00", is_compatible=True, boots=1)


class MemoryMaster:
    """Holds an image and an EEPROM; `lose` names requests (by count) whose reply or doing is lost."""

    def __init__(self) -> None:
        self.image = bytearray(2984)
        self.image[:420] = default_image()
        self.eeprom = bytearray(b"\xff" * EEPROM_SIZE)
        self.decoder = CommandDecoder()
        self.client = MasterClient(self.send)
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
                    threading.Thread(target=self.client.on_reply, args=(reply,)).start()

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
        else:
            assert isinstance(request, IdentRequest | Load)
        return Reply(frame.type, frame.sequence, Result.DONE, data=data)


@pytest.fixture
def master():
    return MemoryMaster()


def configuration(master, identity=SAME_MAP):
    return Configuration(master.client, lambda: identity)


def hotter(image):
    return with_raw(image, "t_cell_max", 55)


def test_a_write_is_read_back_and_its_difference_told(master):
    written = configuration(master).write(hotter, image_hash(default_image()), dry_run=False)
    assert written.written
    assert [(c.field, c.before, c.after) for c in written.changes] == [("t_cell_max", 45, 55)]
    assert bytes(master.image[:420]) == hotter(default_image())


def test_a_dry_run_and_an_empty_change_write_nothing(master):
    config = configuration(master)
    assert not config.write(hotter, "*", dry_run=True).written
    assert not config.write(lambda image: image, "*", dry_run=False).written
    assert not any(isinstance(request, Write) for request in master.requests)


def test_another_configuration_in_force_refuses_the_write(master):
    with pytest.raises(HashMismatch) as caught:
        configuration(master).write(hotter, "0" * 16, dry_run=False)
    assert caught.value.in_force == default_image()
    assert bytes(master.image[:420]) == default_image()


def test_values_outside_their_range_never_leave(master):
    def broken(image):
        return image[:9] + b"\x7f" + image[10:]

    with pytest.raises(Rejected) as caught:
        configuration(master).write(broken, "*", dry_run=False)
    assert caught.value.errors[0].field == "t_cell_max"
    assert not any(isinstance(request, Write) for request in master.requests)


def test_a_master_with_another_map_is_never_written(master):
    other = Identity("9.9.9", 1, "ff", is_compatible=False, boots=1)
    for identity in (other, None):
        with pytest.raises(NotNow):
            configuration(master, identity).write(hotter, "*", dry_run=False)
    assert bytes(master.image[:420]) == default_image()


def test_a_refusal_is_told_with_its_offset(master):
    master.refuse = Result.NOT_NOW
    with pytest.raises(MasterRefused) as caught:
        configuration(master).write(hotter, "*", dry_run=False)
    assert (caught.value.result, caught.value.offset) == ("NOT_NOW", 4)


@pytest.mark.parametrize("attribute", ["cut_writes", "deaf_after_write"])
def test_a_cut_line_says_that_it_does_not_know_and_a_retry_is_safe(master, attribute):
    setattr(master, attribute, True)
    config = configuration(master)
    with pytest.raises(Unverified) as caught:
        config.write(hotter, "*", dry_run=False)
    assert caught.value.outcome == "unknown"
    assert bytes(master.image[:420]) in (default_image(), hotter(default_image()))
    setattr(master, attribute, False)
    master.deaf = False
    config.write(hotter, "*", dry_run=False)
    assert bytes(master.image[:420]) == hotter(default_image())


def test_a_byte_that_reads_back_differently_is_found(master):
    master.spoil_writes = True
    with pytest.raises(Unverified) as caught:
        configuration(master).write(hotter, "*", dry_run=False)
    assert caught.value.outcome == "other"


def test_store_reads_the_eeprom_back(master):
    config = configuration(master)
    assert config.read_stored() is None
    stored = config.store()
    assert stored.image == default_image()
    config.write(hotter, "*", dry_run=False)
    assert config.store().counter == stored.counter + 1
    assert config.read_stored().image == hotter(default_image())


def test_a_deaf_master_is_an_error_and_not_a_hang(master):
    master.deaf = True
    with pytest.raises(LinkError):
        configuration(master).read()
