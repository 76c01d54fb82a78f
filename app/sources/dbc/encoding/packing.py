"""One number into the bits of a frame: scaled, rounded, held within its bits."""

import struct
from dataclasses import dataclass

from app.sources.dbc.definitions import Layout

_FLOATS = {16: ("<e", "<H"), 32: ("<f", "<I"), 64: ("<d", "<Q")}


def raw_number(value: float, layout: Layout) -> int:
    """Return the raw number nearest to a value, within what the bits hold; a float's are its bits."""
    scaled = (value - layout.offset) / layout.scale
    if layout.is_float:
        number, bits = _FLOATS[layout.length]
        return int(struct.unpack(bits, struct.pack(number, scaled))[0])
    low, high = bounds(layout)
    return min(max(round(scaled), low), high)


def bounds(layout: Layout) -> tuple[int, int]:
    """Return the lowest and the highest raw number."""
    if layout.is_signed:
        return -(1 << (layout.length - 1)), (1 << (layout.length - 1)) - 1
    return 0, (1 << layout.length) - 1


@dataclass(frozen=True, slots=True)
class Place:
    """Where a signal stands in a frame of a size, the frame taken as one little-endian number."""

    size: int  # bytes
    layout: Layout
    mask: int

    @classmethod
    def of(cls, layout: Layout, size: int) -> "Place":
        """Return the place; a signal that stands beyond the frame has none of its bits in it."""
        return cls(size, layout, cls(size, layout, 0)._shifted((1 << layout.length) - 1))

    def put(self, whole: int, raw: int) -> int:
        """Return the frame with the raw number in it."""
        return whole & ~self.mask | self._shifted(raw & ((1 << self.layout.length) - 1))

    def _shifted(self, bits: int) -> int:
        everything = (1 << 8 * self.size) - 1
        if self.layout.is_little_endian:
            return bits << self.layout.start & everything
        first = self.layout.start // 8 * 8 + 7 - self.layout.start % 8  # from the first bit on the wire
        shift = 8 * self.size - first - self.layout.length
        big = bits << shift if shift >= 0 else bits >> -shift
        return int.from_bytes((big & everything).to_bytes(self.size, "big"), "little")
