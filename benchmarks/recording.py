"""CPU, size and answer times of recorded sessions: `python -m benchmarks.recording`.

The stream is the master's own schedule on a line of 115200 8E1, filled with numbers as noisy as the real ones. CPU is
of a process that does nothing but hand frames over in real time; sizes and answers are of a session of hours that is
recorded as fast as the disk takes it.
"""

import argparse
import statistics
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from app.clock import Clock
from app.sessions.reading.reader import SessionFile
from app.sessions.recording.recorder import Recorder
from firmware_protocol.framing import encode_frame
from firmware_protocol.memory_map import FIELDS, MASTER_SIZE, N_CELLS
from firmware_protocol.messages import Data, MessageType, Window
from firmware_protocol.schedule import FAST_WINDOWS, StreamSchedule, data_frame_time_s
from tests.fake_clock import FunctionClock

CAN_PERIOD_S = 0.1
EPOCH_NS = 1_790_000_000 * 10**9
SIGNALS = ("v[36]", "t[95]", "i_fs", "r_fs[7]", "slave[3].cvr[5]", "estimate.soc[36]")


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
    pack, schedule = Pack(), StreamSchedule(ts_s, 0.0)
    now_s, sequence = 0.0, 0
    while now_s < seconds:
        now_s = max(now_s, schedule.due_s(now_s))
        spans = schedule.take(now_s)
        if spans is None:
            now_s += 1e-4
            continue
        if spans == FAST_WINDOWS:
            pack.measure(now_s)
        body = Data(tuple(Window(o, bytes(pack.image[o : o + n])) for o, n in spans)).to_body()
        raw = encode_frame(MessageType.DATA, sequence & 0xFF, round(now_s * 1000), body)[1:-1]
        sequence += 1
        now_s += data_frame_time_s(spans)
        yield now_s, spans == FAST_WINDOWS, raw


class Feed:
    """Hands a recorder what a pipeline would: frames, an estimate for each fast one, CAN."""

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder
        self._next_can_s = 0.0
        self._rng = np.random.default_rng(2)
        self._noise = self._rng.normal(0, 2e-5, (997, N_CELLS))
        self._count = 0

    def hand_over(self, t_s: float, is_fast: bool, raw: bytes) -> None:
        """One frame, with its estimate and CAN frames."""
        t_ns = round(t_s * 1e9)
        self._recorder.frame(t_ns, EPOCH_NS + t_ns, 0, raw, True)
        if is_fast:
            soc = 0.9 - t_s * 2e-5 + self._noise[self._count % 997]
            self._recorder.estimates(t_ns, round(t_s * 1000), soc, np.full(N_CELLS, 0.01))
            self._count += 1
        while self._next_can_s <= t_s:
            self._recorder.can_frame(t_ns, EPOCH_NS + t_ns, 0x100, bytes(8))
            self._next_can_s += CAN_PERIOD_S


def cpu_percent(ts_s: float, seconds: float) -> float:
    """CPU of the recorder in real time, percent of a core, without the CPU of the pacing loop."""
    frames = list(stream(ts_s, seconds))
    spent = []
    with tempfile.TemporaryDirectory() as folder:
        for records in (False, True):
            recorder = Recorder(Path(folder), Clock(), version="bench")
            feed = Feed(recorder)
            if records:
                recorder.start()
            start_s, cpu_s = time.monotonic(), time.process_time()
            for t_s, is_fast, raw in frames:
                time.sleep(max(0.0, start_s + t_s - time.monotonic()))
                if records:
                    feed.hand_over(t_s, is_fast, raw)
            spent.append(time.process_time() - cpu_s)
            recorder.close()
    return 100 * (spent[1] - spent[0]) / seconds


def long_session(folder: Path, ts_s: float, hours: float) -> tuple[Path, int]:
    """Record hours and return the closed file, and how many frames were handed over."""
    now_ns = 0
    recorder = Recorder(folder, FunctionClock(lambda: now_ns, lambda: EPOCH_NS + now_ns), version="bench")
    info = recorder.start()
    feed = Feed(recorder)
    next_flush_s, sent = 0.0, 0
    for t_s, is_fast, raw in stream(ts_s, hours * 3600):
        feed.hand_over(t_s, is_fast, raw)
        sent += 1
        now_ns = round(t_s * 1e9)
        if t_s >= next_flush_s:
            recorder.flush(60)
            next_flush_s = t_s + 10
    recorder.close(60)
    return info.path, sent


def opening_s(path: Path) -> float:
    """Opening and asking for everything a list shows."""
    start_s = time.perf_counter()
    with SessionFile(path) as session:
        _ = session.info
        session.signal_names()
    return time.perf_counter() - start_s


def answer_ms(path: Path, signal: str, part: float) -> str:
    """A freshly opened file's answer with 2,000 points over a part of its length: time, and CPU time behind it."""
    wall_ms, cpu_ms = [], []
    for _ in range(5):
        with SessionFile(path) as session:
            info = session.info
            t_from_s = info.started_wall_ns / 1e9 + info.duration_s * (1 - part) / 2
            start_s, cpu_s = time.perf_counter(), time.process_time()
            session.series([signal], t_from_s, t_from_s + info.duration_s * part, points=2000)
            wall_ms.append(1000 * (time.perf_counter() - start_s))
            cpu_ms.append(1000 * (time.process_time() - cpu_s))
    return f"{statistics.median(wall_ms):.0f} ({statistics.median(cpu_ms):.0f})"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=4.0, help="length of the long session (default %(default)s)")
    parser.add_argument("--seconds", type=float, default=20.0, help="length of the CPU run (default %(default)s)")
    parser.add_argument("--ts", type=float, nargs="+", default=[0.1, 0.035], help="sampling periods of the master [s]")
    args = parser.parse_args()
    for ts_s in args.ts:
        used = cpu_percent(ts_s, args.seconds)
        print(f"CPU at {1 / ts_s:4.1f} Hz: {used:.2f} % of a core ({args.seconds:.0f} s in real time)")
    with tempfile.TemporaryDirectory() as folder:
        for ts_s in args.ts:
            path, sent = long_session(Path(folder), ts_s, args.hours)
            with SessionFile(path) as session:
                stored = sum(1 for _ in session.frames())
            size = path.stat().st_size / 1e6
            print(f"{args.hours:g} h at {1 / ts_s:4.1f} Hz: {sent} frames, {sent - stored} of them lost")
            print(f"  {size / args.hours:.1f} MB an hour")
            print(f"  open: {1000 * statistics.median(opening_s(path) for _ in range(5)):.1f} ms")
            for signal in SIGNALS:
                answers = ", ".join(answer_ms(path, signal, part) for part in (1, 0.1, 0.002))
                print(f"  2,000 points of {signal:18} over all, a tenth, 1/500: {answers} ms (of CPU), median of 5")


if __name__ == "__main__":
    main()
