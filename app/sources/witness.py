"""Other sources of the same battery: heard beside its own, compared with it, never mixed into it.

A witness speaks by a DBC, on the battery's bus or on one of its own. Its values have ages of their own; one that is
silent, or wrong, changes nothing of what the battery tells itself.
"""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from app.battery.battery import Battery
from app.estimation.arrays import FloatArray
from app.sources.dbc.assembly import Assembler, BatteryMeasurement
from app.sources.dbc.battery_decoder import BatteryDecoder
from app.sources.dbc.frames import frames_of
from app.sources.items import BUS_SHIFT, MOST_BUSES, CanFault, CanItem, Item, LinkChange, bus_of
from app.sources.links.can import bit_rate_of
from app.sources.links.monitor import LinkMonitor
from app.sources.loaded_battery import LoadedWitness
from app.sources.source import MeasurementSource, Received
from app.telemetry import Event, Identity, Source
from app.telemetry.link_messages import link_lost
from app.telemetry.measurement import Measurement
from app.telemetry.witness import Quantity, Witness, WitnessReading
from app.words import Message
from firmware_protocol.messages import Reply

WINDOW_NS = 2_000_000_000  # of the means that are compared
PERSISTENCE_NS = 2_000_000_000  # they differ for so long before it is said
SWING_SHARE = 0.1  # of what the battery's own value moved within the window: the two are told at different instants
_BUS_BITS = (MOST_BUSES - 1) << BUS_SHIFT


@dataclass(frozen=True, slots=True)
class _Tolerance:
    unit: str
    least: float
    share: float = 0.0


TOLERANCES: dict[Quantity, _Tolerance] = {
    "current": _Tolerance("A", 2.0, 0.02),
    "pack_voltage": _Tolerance("V", 1.0, 0.01),
    "soc": _Tolerance("1", 0.05),
    "voltage": _Tolerance("V", 0.02),
    "temperature": _Tolerance("degC", 5.0),
}


class _Comparison:
    """One witness: decodes what it says and holds it against what the battery says."""

    def __init__(self, battery: Battery, loaded: LoadedWitness) -> None:
        self._battery = battery = replace(battery, limits={})
        self.name, self.bus = loaded.name, loaded.bus
        self._decoder = BatteryDecoder(battery, loaded.source, loaded.definitions)
        self._assembler = Assembler(battery, loaded.source)
        told = {name for name in ("current", "pack_voltage", "soc") if getattr(loaded.source, name) is not None}
        self._quantities = [name for name in TOLERANCES if name in told | set(loaded.source.cells)]
        self._waiting: list[tuple[int, int, bytes]] = []
        self._newest_ns: int | None = None
        self._pairs: deque[tuple[int, Mapping[Quantity, FloatArray], Mapping[Quantity, FloatArray]]] = deque()
        self._differs_since_ns: dict[Quantity, int] = {}

    def take(self, item: CanItem) -> None:
        self._waiting.append((item.t_mono_ns, item.can_id & ~_BUS_BITS, item.data))

    def compare(self, measured: Measurement) -> Witness:
        """Return what it says at the instant of a measurement."""
        now_ns = measured.t_mono_ns
        values = self._decoder.decode(frames_of(self._waiting)) if self._waiting else {}
        self._waiting = []
        heard_ns = [int(each.t_ns[-1]) for each in values.values() if len(each.t_ns)]
        self._newest_ns = max([*heard_ns, *([] if self._newest_ns is None else [self._newest_ns])], default=None)
        self._assembler.feed(values, now_ns)
        theirs = self._witness_values(self._assembler.measure(now_ns), now_ns)
        if measured.is_fresh:
            self._pairs.append((now_ns, _own_values(measured), theirs))
        while self._pairs and self._pairs[0][0] < now_ns - WINDOW_NS:
            self._pairs.popleft()
        return Witness(
            name=self.name,
            bus=self.bus,
            age_s=None if self._newest_ns is None else (now_ns - self._newest_ns) / 1e9,
            readings=tuple(self._reading(name, theirs[name], now_ns) for name in self._quantities),
        )

    def _witness_values(self, told: BatteryMeasurement, now_ns: int) -> dict[Quantity, FloatArray]:
        return {
            "current": _one(told.current_a),
            "pack_voltage": _one(told.pack_voltage_v),
            "soc": _one(told.soc),
            "voltage": _young(told.voltage_v, (now_ns - told.voltage_t_ns) / 1e9),
            "temperature": self._battery.cell_temperatures(told.temperature_degc),
        }

    def _reading(self, name: Quantity, theirs: FloatArray, now_ns: int) -> WitnessReading:
        """Hold the means of the last seconds against each other: no step of the load is seen by both at one instant."""
        tolerance, value = TOLERANCES[name], None if len(theirs) > 1 else _known(theirs[0])
        ours = np.array([each[name] for _, each, _ in self._pairs])
        off = np.array([each[name] for _, _, each in self._pairs]).reshape(ours.shape) - ours
        compared = np.isfinite(off).any(axis=0) if len(off) else np.zeros(len(theirs), np.bool_)
        compared &= np.isfinite(theirs)
        if not compared.any():
            self._differs_since_ns.pop(name, None)
            return WitnessReading(name, value, None, None, tolerance.unit, None, None)
        cells = np.flatnonzero(compared)
        swing = np.nanmax(ours[:, cells], axis=0) - np.nanmin(ours[:, cells], axis=0)
        limit = np.maximum(tolerance.least, tolerance.share * np.abs(theirs[cells])) + SWING_SHARE * swing
        beyond = np.abs(np.nanmean(off[:, cells], axis=0)) - limit
        worst = int(np.argmax(beyond))
        cell = int(cells[worst])
        if beyond[worst] <= 0:
            self._differs_since_ns.pop(name, None)
        since_ns = None if beyond[worst] <= 0 else self._differs_since_ns.setdefault(name, now_ns)
        return WitnessReading(
            quantity=name,
            value=float(np.nanmean((ours + off)[:, cell])),
            ours=float(np.nanmean(ours[np.isfinite(off[:, cell]), cell])),
            limit=float(limit[worst]),
            unit=tolerance.unit,
            cell=cell if len(theirs) > 1 else None,
            verdict=since_ns is None or now_ns - since_ns < PERSISTENCE_NS,
        )


