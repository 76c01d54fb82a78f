"""A session of hours for the pages to open, recorded as fast as the disk takes it.

The stream fills a line of 115200 8E1 as the master's does: the fast set every period, slow pieces in what is left, with
numbers as noisy as the real ones.
"""

from collections.abc import Iterator
from itertools import cycle
from pathlib import Path

import numpy as np

from app.sessions.recording.recorder import Recorder
from firmware_protocol.framing import encode_frame
from firmware_protocol.memory_map import FIELDS, MASTER_SIZE, N_CELLS
from firmware_protocol.messages import Data, MessageType, Window
from firmware_protocol.schedule import FAST_WINDOWS, SLOW_LENGTH, SLOW_RANGES, data_frame_time_s
from tests.fake_clock import FunctionClock

EPOCH_NS = 1_790_000_000 * 10**9


class Pack:
    """A struct whose numbers move and are noisy as those of a car."""

    def __init__(self) -> None:
        self._rng = np.random.default_rng(1)
        self._offsets = self._rng.integers(-60, 60, N_CELLS)
        self.image = bytearray(MASTER_SIZE)

    def measure(self, t_s: float) -> None:
        """Put the numbers of an instant into the struct."""
        rng = self._rng
        current_a = 60 + 55 * np.sin(t_s * 0.7) + 25 * np.sin(t_s * 3.1)
        level = 41000 - t_s * 0.5 % 9000 - current_a * 20
        voltages = level + self._offsets + rng.normal(0, 4, N_CELLS)
        self._put("i_fs", np.array([current_a * 100 + rng.normal(0, 12)]))
        self._put("i_fc", np.array([current_a * 100]))
        self._put("v", voltages)
        self._put("t", 35 + self._offsets / 30 + t_s / 900 % 20)
        self._put("ocv", voltages + current_a * 20)
        for slave in range(8):
            self._put(f"slave[{slave}].cvr", voltages[slave * 12 : slave * 12 + 12] + rng.normal(0, 6, 12))
            self._put(f"slave[{slave}].temp", 15000 + rng.normal(0, 10, 24))
            self._put(f"slave[{slave}].time", 900 + rng.normal(0, 3, 18))
        self._put("c", 2500 + self._offsets)
        self._put("r_fs", 210 + self._offsets / 5)

    def _put(self, name: str, values: np.ndarray) -> None:
        field = FIELDS[name]
        data = values.round().astype(f"<{np.dtype(field.fmt).str[1:]}").tobytes()
        self.image[field.offset : field.offset + len(data)] = data


def stream(ts_s: float, seconds: float) -> Iterator[tuple[float, bool, bytes]]:
    """Yield (time of arrival, whether it carries the fast set, bytes between the delimiters)."""
    pack, now_s, sequence, fast_s = Pack(), 0.0, 0, 0.0
    pieces = cycle(
        (start + at, min(SLOW_LENGTH, length - at))
        for start, length in SLOW_RANGES
        for at in range(0, length, SLOW_LENGTH)
    )
    while now_s < seconds:
        is_fast = now_s + data_frame_time_s(((0, SLOW_LENGTH),)) > fast_s
        if is_fast:
            now_s, fast_s = max(now_s, fast_s), fast_s + ts_s
            pack.measure(now_s)
        spans = FAST_WINDOWS if is_fast else (next(pieces),)
        body = Data(tuple(Window(o, bytes(pack.image[o : o + n])) for o, n in spans)).to_body()
        raw = encode_frame(MessageType.DATA, sequence & 0xFF, round(now_s * 1000), body)[1:-1]
        sequence += 1
        now_s += data_frame_time_s(spans)
        yield now_s, is_fast, raw


class Feed:
    """Hands a recorder what a pipeline would: frames, and an estimate for each fast one."""

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder
        self._noise = np.random.default_rng(2).normal(0, 2e-5, (997, N_CELLS))
        self._count = 0

    def hand_over(self, t_s: float, is_fast: bool, raw: bytes) -> None:
        """One frame, with its estimate."""
        t_ns = round(t_s * 1e9)
        self._recorder.frame(t_ns, EPOCH_NS + t_ns, 0, raw, True)
        if is_fast:
            soc = 0.9 - t_s * 2e-5 + self._noise[self._count % 997]
            self._recorder.estimates(t_ns, round(t_s * 1000), soc, np.full(N_CELLS, 0.01))
            self._count += 1


def long_session(folder: Path, ts_s: float, hours: float) -> Path:
    """Record hours and return the closed file."""
    now_ns = 0
    recorder = Recorder(folder, FunctionClock(lambda: now_ns, lambda: EPOCH_NS + now_ns), version="bench")
    info = recorder.start()
    feed = Feed(recorder)
    next_flush_s = 0.0
    for t_s, is_fast, raw in stream(ts_s, hours * 3600):
        feed.hand_over(t_s, is_fast, raw)
        now_ns = round(t_s * 1e9)
        if t_s >= next_flush_s:
            recorder.flush(60)
            next_flush_s = t_s + 10
    recorder.close(60)
    return info.path
