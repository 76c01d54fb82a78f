"""How fast frames become cells: offline by the million, live as a share of one core.

Run: python -m benchmarks.dbc [--frames N]. The bus is that of the bundled foxBMS 2 profile: 216 cells by a
multiplexer, 180 temperatures, pack values, and a fifth of frames that no message has.
"""

import argparse
import time
from collections.abc import Callable

import numpy as np

from app.battery.library import load_profile
from app.battery.source import SpeaksDbc
from app.sources.dbc.assembly import Assembler
from app.sources.dbc.battery_decoder import BatteryDecoder
from app.sources.dbc.dbc_file import load_definitions
from app.sources.dbc.frames import Frames

IDS = [592] * 54 + [608] * 30 + [563] * 10 + [544] * 3 + [565] * 3 + [0x123] * 25
LIVE_HZ, BATCH_S, LIVE_S = 2000, 0.1, 20


def made_up(n: int) -> Frames:
    """Return n frames of random data, 0.5 ms apart."""
    rng = np.random.default_rng(1)
    data = rng.integers(0, 256, (n, 8), dtype=np.uint8)
    data[:, 0] %= 54
    ids = rng.choice(IDS, n).astype(np.uint32)
    return Frames(np.arange(n, dtype=np.int64) * (1_000_000_000 // LIVE_HZ), ids, np.full(n, 8, np.uint8), data)


def measured(job: Callable[[], object]) -> tuple[float, float]:
    """Return wall and processor time of a job [s], the best of three."""
    best = (float("inf"), float("inf"))
    for _ in range(3):
        wall_s, cpu_s = time.perf_counter(), time.process_time()
        job()
        best = min(best, (time.perf_counter() - wall_s, time.process_time() - cpu_s))
    return best


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=1_000_000)
    n = parser.parse_args().frames
    loaded = load_profile("foxbms-2")
    battery, source = loaded.profile.battery, loaded.profile.source
    assert isinstance(source, SpeaksDbc)
    decoder = BatteryDecoder(battery, source, load_definitions(loaded.dbc_files[0]))
    frames = made_up(n)
    wall_s, cpu_s = measured(lambda: decoder.decode(frames))
    print(
        f"decode {n} frames: {n / wall_s / 1e6:.2f} M frames/s wall, {n / cpu_s / 1e6:.2f} M frames/s of processor time"
    )
    wall_s, cpu_s = measured(lambda: Assembler(battery, source).feed(decoder.decode(frames)))
    print(f"decode and assemble: {n / wall_s / 1e6:.2f} M frames/s wall, {n / cpu_s / 1e6:.2f} of processor time")

    def live() -> None:
        assembler, size = Assembler(battery, source), round(LIVE_HZ * BATCH_S)
        for at in range(0, LIVE_HZ * LIVE_S, size):
            assembler.feed(decoder.decode(frames.part(slice(at, at + size))))

    _, cpu_s = measured(live)
    print(f"live at {LIVE_HZ} frames/s in batches of {BATCH_S} s: {100 * cpu_s / LIVE_S:.1f} % of one core")


if __name__ == "__main__":
    main()
