"""The safe write against the simulated master, with the power cut at every frame and at every byte of the EEPROM.

The line is a function call, so each cut is at its exact place and takes no time.
"""

import numpy as np
import pytest

from app.clock import Clock
from app.configuration.rules import Context
from app.configuration.safe_write import ConfigurationWriter, Draft, Unverified
from app.errors import LinkError, LinkLost, MasterRefused
from app.estimation.cell_model.cell_file import load_cell
from app.sources.master.client import MasterClient
from app.telemetry import Identity
from firmware_protocol.config_image import default_image, image_hash, with_value
from firmware_protocol.eeprom import newest, plan_store
from firmware_protocol.framing import Frame, FrameDecoder
from firmware_protocol.memory_map import CONFIG_SIZE
from firmware_protocol.messages import MessageType
from simulator.board import Board
from simulator.eeprom import PAGE_SIZE, Eeprom
from simulator.master import VirtualMaster
from simulator.vehicle import PASS_S
from tests.campaign import of_size
from tests.fake_clock import FakeClock
from tests.fake_write_log import FakeWriteLog

OLD = with_value(default_image(), "v_cell_chrg", 4.1)
NEW = with_value(with_value(default_image(), "v_cell_chrg", 4.12), "t_cell_max", 50)
SAME_MAP = Identity("1.0.0", 1, "00", is_compatible=True, boots=1)
CELL = load_cell()
BROWN_OUT = 2
EVERY_BYTE = of_size(4, 1, 1)  # bytes of a page; `make test` takes another one in four of each


class CutEeprom(Eeprom):
    """Loses its power after so many bytes; the one under way holds anything."""

    def __init__(self) -> None:
        super().__init__()
        self.bytes_left: int | None = None
        self.is_off = False

    def write(self, address: int, data: bytes) -> None:
        left = self.bytes_left
        if self.is_off:
            return
        if left is None or left >= len(data):
            self.bytes_left = None if left is None else left - len(data)
            super().write(address, data)
            return
        self.bytes_left = None
        super().write(address, (data[:left] + b"\x5a")[: len(data)])
        self.is_off = True


class Car:
    """A master that boots with OLD, and a line that is cut at a given frame, counted in both directions."""

    def __init__(self, slots: int = 2) -> None:
        self.eeprom = CutEeprom()
        for _ in range(slots):
            for page in plan_store(bytes(self.eeprom.content), OLD):
                self.eeprom.write(page.offset, page.data)
        self.board = Board(self.eeprom, np.random.default_rng(1))
        self.now_s = 0.0
        self.master = VirtualMaster(self.board, self.now_s)
        self.decoder = FrameDecoder()
        self.frames = 0
        self.cut_at: int | None = None
        self.resets = False  # the master loses power at the cut; else only the line is gone for a moment
        self.client = MasterClient(self.send, Clock())
        self.client.identity = SAME_MAP
        self.configuration = ConfigurationWriter(self.client, lambda: Context(CELL), FakeWriteLog(), FakeClock())

    def boot(self) -> None:
        self.now_s += 1.0
        self.master = VirtualMaster(self.board, self.now_s, BROWN_OUT)
        self.decoder = FrameDecoder()

    def pass_frame(self) -> None:
        self.frames += 1
        if self.frames - 1 == self.cut_at:
            if self.resets:
                self.boot()
            raise LinkLost("cut")

    def send(self, data: bytes) -> None:
        self.pass_frame()
        self.now_s += 0.05
        self.master.receive(data, self.now_s)
        for _ in range(100):
            if self.answer():
                return
            self.now_s += PASS_S
            self.master.measure(self.now_s, PASS_S, 0.0)
            if self.eeprom.is_off:
                self.eeprom.is_off = False
                self.boot()
                raise LinkLost("power cut")
        raise AssertionError("no answer")

    def answer(self) -> bool:
        answered = False
        while (raw := self.master.next_frame(self.now_s)) is not None:
            for item in self.decoder.feed(raw):
                if isinstance(item, Frame) and item.type == MessageType.REPLY:
                    self.pass_frame()
                    answered = self.client.on_frame(item)
        return answered

    @property
    def in_force(self) -> bytes:
        return bytes(self.master.image[:CONFIG_SIZE])

    @property
    def stored(self) -> bytes:
        return newest(bytes(self.eeprom.content)).image


