"""Counts what a link delivers and says how far it can be trusted. Time is an argument; a replay counts the same."""

from collections import deque
from dataclasses import dataclass, field

from app.sources.items import CanFault, LinkChange, SerialBytes, UnframedBytes
from app.telemetry import LinkState, LinkStatus
from app.words import Text
from firmware_protocol.can_tables import worst_case_bits
from firmware_protocol.framing import LINE_BYTES_PER_S, BadFrame, BadReason, Frame

LIVE_S = 1.0
_WINDOW_NS = 2_000_000_000
DELIMITERS = 2


@dataclass(slots=True)
class _Rates:
    """Frames, bytes and bits in the last two seconds."""

    frames: int = 0
    bytes: int = 0
    bits: int = 0
    _entries: deque[tuple[int, int, int, int]] = field(default_factory=deque)

    def add(self, t_ns: int, frames: int, n_bytes: int, bits: int) -> None:
        self._entries.append((t_ns, frames, n_bytes, bits))
        self.frames += frames
        self.bytes += n_bytes
        self.bits += bits
        if self._entries[0][0] < t_ns - _WINDOW_NS:  # an import feeds millions of frames, and asks for no rate
            self.forget(t_ns)

    def forget(self, now_ns: int) -> None:
        while self._entries and self._entries[0][0] < now_ns - _WINDOW_NS:
            _, frames, n_bytes, bits = self._entries.popleft()
            self.frames -= frames
            self.bytes -= n_bytes
            self.bits -= bits

    def per_s(self, amount: int) -> float:
        return amount / (_WINDOW_NS / 1e9)


