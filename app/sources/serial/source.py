"""A battery on a serial line by a profile as a source: bytes in, measurements of any number of cells out."""

from app.battery.battery import Battery
from app.battery.serial import SerialMapping
from app.estimation.arrays import BoolArray
from app.sources.dbc.assembly import Assembler, BatteryMeasurement
from app.sources.dbc.source import UpdateInterval, link_event, measurement_of
from app.sources.items import Item, LinkChange, SerialBytes
from app.sources.links.monitor import LinkMonitor
from app.sources.serial.decoder import SerialDecoder
from app.sources.serial.framing import StreamReader
from app.sources.source import NOTHING_RECEIVED, Received
from app.telemetry import Links, Source
from app.telemetry.measurement import Measurement

LIVE_S = 3.0  # from the last frame on; LIVE_PERIODS of the slowest request, where that is longer
LIVE_PERIODS = 3.0
BITS = 10  # bits of a character on the line; parity and a second stop bit come on top


class SerialSource:
    """Measures once a period in which frames came. Called from one thread; time comes with the items."""

    def __init__(self, battery: Battery, mapping: SerialMapping, url: str | None = None, *, name: Source) -> None:
        self.name: Source = name
        self.battery = battery
        self._reader = StreamReader(mapping)
        self._decoder = SerialDecoder(battery, mapping)
        self._assembler = Assembler(battery, mapping)
        self._period_ns = round(mapping.period_s * 1e9)
        self._newest: BatteryMeasurement | None = None
        self._sampled_ns: int | None = None
        self._silent_ns: int | None = None  # when silence completes a frame
        self._ends_ns: int | None = None  # when the period ends in which values came
        self._rhythm = UpdateInterval()
        bits = BITS + (mapping.port.parity != "none") + (mapping.port.stop_bits > 1)
        live_s = max([LIVE_S, *(LIVE_PERIODS * each.poll_s for each in mapping.parts if each.poll)])
        self._rs232 = LinkMonitor(url, line_bytes_per_s=mapping.port.baud / bits, live_s=live_s)
        self._can = LinkMonitor(None)
        self._counted = (0, 0)  # frames, and bad ones, so far

    @property
    def due_ns(self) -> int | None:
        """When silence completes a frame, or the period ends in which values came."""
        return min((each for each in (self._silent_ns, self._ends_ns) if each is not None), default=None)

    def feed(self, item: Item) -> Received:
        """Take one item from a link; a measurement follows the period in which frames came."""
        if isinstance(item, LinkChange):
            is_news = item.link == "rs232" and self._rs232.on_change(item)
            return link_event(item) if is_news else NOTHING_RECEIVED
        if not isinstance(item, SerialBytes):
            return NOTHING_RECEIVED
        found = self._take(item)
        self._silent_ns = item.t_mono_ns + self._reader.silence_ns
        if found is None:
            return NOTHING_RECEIVED
        return Received(self._measurement(found, item.t_mono_ns, item.t_wall_ns, is_fresh=True))

    def measure(self, t_mono_ns: int, t_wall_ns: int) -> Measurement:
        """Return a measurement of this instant; a frame that silence completes is in it."""
        is_due = self.due_ns is not None and t_mono_ns >= self.due_ns
        found = self._take(SerialBytes(t_mono_ns, t_wall_ns, b"")) if is_due else None
        newest = found or self._newest or self._assembler.measure(t_mono_ns)
        return self._measurement(newest, t_mono_ns, t_wall_ns, is_fresh=found is not None)

    def _take(self, item: SerialBytes) -> BatteryMeasurement | None:
        """Decode what was read; of the periods that ended the newest with a sample, else the newest."""
        t_ns = item.t_mono_ns
        values = self._decoder.decode(self._reader.feed(item.data, t_ns))
        counted = self._reader.frames - self._decoder.implausible_frames, self._reader.bad_frames
        frames, bad = (now - then for now, then in zip(counted, self._counted, strict=True))
        self._counted = counted
        self._rs232.on_read(item, frames, bad, self._reader.last)
        if self._silent_ns is not None and t_ns >= self._silent_ns:
            self._silent_ns = None
        found = self._assembler.feed(values, t_ns - t_ns % self._period_ns)
        if values:
            self._ends_ns = (
                max(int(each.t_ns[-1]) for each in values.values()) // self._period_ns + 1
            ) * self._period_ns
        if self._ends_ns is not None and t_ns >= self._ends_ns:
            self._ends_ns = None
        for each in found:
            self._rhythm.see(each)
        if not found:
            return None
        self._newest = next((each for each in reversed(found) if each.is_sample), found[-1])
        return self._newest

    def _measurement(self, found: BatteryMeasurement, t_mono_ns: int, t_wall_ns: int, *, is_fresh: bool) -> Measurement:
        is_sample = is_fresh and found.is_sample
        dt_s: float | None = None
        is_new: BoolArray | None = None
        if is_sample:
            before_ns, self._sampled_ns = self._sampled_ns, found.t_ns
            dt_s = None if before_ns is None else (found.t_ns - before_ns) / 1e9
            is_new = None if before_ns is None else found.voltage_t_ns > before_ns
        return measurement_of(
            self.battery,
            found,
            t_mono_ns,
            t_wall_ns,
            dt_s=dt_s,
            is_sample=is_sample,
            is_fresh=is_fresh,
            links=Links(self._rs232.status(t_mono_ns), self._can.status(t_mono_ns)),
            is_new=is_new,
            awaited=self._assembler.awaited(t_mono_ns),
            live_s=self._rhythm.live_s(),
        )
