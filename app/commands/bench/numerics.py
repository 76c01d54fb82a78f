"""In-process: how long a filter pass over 96 cells takes, and how many frames a second the chain takes."""

import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.estimators import make_estimator
from app.live.pipeline import Pipeline
from app.sources.items import SerialItem
from app.sources.master.source import MasterSource
from firmware_protocol.config_image import default_image
from firmware_protocol.framing import FrameDecoder, encode_frame
from firmware_protocol.memory_map import FIELDS, MASTER_SIZE, N_CELLS
from firmware_protocol.messages import Data, MessageType, Window
from firmware_protocol.schedule import FAST_WINDOWS

CHIP_US = 290.0  # the cell monitor's conversion of a segment
PASSES = 3000


def _median_us(work: Callable[[int], Any], n: int) -> float:
    """Median time of one call [us], the first tenth left out as warm-up."""
    times = []
    for i in range(n):
        started = time.perf_counter_ns()
        work(i)
        times.append(time.perf_counter_ns() - started)
    return statistics.median(times[n // 10 :]) / 1000


def filter_pass_us(filter_name: str, cell_name: str) -> float:
    """Median time of one `step` over 96 cells [us], current and voltages changing."""
    rng = np.random.default_rng(1)
    estimator = make_estimator(filter_name, load_cell(cell_name), N_CELLS)
    voltages_v = list(rng.uniform(3.5, 3.9, (64, N_CELLS)))
    currents_a = rng.uniform(-20, 100, 64).tolist()
    temperatures_degc = np.full(N_CELLS, 30.0)
    estimator.start(voltages_v[0], temperatures_degc, 0.0)
    return _median_us(lambda i: estimator.step(0.1, currents_a[i % 64], voltages_v[i % 64], temperatures_degc), PASSES)


def example_image(step: int = 0) -> bytearray:
    """A struct full of plausible values, a little different at each step."""
    image = bytearray(MASTER_SIZE)
    image[:420] = default_image()
    FIELDS["v"].pack_into(image, tuple(36000 + (i * 37 + step * 11) % 900 for i in range(N_CELLS)))
    FIELDS["t"].pack_into(image, tuple(25 + i % 7 for i in range(N_CELLS)))
    FIELDS["i_fs"].pack_into(image, (2000 + step % 500,))
    FIELDS["status.flags"].pack_into(image, (0b100000001,))
    FIELDS["v_tot"].pack_into(image, (34900,))
    FIELDS["soc"].pack_into(image, (8000,))
    return image


def fast_frame(step: int, uptime_ms: int) -> bytes:
    """One telemetry frame as it stands on the line, both delimiters included."""
    image = example_image(step)
    windows = tuple(Window(offset, bytes(image[offset : offset + length])) for offset, length in FAST_WINDOWS)
    body = Data(windows).to_body()
    return encode_frame(MessageType.DATA, step & 0xFF, uptime_ms, body)


def chain_rates(filter_name: str, cell_name: str) -> tuple[float, float]:
    """Return (frames a second decoded from bytes, frames a second through decoder, shadow, filter and watch)."""
    frames = [fast_frame(i, 1000 + 100 * i) for i in range(2000)]
    decoder = FrameDecoder()
    decode_us = _median_us(lambda i: decoder.feed(frames[i]), len(frames))
    cell = load_cell(cell_name)
    pipeline = Pipeline(
        MasterSource("serial"),
        lambda: make_estimator(filter_name, cell, N_CELLS),
        filter_name=filter_name,
        cell_name=cell_name,
    )
    decoder = FrameDecoder()

    def whole(i: int) -> None:
        for frame in decoder.feed(frames[i]):
            pipeline.feed(SerialItem(i * 100_000_000, i * 100_000_000, frame))

    return 1e6 / decode_us, 1e6 / _median_us(whole, len(frames))
