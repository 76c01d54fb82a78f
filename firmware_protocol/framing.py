"""Bytes on the RS232 line to frames and back: COBS between 0x00, a header, a CRC. No I/O, no meaning of bodies.

frame on the line = 00 | COBS( type u8, sequence u8, uptime_ms u32, body, CRC-16 of all before ) | 00, little endian.
CRC-16: polynomial 0x1021, start 0xFFFF, not reflected (CRC-16/IBM-3740; its check value over "123456789" is 0x29B1).
"""

import binascii
import enum
import struct
from dataclasses import dataclass, field

from firmware_protocol.errors import EncodeError

START_STREAM = 0x78  # 'x'
STOP_STREAM = 0x79  # 'y'
MAX_BODY = 512
_CODES = tuple(bytes([length + 1]) for length in range(254))  # what stands before a block
_HEADER = struct.Struct("<BBI")
_CRC = struct.Struct("<H")
HEADER_SIZE = _HEADER.size
OVERHEAD = HEADER_SIZE + _CRC.size
MAX_PAYLOAD = OVERHEAD + MAX_BODY
MAX_ENCODED = MAX_PAYLOAD + (MAX_PAYLOAD + 253) // 254  # between the delimiters

BAUD_RATE = 115_200
BITS_PER_BYTE = 11  # start, 8 data, even parity, stop
LINE_BYTES_PER_S = BAUD_RATE / BITS_PER_BYTE
LINE_SILENCE_S = 0.1  # after which the master drops an unfinished frame


@dataclass(frozen=True, slots=True)
class Frame:
    """One intact frame; `raw` is the bytes between the delimiters on the line."""

    type: int
    sequence: int
    uptime_ms: int
    body: bytes
    raw: bytes = field(default=b"", repr=False, compare=False)


class BadReason(enum.StrEnum):
    """The reason why bytes between two delimiters are no frame."""

    COBS = "cobs"
    SHORT = "short"
    LONG = "long"
    CRC = "crc"


@dataclass(frozen=True, slots=True)
class BadFrame:
    """Bytes between two delimiters that are no frame; of an over-long one only the first MAX_ENCODED bytes."""

    reason: BadReason
    raw: bytes


def crc16(data: bytes | bytearray | memoryview) -> int:
    """CRC-16/IBM-3740."""
    return binascii.crc_hqx(data, 0xFFFF)


def cobs_encode(data: bytes) -> bytes:
    """Return `data` without any zero byte, one byte longer for every 254 begun."""
    blocks = data.split(b"\0")
    if len(max(blocks, key=len)) < 254:
        return b"".join([_CODES[len(block)] + block for block in blocks])
    out = bytearray()
    for block in blocks:
        start = 0
        while len(block) - start >= 254:
            out.append(255)
            out += block[start : start + 254]
            start += 254
        out.append(len(block) - start + 1)
        out += block[start:]
    if blocks[-1] and len(blocks[-1]) % 254 == 0:
        out.pop()  # a full last block ends the data
    return bytes(out)


def cobs_decode(encoded: bytes) -> bytes | None:
    """Return the data, or None where a count points beyond the end, is zero, or nothing was given."""
    out = bytearray()
    position, end = 0, len(encoded)
    if not end:
        return None
    while position < end:
        code = encoded[position]
        following = position + code
        if not code or following > end:
            return None
        out += encoded[position + 1 : following]
        position = following
        if code != 255 and position < end:
            out.append(0)
    return bytes(out)


def encode_frame(frame_type: int, sequence: int, uptime_ms: int, body: bytes) -> bytes:
    """Return the frame as it goes onto the line, both delimiters included.

    Raises:
        EncodeError: the body is longer than MAX_BODY.
    """
    if len(body) > MAX_BODY:
        raise EncodeError("body", f"{len(body)} bytes", f"at most {MAX_BODY} bytes")
    payload = _HEADER.pack(frame_type, sequence & 0xFF, uptime_ms & 0xFFFFFFFF) + body
    return b"\0" + cobs_encode(payload + _CRC.pack(crc16(payload))) + b"\0"


def decode_chunk(raw: bytes) -> Frame | BadFrame:
    """Decode the bytes between two delimiters."""
    if len(raw) > MAX_ENCODED:
        return BadFrame(BadReason.LONG, raw[:MAX_ENCODED])
    payload = cobs_decode(raw)
    if payload is None:
        return BadFrame(BadReason.COBS, raw)
    if len(payload) < OVERHEAD:
        return BadFrame(BadReason.SHORT, raw)
    if len(payload) > MAX_PAYLOAD:
        return BadFrame(BadReason.LONG, raw)
    if crc16(payload[:-2]) != _CRC.unpack_from(payload, len(payload) - 2)[0]:
        return BadFrame(BadReason.CRC, raw)
    frame_type, sequence, uptime_ms = _HEADER.unpack_from(payload)
    return Frame(frame_type, sequence, uptime_ms, payload[HEADER_SIZE:-2], raw)


class FrameDecoder:
    """The host's side: every byte between delimiters is a frame. Any bytes, in any chunks; never raises on input.

    What comes before the first delimiter is the tail of a frame nobody saw the start of: dropped and counted in
    `skipped_bytes`, no error.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._in_step = False
        self._overflowed = False
        self.skipped_bytes = 0

    def feed(self, data: bytes | bytearray | memoryview) -> list[Frame | BadFrame]:
        """Return the items that `data` completes, in order."""
        *complete, rest = bytes(data).split(b"\0")
        out: list[Frame | BadFrame] = []
        for chunk in complete:
            self._append(chunk)
            if not self._in_step:
                self.skipped_bytes += len(self._buffer)
                self._in_step = True
            elif self._overflowed:
                out.append(BadFrame(BadReason.LONG, bytes(self._buffer)))
            elif self._buffer:
                out.append(decode_chunk(bytes(self._buffer)))
            self._buffer.clear()
            self._overflowed = False
        self._append(rest)
        return out

    def _append(self, chunk: bytes) -> None:
        room = MAX_ENCODED - len(self._buffer)
        if len(chunk) <= room:
            self._buffer += chunk
            return
        self._buffer += chunk[:room]
        if self._in_step:
            self._overflowed = True
        else:
            self.skipped_bytes += len(chunk) - room