def write(car: Car) -> None:
    car.configuration.write(Draft(NEW), "*", "anna", dry_run=False)


def frames_of(action) -> int:
    car = Car()
    action(car)
    return car.frames


def write_and_store(car: Car) -> None:
    write(car)
    car.configuration.store("anna")


N_FRAMES = frames_of(write_and_store)


def test_a_write_and_a_store_take_a_request_and_a_reply_for_each_of_their_steps():
    assert N_FRAMES == 2 * (5 + 6), "read, flags, current, write, read back; read, store, two slots in two parts"


@pytest.mark.parametrize("resets", [False, True], ids=["line", "power"])
@pytest.mark.parametrize("cut_at", range(N_FRAMES))
def test_a_cut_at_any_frame_leaves_the_old_or_the_new_image_and_a_retry_ends_with_the_new(cut_at, resets):
    car = Car()
    car.cut_at, car.resets = cut_at, resets
    with pytest.raises(LinkError) as caught:
        write_and_store(car)
    assert car.in_force in (OLD, NEW)
    assert car.stored in (OLD, NEW)
    if isinstance(caught.value, Unverified):
        told = {"old": OLD, "new": NEW}.get(caught.value.outcome)
        assert told is None or car.in_force == told, "what is said to be in force is in force"
    in_force = car.configuration.read()
    assert image_hash(in_force) == image_hash(car.in_force)
    write_and_store(car)
    assert (car.in_force, car.stored) == (NEW, NEW)


def test_the_page_is_told_which_of_the_two_is_in_force_when_the_line_comes_back():
    said = set()
    for cut_at in range(6, 10):  # the write, its reply, the read-back, its reply
        car = Car()
        car.cut_at = cut_at
        with pytest.raises(Unverified) as caught:
            write(car)
        said.add((caught.value.outcome, car.in_force == NEW))
    assert said == {("old", False), ("new", True)}


def load_after_a_write(car: Car) -> None:
    write(car)
    car.configuration.load("anna")


@pytest.mark.parametrize("resets", [False, True], ids=["line", "power"])
@pytest.mark.parametrize("cut_at", range(frames_of(write), frames_of(load_after_a_write)))
def test_a_cut_at_any_frame_of_a_load_leaves_one_of_the_two_and_says_which(cut_at, resets):
    car = Car()
    car.cut_at, car.resets = cut_at, resets
    with pytest.raises(LinkError) as caught:
        load_after_a_write(car)
    assert car.in_force in (OLD, NEW)
    if isinstance(caught.value, Unverified):
        told = {"old": NEW, "new": OLD}[caught.value.outcome]
        assert car.in_force == told
    car.configuration.load("anna")
    assert car.in_force == OLD


def pages_of_a_store(slots: int) -> int:
    """All of an erased slot; of one that is in use those that change."""
    car = Car(slots)
    write(car)
    return len(plan_store(bytes(car.eeprom.content), NEW))


@pytest.mark.parametrize(
    ("slots", "page"), [(slots, page) for slots in (1, 2) for page in range(pages_of_a_store(slots))]
)
def test_a_power_cut_at_any_byte_of_the_eeprom_leaves_the_old_or_the_new_and_a_retry_is_safe(slots, page):
    for byte in range(page % EVERY_BYTE, PAGE_SIZE, EVERY_BYTE):
        car = Car(slots)
        write(car)
        car.eeprom.bytes_left = page * PAGE_SIZE + byte
        with pytest.raises((LinkError, MasterRefused)):
            car.configuration.store("anna")
        assert car.stored in (OLD, NEW)
        assert car.in_force == car.stored, "it boots with what it holds"
        assert car.configuration.read_stored().image == car.stored
        write_and_store(car)
        assert (car.in_force, car.stored) == (NEW, NEW)
