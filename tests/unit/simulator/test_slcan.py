import pytest

from simulator.can_bus import CanBus, CanFrame
from simulator.slcan import SlcanAdapter


class Computer:
    """A computer behind the adapter, and the other node of the bus."""

    is_listening_only = False

    def __init__(self) -> None:
        self.bus = CanBus()
        self.received = b""
        self.adapter = SlcanAdapter(self.bus, self.take)
        self.bus_frames: list[CanFrame] = []
        self.bit_rate = 500_000
        self.bus.attach(self.adapter)
        self.bus.attach(self)
        self._now_s = 0.0

    def take(self, data: bytes) -> None:
        self.received += data

    def can_received(self, frame: CanFrame, now_s: float) -> None:
        self.bus_frames.append(frame)

    def says(self, command: bytes) -> bytes:
        self.received = b""
        self.adapter.feed(command, self._now_s)
        answer = self.received
        self.pass_time()
        return answer

    def pass_time(self) -> None:
        self._now_s += 0.1
        self.bus.run(self._now_s)

    def send(self, frame: CanFrame) -> None:
        self.bus.send(self, frame, self._now_s)
        self.pass_time()


@pytest.fixture
def computer() -> Computer:
    computer = Computer()
    computer.says(b"C\rS6\r\rO\r")
    return computer


def test_frames_reach_the_bus_and_are_acknowledged(computer):
    assert computer.says(b"t1232AABB\r") == b"z\r"
    assert computer.says(b"T1806E5F40\r") == b"Z\r"
    assert computer.bus_frames == [CanFrame(0x123, False, b"\xaa\xbb"), CanFrame(0x1806E5F4, True, b"")]


def test_frames_from_the_bus_are_spelled_out(computer):
    computer.send(CanFrame(0x100, False, b"\x01\xff"))
    computer.send(CanFrame(0x18FF50E5, True, b""))
    assert computer.received.endswith(b"t100201FF\rT18FF50E50\r")


def test_a_closed_or_wrongly_clocked_channel_hears_nothing(computer):
    computer.says(b"C\r")
    computer.send(CanFrame(0x100, False, b""))
    assert computer.received == b"\r"
    computer.says(b"S5\rO\r")
    computer.send(CanFrame(0x100, False, b""))
    assert computer.received == b"\r\r"


@pytest.mark.parametrize(
    "command", [b"t12\r", b"t1239\r", b"t123XAA\r", b"t8001AA\r", b"Tffffffff0\r", b"S9\r", b"?\r", b"t1231A\r"]
)
def test_nonsense_is_refused_and_does_not_reach_the_bus(computer, command):
    assert computer.says(command) == b"\a"
    assert computer.bus_frames == []


def test_listen_only_does_not_send(computer):
    computer.says(b"C\rL\r")
    assert computer.says(b"t1230\r") == b"\a"


def test_an_endless_line_is_dropped(computer):
    assert b"\a" in computer.says(b"t" * 100)
    assert computer.says(b"V\r") == b"V1013\r"


def test_the_status_tells_of_errors(computer):
    assert computer.says(b"F\r") == b"F00\r"
    computer.bus.station(computer.adapter).transmit_errors = 100
    assert computer.says(b"F\r") == b"F04\r"
    computer.bus.is_broken = True
    computer.says(b"t1230\r")
    assert computer.says(b"F\r") == b"FA4\r"


def test_frames_of_can_fd_are_spelled_with_the_code_of_their_length(computer):
    computer.send(CanFrame(0x100, False, bytes(range(12))))
    computer.send(CanFrame(0x18FF50E5, True, bytes(64)))
    assert computer.received.endswith(b"b1009000102030405060708090A0B\rB18FF50E5F" + 64 * b"00" + b"\r")


@pytest.mark.parametrize(
    ("opens", "arrives"), [(b"S5\rL\r", True), (b"S5\rO\r", False)], ids=["listens", "acknowledges"]
)
def test_a_wrong_rate_gives_no_frames_and_disturbs_the_bus_only_where_it_acknowledges(computer, opens, arrives):
    class Third:
        bit_rate, is_listening_only = 500_000, False

        def __init__(self):
            self.frames = []

        def can_received(self, frame, now_s):
            self.frames.append(frame)

    third = Third()
    computer.bus.attach(third)
    computer.says(b"C\r" + opens)
    computer.send(CanFrame(0x100, False, b"\x01"))
    assert computer.received.strip(b"\r") == b""
    assert bool(third.frames) is arrives
    assert (computer.bus.error_frames > 0) is not arrives
