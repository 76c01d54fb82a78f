"""The AT24C256 as a chip: 32 kB in a file, 64-byte pages, 5 ms a write, and the effects of a power cut and of wear."""

import logging
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from simulator.errors import PortError

log = logging.getLogger(__name__)

SIZE = 32_768
PAGE_SIZE = 64
PAGE_WRITE_S = 0.005
ERASED = 0xFF


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

    def tear(self, address: int, data: bytes, n_bytes: int, garbage: int) -> None:
        """Write what is left after a power cut: the first `n_bytes`, then one random byte."""
        self.write(address, (data[:n_bytes] + bytes([garbage & 0xFF]))[: len(data)])


class PageJob:
    """Page writes one after the other, 5 ms each; an interruption leaves a page written in part."""

    def __init__(self, eeprom: Eeprom, pages: Iterable[tuple[int, bytes]], now_s: float) -> None:
        self._eeprom = eeprom
        self._pages = list(pages)
        self.due_s = now_s + PAGE_WRITE_S

    def run(self, now_s: float) -> bool:
        """Finish the pages whose write time has passed; return whether all are done."""
        while self._pages and self.due_s <= now_s:
            self._eeprom.write(*self._pages.pop(0))
            self.due_s += PAGE_WRITE_S
        return not self._pages

    def interrupt(self, rng: np.random.Generator) -> None:
        """Cut the power."""
        if self._pages:
            address, data = self._pages[0]
            self._eeprom.tear(address, data, int(rng.integers(len(data) + 1)), int(rng.integers(256)))
        self._pages.clear()