def _known(value: float) -> float | None:
    return None if np.isnan(value) else float(value)


class WitnessedSource:
    """A battery's own source with its witnesses. Called from one thread; time comes with the items."""

    def __init__(
        self, inner: MeasurementSource, witnesses: Sequence[LoadedWitness], urls: Sequence[str | None] = ()
    ) -> None:
        """Hear witnesses beside a source; `urls` are those of the buses, the source's own first."""
        self._inner = inner
        self._witnesses = [_Comparison(inner.battery, each) for each in witnesses]
        self._buses: dict[int, LinkMonitor] = {}
        for bus in sorted({each.bus for each in witnesses} - {0}):
            url = urls[bus] if bus < len(urls) else None
            self._buses[bus] = LinkMonitor(url)
            self._buses[bus].bit_rate = bit_rate_of(url)

    @property
    def name(self) -> Source:
        """Where the items come from."""
        return self._inner.name

    @property
    def battery(self) -> Battery:
        """Whose measurements they are."""
        return self._inner.battery

    @property
    def identity(self) -> Identity | None:
        """What the master said of itself."""
        return self._inner.identity

    @property
    def due_ns(self) -> int | None:
        """When `measure` has something new to tell without another item."""
        return self._inner.due_ns

    def believe_only(self, is_asked: Callable[[Reply], bool]) -> None:
        """Believe what a reply says of the master only where somebody asked for it."""
        self._inner.believe_only(is_asked)

    def feed(self, item: Item) -> Received:
        """Take one item from a link."""
        bus = bus_of(item)
        if isinstance(item, CanItem) and not item.sent:
            for witness in self._witnesses:
                if witness.bus == bus:
                    witness.take(item)
        received = self._inner.feed(item) if bus == 0 else self._on_bus(bus, item)
        if received.measurement is None:
            return received
        return replace(received, measurement=self._witnessed(received.measurement))

    def measure(self, t_mono_ns: int, t_wall_ns: int) -> Measurement:
        """Return a measurement of this instant."""
        return self._witnessed(self._inner.measure(t_mono_ns, t_wall_ns))

    def _on_bus(self, bus: int, item: Item) -> Received:
        """Count what comes of a bus that is not the battery's own; nothing of it reaches the battery's source."""
        monitor = self._buses.get(bus)
        if monitor is None:
            return Received()
        if isinstance(item, CanItem) and not item.sent:
            monitor.on_can_frame(item.t_mono_ns, len(item.data), is_extended=bool(item.can_id >> 31))
        elif isinstance(item, CanFault):
            monitor.on_fault(item)
        elif isinstance(item, LinkChange) and monitor.on_change(item) and item.state != "connecting":
            lost = item.state == "lost"
            what = link_lost("can", item.error) if lost else Message("can-open")
            message = Message("of-bus", bus=bus, what=what)
            return Received(events=(Event(item.t_wall_ns, "watch" if lost else "info", message.code, message),))
        return Received()

    def _witnessed(self, measured: Measurement) -> Measurement:
        if not self._witnesses:
            return measured
        now_ns = measured.t_mono_ns
        found = [each.compare(measured) for each in self._witnesses]
        links = {bus: monitor.status(now_ns) for bus, monitor in self._buses.items()}
        return replace(measured, witnesses=tuple(replace(each, link=links.get(each.bus)) for each in found))


def _own_values(measured: Measurement) -> dict[Quantity, FloatArray]:
    total_v = measured.reported.voltage_v
    return {
        "current": _one(measured.current_a),
        "pack_voltage": _one(float(measured.voltage_v.sum()) if total_v is None else total_v),
        "soc": _one(measured.master.soc),
        "voltage": _young(measured.voltage_v, measured.voltage_age_s),
        "temperature": measured.temperature_degc,
    }


def _one(value: float | None) -> FloatArray:
    return np.array([np.nan if value is None else value])


def _young(values: FloatArray, age_s: FloatArray | None) -> FloatArray:
    """Voltages of other instants carried other currents: they are not compared."""
    return values if age_s is None else np.where(age_s <= WINDOW_NS / 1e9, values, np.nan)
