"""A master's stream made by hand: voltages that differ by cell and move with time."""

from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from app.sessions.recording.recorder import Recorder
from firmware_protocol.framing import encode_frame
from firmware_protocol.memory_map import FIELDS, MASTER_SIZE
from firmware_protocol.messages import Data, MessageType, Window
from tests.fake_clock import FunctionClock

WALL_NS = 1_790_000_000 * 10**9
MONO_NS = 5_000 * 10**9
FAST = ((420, 20), (1884, 204), (2280, 116), (2982, 2))


@cache
def voltages_at(phase: int) -> tuple[int, ...]:
    """What every cell shows; it repeats after 50 samples."""
    return tuple(36000 + 10 * cell + (phase + cell) % 50 for cell in range(96))


class Stream:
    """Frames of a master that samples every `ts_ms`; `voltages` keeps what was sent."""

    def __init__(self, ts_ms: int = 100) -> None:
        self.ts_ms = ts_ms
        self.count = 0
        self.uptime_ms = 1000
        self.image = bytearray(MASTER_SIZE)
        FIELDS["t"].pack_into(self.image, tuple(20 + cell % 12 for cell in range(96)))
        self.voltages: list[tuple[int, ...]] = []
        self.currents: list[int] = []

    def next(self, windows: tuple[tuple[int, int], ...] = FAST) -> tuple[int, int, bytes]:
        """The next frame as (t_mono_ns, t_wall_ns, raw)."""
        step = self.count
        voltages = voltages_at(step * 7 % 50)
        FIELDS["v"].pack_into(self.image, voltages)
        current = 5000 * (-1) ** (step // 10) + step % 10
        FIELDS["i_fs"].pack_into(self.image, (current,))
        self.voltages.append(voltages)
        self.currents.append(current)
        body = Data(tuple(Window(o, bytes(self.image[o : o + n])) for o, n in windows)).to_body()
        raw = encode_frame(MessageType.DATA, step & 0xFF, self.uptime_ms, body)[1:-1]
        t_ns = step * self.ts_ms * 1_000_000
        self.count += 1
        self.uptime_ms += self.ts_ms
        return MONO_NS + t_ns, WALL_NS + t_ns, raw

    def feed(self, recorder: Recorder, frames: int) -> list[bytes]:
        """Hand the recorder so many frames, each with an estimate; return what was sent."""
        sent = []
        for _ in range(frames):
            uptime_ms = self.uptime_ms
            t_mono_ns, t_wall_ns, raw = self.next()
            recorder.frame(t_mono_ns, t_wall_ns, 0, raw, True)
            soc = np.linspace(0.9, 0.8, 96) - self.count * 1e-4
            recorder.estimates(t_mono_ns, uptime_ms, soc, np.full(96, 0.01))
            sent.append(raw)
        return sent

    def skip(self, samples: int) -> None:
        """Let time pass without a frame."""
        self.count += samples
        self.uptime_ms += samples * self.ts_ms
        self.voltages += [()] * samples
        self.currents += [0] * samples


@pytest.fixture
def stream() -> Stream:
    return Stream()


def recorder_in(folder: Path) -> Recorder:
    """A recorder whose clocks stand still at the stream's start, and whose disk is never full."""
    clock = FunctionClock(lambda: MONO_NS, lambda: WALL_NS)
    return Recorder(folder, clock, version="1.2.3", free_bytes=lambda _: 1 << 40)


@pytest.fixture
def recorder(tmp_path: Path) -> Iterator[Recorder]:
    """A recorder for one test."""
    recorder = recorder_in(tmp_path / "sessions")
    yield recorder
    recorder.close()