class LinkMonitor:
    """One link's counters."""

    def __init__(self, url: str | None, *, line_bytes_per_s: float | None = None, live_s: float = LIVE_S) -> None:
        self.url = url
        self._live_ns = round(live_s * 1e9)
        self._unframed_since_ns: int | None = None  # bytes without a frame
        self._line_bytes_per_s = line_bytes_per_s
        self._opened = False
        self._open_state: LinkState = "off" if url is None else "connecting"
        self._error: Text | None = None
        self._reported: tuple[str, Text | None] | None = None
        self._last_good_ns: int | None = None  # when it arrived
        self._last_sent_ns: int | None = None
        self._sequence: int | None = None
        self._uptime_ms = 0
        self._rates = _Rates()
        self.bit_rate: int | None = None  # bit rate of the CAN bus [bit/s], by the master's tables
        self._fault: CanFault | None = None
        self._unframed: UnframedBytes | None = None
        self.frames = self.lost = self.crc_errors = self.resyncs = self.bytes = self.reconnects = 0

    def on_change(self, change: LinkChange) -> bool:
        """The port opened, or was lost; False where that was known already (a port is tried again and again)."""
        reported = change.state, change.error
        is_news, self._reported = reported != self._reported, reported
        self._error = change.error
        if change.state == "open":
            self.reconnects += self._opened
            self._opened = True
            self._open_state = "silent"
            self._sequence = None
            self._fault = self._unframed = None
        else:
            self._open_state = change.state
        return is_news

    def on_frame(self, t_ns: int, frame: Frame | BadFrame, sent_ns: int | None = None) -> None:
        """A frame came off the RS232 line; `sent_ns` is when the master sent it, None = at once before."""
        self._add_bytes(t_ns, len(frame.raw) + DELIMITERS)
        if isinstance(frame, BadFrame):
            self.crc_errors += frame.reason is BadReason.CRC
            self.resyncs += frame.reason is not BadReason.CRC
            return
        self._unframed = None
        was_reset = frame.uptime_ms < self._uptime_ms
        if self._sequence is not None and not was_reset:
            self.lost += (frame.sequence - self._sequence - 1) & 0xFF
        self._sequence = frame.sequence
        self._uptime_ms = frame.uptime_ms
        self.frames += 1
        self._last_good_ns = t_ns
        self._last_sent_ns = t_ns if sent_ns is None else sent_ns

    def on_unframed(self, unframed: UnframedBytes) -> None:
        """Bytes arrived that are no frame; those of a bad frame are counted with it."""
        self._add_bytes(unframed.t_mono_ns, unframed.count)
        self._unframed = unframed

    def on_read(self, item: SerialBytes, frames: int, bad: int, last: bytes) -> None:
        """Bytes of a line that a profile describes, how many frames they complete, and the last of all."""
        t_ns = item.t_mono_ns
        self._add_bytes(t_ns, len(item.data))
        self.crc_errors += bad
        if frames:
            self.frames += frames
            self._last_good_ns = self._last_sent_ns = t_ns
            self._rates.add(t_ns, frames, 0, 0)
            self._unframed = self._unframed_since_ns = None
        elif self._unframed_since_ns is None:
            self._unframed_since_ns = t_ns
        elif t_ns - self._unframed_since_ns > self._live_ns:
            self._unframed = UnframedBytes(t_ns, item.t_wall_ns, len(item.data), last)

    def on_malformed(self, t_ns: int, frame: Frame) -> None:
        """A frame's checksum holds and its body is impossible: no good frame, though its number was not lost."""
        self._add_bytes(t_ns, len(frame.raw) + DELIMITERS)
        self.resyncs += 1
        self._sequence = frame.sequence

    def on_can_frame(self, t_ns: int, length: int, *, is_extended: bool = False) -> None:
        """A CAN frame was received."""
        self.frames += 1
        self._last_good_ns = self._last_sent_ns = t_ns
        self.bytes += length
        self._rates.add(t_ns, 1, length, worst_case_bits(length, is_extended))

    def on_fault(self, fault: CanFault) -> bool:
        """Take the controller's error state; True where it changed."""
        before, self._fault = self._fault, fault
        was = None if before is None else before.bus_state
        return fault.bus_state is not None and fault.bus_state != (was or "active")

    def on_snapshot(self, t_ns: int) -> None:
        """A fast frame made a snapshot."""
        self._rates.add(t_ns, 1, 0, 0)

    def _add_bytes(self, t_ns: int, count: int) -> None:
        self.bytes += count
        self._rates.add(t_ns, 0, count, 0)

    def is_live(self, now_ns: int) -> bool:
        """A good frame was sent within the last second."""
        return self._last_sent_ns is not None and now_ns - self._last_sent_ns < self._live_ns

    def _delivers(self, now_ns: int) -> bool:
        return self._last_good_ns is not None and now_ns - self._last_good_ns < self._live_ns

    def status(self, now_ns: int) -> LinkStatus:
        """Return the counters and the state at an instant."""
        state = self._open_state
        if state == "silent" and self._delivers(now_ns):
            state = "live" if self.is_live(now_ns) else "late"
        self._rates.forget(now_ns)
        bytes_per_s = self._rates.per_s(self._rates.bytes)
        return LinkStatus(
            state=state,
            url=self.url,
            age_s=None if self._last_sent_ns is None else max(0.0, (now_ns - self._last_sent_ns) / 1e9),
            frames=self.frames,
            lost=self.lost,
            crc_errors=self.crc_errors,
            resyncs=self.resyncs,
            bytes=self.bytes,
            rate_hz=self._rates.per_s(self._rates.frames),
            bytes_per_s=bytes_per_s,
            line_load=self._load(bytes_per_s),
            reconnects=self.reconnects,
            error=self._error,
            errors=None if self._fault is None else self._fault.errors,
            tx_errors=None if self._fault is None else self._fault.tx_errors,
            rx_errors=None if self._fault is None else self._fault.rx_errors,
            bus_state=None if self._fault is None else self._fault.bus_state,
            unframed=self._unframed_now(now_ns),
        )

    def _unframed_now(self, now_ns: int) -> str | None:
        unframed = self._unframed
        return None if unframed is None or now_ns - unframed.t_mono_ns > _WINDOW_NS else unframed.last.hex(" ")

    def _load(self, bytes_per_s: float) -> float | None:
        if self._line_bytes_per_s:
            return bytes_per_s / self._line_bytes_per_s
        return self._rates.per_s(self._rates.bits) / self.bit_rate if self.url and self.bit_rate else None


def rs232_monitor(url: str | None) -> LinkMonitor:
    """A monitor that knows the RS232 line's capacity."""
    return LinkMonitor(url, line_bytes_per_s=LINE_BYTES_PER_S)
