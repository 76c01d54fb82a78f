"""The wire from the master's UART to the host: limited to 115200 8E1, with disturbances on request.

Time is virtual seconds, given by the caller. A frame is handed over whole, at the instant at which its last byte left.
"""

import numpy as np

from firmware_protocol.framing import LINE_BYTES_PER_S


class UartLine:
    """One direction of the line, from the master to the host."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._in_flight: bytes = b""
        self.is_busy = False  # a frame is on the wire
        self.busy_until_s = 0.0
        self.bytes_sent = 0
        self.noise_per_byte = 0.0
        self.is_stuck = False
        self.is_dropping = False

    def send(self, frame: bytes, now_s: float) -> None:
        """Put the next frame on the wire; the caller waits until it is free."""
        self._in_flight, self.is_busy = frame, bool(frame)
        self.busy_until_s = max(now_s, self.busy_until_s) + len(frame) / LINE_BYTES_PER_S

    def take(self) -> bytes:
        """Return the received bytes of the frame whose last byte was just sent, and free the wire."""
        frame, self._in_flight, self.is_busy = self._in_flight, b"", False
        self.bytes_sent += len(frame)
        return self.disturb(frame)

    def disturb(self, data: bytes) -> bytes:
        """Return the bytes after the disturbances of the line."""
        if self.is_stuck:
            return b""
        if self.is_dropping:
            return data[: int(self._rng.integers(len(data) + 1))]
        if not self.noise_per_byte:
            return data
        hits = np.flatnonzero(self._rng.random(len(data)) < self.noise_per_byte)
        out = bytearray(data)
        for hit in hits:
            out[hit] ^= 1 << int(self._rng.integers(8))
        return bytes(out)
