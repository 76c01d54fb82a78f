"""Everything that can go wrong between bytes and meaning.

ProtocolError
  EncodeError      our mistake: a value does not fit
  DecodeError      the peer's: bytes that mean nothing
"""


class ProtocolError(Exception):
    """Root of all errors that firmware_protocol raises."""


class EncodeError(ProtocolError):
    """A value cannot be put into its field."""

    def __init__(self, field: str, value: object, limit: str) -> None:
        self.field = field
        self.value = value
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
