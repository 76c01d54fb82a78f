"""The bus of an slcan adapter, of which only whole lines count.

The protocol has no checksum, and python-can takes a line as long as it needs and leaves the rest: where an overloaded
computer loses some bytes, two lines become one, and the cells of one frame get the voltages of another. Lines of the
same length that were cut and joined at the same place are the only ones that still pass.
"""

from typing import cast

from app.sources.links.python_can import can

_FD_LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)  # bytes, by their code
_DIGITS = {"t": 3, "d": 3, "b": 3, "T": 8, "x": 8, "D": 8, "B": 8}  # of the id
_TIMESTAMP = 4  # digits that some adapters append


def is_whole(line: str) -> bool:
    """Whether a line of the adapter is an answer, or a frame with exactly the bytes that it announces."""
    digits = _DIGITS.get(line[:1])
    if digits is None:
        return True
    body = line.rstrip("\r\a")
    try:
        length = _FD_LENGTHS[int(body[1 + digits], 16)]
        int(body[1:], 16)
    except (IndexError, ValueError):
        return False
    return len(body) - 2 - digits - 2 * length in (0, _TIMESTAMP)


def open_bus(arguments: dict[str, str | int | float | bool]) -> can.BusABC:
    """Open a bus by python-can's arguments; every driver raises its own errors."""
    if arguments["interface"] != "slcan":
        return can.Bus(**arguments)  # type: ignore[arg-type]
    return cast("can.BusABC", _whole_lines_bus()(**{k: v for k, v in arguments.items() if k != "interface"}))


def _whole_lines_bus() -> type:
    from can.interfaces.slcan import slcanBus

    class WholeLinesBus(slcanBus):
        def _read(self, timeout: float | None) -> str | None:
            line = super()._read(timeout)
            return line if line is None or is_whole(line) else ""

    return WholeLinesBus
