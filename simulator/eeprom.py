"""The AT24C256 as a chip: 32 kB in a file, 64-byte pages, 5 ms a write, and the effects of a power cut and of wear."""

import logging
from pathlib import Path

import numpy as np

from simulator.errors import PortError

log = logging.getLogger(__name__)

SIZE = 32_768
PAGE_SIZE = 64
PAGE_WRITE_S = 0.005
ERASED = 0xFF
_TIME_TOLERANCE_S = 1e-9


class Eeprom:
    """The chip; with a path its content outlives the process, and every page write reaches the file at once."""

    def __init__(self, path: Path | None = None) -> None:
        """Open the file, or create an erased one.

        Raises:
            PortError: the file cannot be used, or is longer than the chip.
        """
        self._path = path
        self.content = bytearray([ERASED]) * SIZE
        self.worn_pages: set[int] = set()
        self._under_way: tuple[int, bytes, float] | None = None  # address, data, until when
        if path is None:
            return
        try:
            stored = path.read_bytes() if path.exists() else b""
            if len(stored) > SIZE:
                raise PortError(str(path), f"{len(stored)} bytes, an EEPROM has {SIZE}")
            self.content[: len(stored)] = stored
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("ab") as file:  # what is there stays as it is, whatever happens
                file.write(self.content[len(stored) :])
        except OSError as error:
            raise PortError(str(path), str(error)) from error

    def read(self, address: int, length: int) -> bytes:
        """Return bytes; reading beyond the end starts again at 0, as the chip's counter does."""
        doubled = self.content + self.content
        return bytes(doubled[address : address + length])

    def write(self, address: int, data: bytes) -> None:
        """Write up to a page; bytes beyond the page's end wrap to its start.

        A worn page keeps what it held; so does one that the file does not take, which is logged.
        """
        page = address // PAGE_SIZE
        if page in self.worn_pages:
            return
        start = page * PAGE_SIZE
        written = self.content[start : start + PAGE_SIZE]
        for index, byte in enumerate(data):
            written[(address - start + index) % PAGE_SIZE] = byte
        if self._path is not None:
            try:
                with self._path.open("r+b") as file:
                    file.seek(start)
                    file.write(written)
            except OSError as error:
                log.warning("EEPROM page %d is not written: %s", page, error)
                return
        self.content[start : start + PAGE_SIZE] = written

    def begin_write(self, address: int, data: bytes, now_s: float) -> None:
        """Begin to write a page, which takes the chip 5 ms."""
        self._under_way = address, data, now_s + PAGE_WRITE_S

    def is_busy(self, now_s: float) -> bool:
        """Return whether a page is being written still."""
        if self._under_way is not None and self._under_way[2] <= now_s + _TIME_TOLERANCE_S:
            self.write(*self._under_way[:2])
            self._under_way = None
        return self._under_way is not None

    def lose_power(self, rng: np.random.Generator) -> None:
        """Cut the power: of a page under way some bytes are written, then one is random."""
        if self._under_way is not None:
            address, data, _ = self._under_way
            n_bytes, garbage = int(rng.integers(len(data) + 1)), int(rng.integers(256))
            self.write(address, (data[:n_bytes] + bytes([garbage]))[: len(data)])
            self._under_way = None
