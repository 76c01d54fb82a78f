"""A battery on a serial line by a profile as a source: bytes in, measurements of any number of cells out."""

from app.battery.battery import Battery
from app.battery.serial import SerialMapping
from app.sources.dbc.assembly import BatteryMeasurement
from app.sources.dbc.source import AssembledSource, link_event
from app.sources.items import Item, LinkChange, SerialBytes
from app.sources.links.monitor import LinkMonitor
from app.sources.serial.decoder import SerialDecoder
from app.sources.serial.framing import StreamReader
from app.sources.source import NOTHING_RECEIVED, Received
from app.telemetry import Source
from app.telemetry.measurement import Measurement

LIVE_S = 3.0  # from the last frame on; LIVE_PERIODS of the slowest request, where that is longer
LIVE_PERIODS = 3.0
BITS = 10  # bits of a character on the line; parity and a second stop bit come on top


class SerialSource(AssembledSource):
    """Measures once a period in which frames came. Called from one thread; time comes with the items."""

    def __init__(self, battery: Battery, mapping: SerialMapping, url: str | None = None, *, name: Source) -> None:
        bits = BITS + (mapping.port.parity != "none") + (mapping.port.stop_bits > 1)
        live_s = max([LIVE_S, *(LIVE_PERIODS * part.poll_s for part in mapping.parts if part.poll)])
        rs232 = LinkMonitor(url, line_bytes_per_s=mapping.port.baud / bits, live_s=live_s)
        super().__init__(battery, mapping, name, rs232, LinkMonitor(None))
        self._reader = StreamReader(mapping)
        self._decoder = SerialDecoder(battery, mapping)
        self._silent_ns: int | None = None  # when silence completes a frame
        self._ends_ns: int | None = None  # when the period ends in which values came
        self._counted = (0, 0)  # frames, and bad ones, so far

    @property
    def due_ns(self) -> int | None:
        """Return when silence completes a frame, or the period ends in which values came."""
        return min((time_ns for time_ns in (self._silent_ns, self._ends_ns) if time_ns is not None), default=None)

    def feed(self, item: Item) -> Received:
        """Take one item from a link; a measurement follows the period in which frames came."""
        if isinstance(item, LinkChange):
            is_news = item.link == "rs232" and self._rs232.on_change(item)
            return link_event(item) if is_news else NOTHING_RECEIVED
        if not isinstance(item, SerialBytes):
            return NOTHING_RECEIVED
        measurement = self._take(item)
        self._silent_ns = item.t_mono_ns + self._reader.silence_ns
        if measurement is None:
            return NOTHING_RECEIVED
        return Received(self._measurement(measurement, item.t_mono_ns, item.t_wall_ns, is_fresh=True))

    def measure(self, t_mono_ns: int, t_wall_ns: int) -> Measurement:
        """Return a measurement of this instant; a frame that silence completes is in it."""
        is_due = self.due_ns is not None and t_mono_ns >= self.due_ns
        measurement = self._take(SerialBytes(t_mono_ns, t_wall_ns, b"")) if is_due else None
        newest = measurement or self._newest or self._assembler.measure(t_mono_ns)
        return self._measurement(newest, t_mono_ns, t_wall_ns, is_fresh=measurement is not None)

    def _take(self, item: SerialBytes) -> BatteryMeasurement | None:
        t_ns = item.t_mono_ns
        values = self._decoder.decode(self._reader.feed(item.data, t_ns))
        implausible = self._decoder.implausible_frames
        counted = self._reader.frames - implausible, self._reader.bad_frames + implausible
        frames, bad = (now - then for now, then in zip(counted, self._counted, strict=True))
        self._counted = counted
        self._rs232.on_read(item, frames, bad, self._reader.last)
        if self._silent_ns is not None and t_ns >= self._silent_ns:
            self._silent_ns = None
        if values:
            newest_ns = max(int(value.t_ns[-1]) for value in values.values())
            self._ends_ns = (newest_ns // self._period_ns + 1) * self._period_ns
        if self._ends_ns is not None and t_ns >= self._ends_ns:
            self._ends_ns = None
        return self._take_values(values, t_ns)
