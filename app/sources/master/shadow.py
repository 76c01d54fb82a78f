"""The shadow image: what the service knows of the master's struct, and since when it knows each byte."""

import numpy as np

from firmware_protocol.memory_map import FIELDS, MASTER_SIZE, Field
from firmware_protocol.messages import Window

NEVER = np.iinfo(np.int64).min


class ShadowImage:
    """2984 bytes, each with the monotonic time at which the master measured it."""

    def __init__(self) -> None:
        self.image = bytearray(MASTER_SIZE)
        self.measured_ns = np.full(MASTER_SIZE, NEVER, dtype=np.int64)

    def write(self, windows: tuple[Window, ...], t_ns: int) -> None:
        """Copy windows whose bytes were sampled together, at `t_ns`."""
        for window in windows:
            end = window.offset + len(window.data)
            self.image[window.offset : end] = window.data
            self.measured_ns[window.offset : end] = t_ns

    def write_whole_elements(self, windows: tuple[Window, ...], t_ns: int) -> None:
        """Copy only elements that the windows cover entirely: half a value mixed with an old half is a wrong value.

        Flags are the exception, each bit stands for itself.
        """
        given = {window.offset + i: byte for window in windows for i, byte in enumerate(window.data)}
        for field, element in {_ELEMENT_AT[offset] for offset in given if offset in _ELEMENT_AT}:
            start = field.offset + element * field.item_size
            offsets = range(start, start + field.item_size)
            if field.name == "status.flags":
                offsets = range(start, start + 1)
            if all(offset in given for offset in offsets):
                self.image[offsets.start : offsets.stop] = bytes(given[offset] for offset in offsets)
                self.measured_ns[offsets.start : offsets.stop] = t_ns

    def age_s(self, start: int, length: int, now_ns: int) -> float | None:
        """Seconds since the oldest byte of a range was measured; None where any never came."""
        oldest = int(self.measured_ns[start : start + length].min())
        return None if oldest == NEVER else max(0.0, (now_ns - oldest) / 1e9)


_ELEMENT_AT: dict[int, tuple[Field, int]] = {
    offset: (field, (offset - field.offset) // field.item_size)
    for field in FIELDS.values()
    for offset in range(field.offset, field.end)
}
