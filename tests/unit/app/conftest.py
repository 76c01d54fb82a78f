"""A made-up master: an image of plausible values, and frames of it; sessions made of arrays."""

from dataclasses import dataclass, field
from pathlib import Path

import pytest

from app.sources.items import SerialItem
from firmware_protocol.config_image import default_image
from firmware_protocol.framing import decode_chunk, encode_frame
from firmware_protocol.memory_map import FIELDS, MASTER_SIZE
from firmware_protocol.messages import Data, MessageType, Window
from tests.recorded.arrays import SessionMaker

FAST = ((420, 20), (1884, 204), (2280, 116), (2982, 2))


@dataclass
class FakeMaster:
    """Fields are set by name in raw counts; `frame` gives the next telemetry frame as the link would."""

    image: bytearray = field(default_factory=lambda: bytearray(MASTER_SIZE))
    sequence: int = 0
    uptime_ms: int = 1000
    t_ns: int = 1_000_000_000

    def __post_init__(self) -> None:
        self.image[:420] = default_image()
        self.set("v", [37000 + i for i in range(96)])
        self.set("t", [25] * 96)
        self.set("i_fs", [1000])
        self.set("status.flags", [0b100000001])  # fit, load
        self.set("soc", [8000])
        self.set("v_tot", [35520])

    def set(self, name: str, values) -> None:
        FIELDS[name].pack_into(self.image, tuple(values))

    def windows(self, *ranges: tuple[int, int]) -> SerialItem:
        body = Data(tuple(Window(o, bytes(self.image[o : o + n])) for o, n in ranges)).to_body()
        return self.item(MessageType.DATA, body)

    def item(self, kind: int, body: bytes) -> SerialItem:
        raw = encode_frame(kind, self.sequence, self.uptime_ms, body)[1:-1]
        self.sequence = (self.sequence + 1) & 0xFF
        return SerialItem(self.t_ns, 1_700_000_000_000_000_000 + self.t_ns, decode_chunk(raw))

    def advance(self, ms: int = 100) -> None:
        self.uptime_ms += ms
        self.t_ns += ms * 1_000_000

    def frame(self, ms: int = 100) -> SerialItem:
        self.advance(ms)
        return self.windows(*FAST)

    def config(self) -> SerialItem:
        return self.windows((0, 420))


@pytest.fixture
def master() -> FakeMaster:
    return FakeMaster()


@pytest.fixture
def make_session(tmp_path: Path) -> SessionMaker:
    return SessionMaker(tmp_path / "sessions")
