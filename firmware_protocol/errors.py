"""Everything that can go wrong between bytes and meaning.

ProtocolError
  EncodeError      our mistake: a value does not fit
  DecodeError      the peer's: bytes that mean nothing
  LibraryError     a shared library of C sources that cannot be used here
"""

from typing import Literal

LimitKind = Literal["bounds", "whole", "counts", "number", "array", "field", "signal", "buffer"]
_LIMITS: dict[LimitKind, str] = {
    "bounds": "{}",
    "whole": "a whole number, {}",
    "counts": "a whole number of counts, {}",
    "number": "a number",
    "array": "an array of {}",
    "field": "unknown configuration field",
    "buffer": "{}: size of the current sample buffer",
    "signal": "a value of the memory map, such as v_tot, v[36], slave[3].cvr[5]",
}


class ProtocolError(Exception):
    """Root of all errors that firmware_protocol raises."""


class EncodeError(ProtocolError):
    """A value cannot be put into its field; `limit` says in English what can, `kind` and `bounds` without words."""

    def __init__(self, field: str, value: object, bounds: str, kind: LimitKind = "bounds") -> None:
        limit = _LIMITS[kind].format(bounds)
        self.field = field
        self.value = value
        self.bounds = bounds
        self.kind = kind
        self.limit = limit
        super().__init__(f"{field} = {value!r}: {limit}")


class DecodeError(ProtocolError):
    """Bytes from the peer that are no valid message."""

    def __init__(self, what: str, reason: str, offset: int | None = None) -> None:
        self.what = what
        self.reason = reason
        self.offset = offset
        where = "" if offset is None else f" at byte {offset}"
        super().__init__(f"{what}{where}: {reason}")


class LibraryError(ProtocolError):
    """A shared library that is not there, or not the one of the C sources that it came with."""
