"""The master of the thesis on its serial line, in the four layouts that it may have; it prints none.

`values(k)` is what is true of the k-th sample, one a second; the streams pack it by `struct` and by formatting.
"""

import struct
from collections.abc import Callable

import numpy as np

from app.estimation.arrays import FloatArray

DEGC = [20 + i % 5 for i in range(96)]


def volts(k: int) -> FloatArray:
    """(96,) cells apart by a few mV, a drive in steps."""
    return np.round(3.6 + 0.004 * np.arange(96) - 0.0004 * current_a(k), 4)


def current_a(k: int) -> float:
    return float((0.0, 41.25, 80.0, 120.5, 60.0, -20.0, 10.25)[k // 3 % 7])


def _numbers(k: int) -> tuple[int, list[int]]:
    return round(100 * current_a(k)), np.rint(1e4 * volts(k)).astype(int).tolist()


def arrays(k: int) -> bytes:
    amps, cells = _numbers(k)
    return struct.pack("<96bi96H", *DEGC, amps, *cells)


def packs(k: int) -> bytes:
    amps, cells = _numbers(k)
    parts = [struct.pack("<12b12H", *DEGC[p : p + 12], *cells[p : p + 12]) for p in range(0, 96, 12)]
    return b"".join(parts) + struct.pack("<i", amps)


def whole_struct(k: int) -> bytes:
    amps, cells = _numbers(k)
    image = bytearray(2984)
    struct.pack_into("<i96H", image, 1884, amps, *[0] * 96)
    struct.pack_into("<96H", image, 1896, *cells)
    struct.pack_into("<H96b", image, 2288, round(sum(cells) / 100), *DEGC)
    struct.pack_into("<H", image, 2982, 8000)
    return bytes(image)


def hex_line(k: int) -> bytes:
    amps, cells = _numbers(k)
    return (" ".join(f"{number & 0xFFFF:04X}" for number in (amps, *DEGC, *cells)) + "\r\n").encode()


STREAMS: dict[str, Callable[[int], bytes]] = {  # by the bundled profile
    "thesis-arrays": arrays,
    "thesis-packs": packs,
    "thesis-struct": whole_struct,
    "thesis-hex": hex_line,
}
