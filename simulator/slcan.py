"""A Lawicel (slcan) USB adapter on the simulated bus: the ASCII protocol of python-can's `slcan` interface.

Commands end with CR and are answered with CR or BELL. Frames: `t`iii`l`data, `T`iiiiiiii`l`data; CAN FD, towards the
computer only: `b`, `B` with the length's code as one hexadecimal digit.
"""

from collections.abc import Callable

from simulator.can_bus import PASSIVE, WARNING, CanBus, CanFrame

OK = b"\r"
ERROR = b"\a"
BIT_RATES = {
    ord("0"): 10_000,
    ord("1"): 20_000,
    ord("2"): 50_000,
    ord("3"): 100_000,
    ord("4"): 125_000,
    ord("5"): 250_000,
    ord("6"): 500_000,
    ord("7"): 750_000,
    ord("8"): 1_000_000,
}
_MAX_COMMAND = 32
_IS_WARNED, _IS_PASSIVE, _IS_OFF = 0x04, 0x20, 0x80  # status bits
_FD_LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)  # bytes, by their code
_DIGITS = {ord("t"): 3, ord("T"): 8}


class SlcanAdapter:
    """One adapter: a node of the bus towards the car, a byte stream towards the computer."""

    def __init__(self, bus: CanBus, send: Callable[[bytes], None]) -> None:
        self._bus = bus
        self._send = send
        self._buffer = bytearray()
        self._rate = 0
        self._is_open = False
        self.is_listening_only = False  # the computer opened the channel so
        self._now_s = 0.0
        self.is_unplugged = False

    @property
    def bit_rate(self) -> int:
        """The bit rate that the computer chose, 0 while the channel is closed [bit/s]."""
        return self._rate if self._is_open and not self.is_unplugged else 0

    def can_received(self, frame: CanFrame, now_s: float) -> None:
        """Forward a frame from the bus to the computer."""
        if self._is_open:
            kinds = "bB" if frame.is_fd else "tT"
            identifier = f"{kinds[1]}{frame.can_id:08X}" if frame.is_extended else f"{kinds[0]}{frame.can_id:03X}"
            length = _FD_LENGTHS.index(len(frame.data))
            self._send(f"{identifier}{length:X}{frame.data.hex().upper()}\r".encode())

    def feed(self, data: bytes, now_s: float) -> None:
        """Take bytes from the computer and answer the commands they complete."""
        self._now_s = now_s
        self._buffer += data
        while (end := self._buffer.find(b"\r")) >= 0:
            command = bytes(self._buffer[:end])
            del self._buffer[: end + 1]
            self._send(self._answer(command))
        if len(self._buffer) > _MAX_COMMAND:
            self._buffer.clear()
            self._send(ERROR)

    def _answer(self, command: bytes) -> bytes:
        if not command:
            return OK
        kind = command[0]
        if kind in b"OL" and len(command) == 1:
            self._is_open, self.is_listening_only = True, kind == ord("L")
            return OK
        if command == b"C":
            self._is_open = False
            return OK
        if kind == ord("S") and len(command) == 2 and command[1] in BIT_RATES:
            self._rate = BIT_RATES[command[1]]
            return OK
        if command == b"V":
            return b"V1013\r"
        if command == b"N":
            return b"NVW01\r"
        if command == b"F":
            return f"F{self._status():02X}\r".encode()
        if kind in _DIGITS:
            return self._transmit(command)
        return ERROR

    def _status(self) -> int:
        station = self._bus.station(self)
        errors = max(station.transmit_errors, station.receive_errors)
        return _IS_WARNED * (errors >= WARNING) | _IS_PASSIVE * (errors >= PASSIVE) | _IS_OFF * self._bus.is_off(self)

    def _transmit(self, command: bytes) -> bytes:
        if not self._is_open or self.is_listening_only:
            return ERROR
        frame = _parse_frame(command)
        if frame is None:
            return ERROR
        self._bus.send(self, frame, self._now_s)
        return b"Z\r" if frame.is_extended else b"z\r"


def _parse_frame(command: bytes) -> CanFrame | None:
    digits = _DIGITS[command[0]]
    try:
        can_id = int(command[1 : 1 + digits], 16)
        length = int(command[1 + digits : 2 + digits])
        data = bytes.fromhex(command[2 + digits :].decode("ascii"))
    except (ValueError, UnicodeDecodeError):
        return None
    is_extended = digits > 3
    if len(data) != length or length > 8 or can_id > (0x1FFFFFFF if is_extended else 0x7FF):
        return None
    return CanFrame(can_id, is_extended, data)
