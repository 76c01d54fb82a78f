"""The source of a battery with a DBC: CAN frames in, measurements of any number of cells out."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from app.battery.battery import LIMITS, Battery, SignalName
from app.battery.serial import SerialMapping
from app.battery.source import DbcMapping
from app.sources.dbc.assembly import PERIODS_BRIDGED, Assembler, BatteryMeasurement
from app.sources.dbc.battery_decoder import BatteryDecoder, ChannelValues
from app.sources.dbc.definitions import Definitions
from app.sources.dbc.frames import frames_of_items
from app.sources.dbc.two_senders import TwoSenders
from app.sources.items import CanFault, CanItem, Item, LinkChange
from app.sources.links.can_bus import bit_rate_of
from app.sources.links.monitor import LinkMonitor
from app.sources.source import NOTHING_RECEIVED, Received
from app.telemetry import Ages, Charger, Event, Links, Master, ProtectionLimits, Source
from app.telemetry.events import link_lost
from app.telemetry.measurement import STALE_S, Measurement, Reported
from app.telemetry.snapshot import MasterState, Number
from app.words import Message

_NO_EXTREME = (None, None)
FADE = 0.95  # share of a gap that is kept from one value to the next
PACK_VOLTAGE_ERROR = 0.01  # relative error of a separate sensor, read at another instant than the cells
_STATES: tuple[tuple[str, MasterState], ...] = (  # the first that is known counts
    ("fault", "fault"),
    ("charging", "charge"),
    ("balancing", "balance"),
    ("closed", "drive"),
)


@dataclass(slots=True)
class UpdateInterval:
    """The period of each part, and with it how long a value of the part is live."""

    newest_ns: dict[str, int] = field(default_factory=dict)
    gap_s: dict[str, float] = field(default_factory=dict)

    def see(self, measurement: BatteryMeasurement) -> None:
        """Take a measurement: the gap of a part is its longest of late, which fades; a pause counts as few gaps."""
        for part, t_ns in measurement.newest_ns.items():
            before_ns = self.newest_ns.get(part)
            if before_ns is None or t_ns <= before_ns:
                self.newest_ns.setdefault(part, t_ns)
                continue
            gap_s, usual_s = (t_ns - before_ns) / 1e9, self.gap_s.get(part)
            self.newest_ns[part] = t_ns
            if usual_s is None or gap_s < usual_s:
                self.gap_s[part] = gap_s if usual_s is None else FADE * usual_s + (1 - FADE) * gap_s
            else:
                self.gap_s[part] = min(gap_s, PERIODS_BRIDGED * usual_s)

    def live_s(self) -> Ages:
        """Seconds for which a value of each part is live."""
        return _of_parts({part: max(STALE_S, PERIODS_BRIDGED * gap_s) for part, gap_s in self.gap_s.items()})


class AssembledSource:
    """A source whose frames on CAN or a serial line are assembled into measurements, one a period."""

    def __init__(
        self,
        battery: Battery,
        mapping: DbcMapping | SerialMapping,
        name: Source,
        rs232: LinkMonitor,
        can: LinkMonitor,
    ) -> None:
        self.name: Source = name
        self.battery = battery
        self._assembler = Assembler(battery, mapping)
        self._period_ns = round(mapping.period_s * 1e9)
        self._newest: BatteryMeasurement | None = None
        self._sampled_ns: int | None = None
        self._rhythm = UpdateInterval()
        self._rs232, self._can = rs232, can

    def _take_values(self, values: Mapping[str, ChannelValues], until_ns: int) -> BatteryMeasurement | None:
        """Return, of the periods that ended, the newest with a sample, else the newest; None: none ended."""
        measurements = self._assembler.feed(values, until_ns - until_ns % self._period_ns)
        if not measurements:
            return None
        for measurement in measurements:
            self._rhythm.see(measurement)
        self._newest = next(
            (measurement for measurement in reversed(measurements) if measurement.is_sample), measurements[-1]
        )
        return self._newest

    def _measurement(
        self, measured: BatteryMeasurement, t_mono_ns: int, t_wall_ns: int, *, is_fresh: bool
    ) -> Measurement:
        is_sample = is_fresh and measured.is_sample
        dt_s, is_new = None, None
        if is_sample:
            before_ns, self._sampled_ns = self._sampled_ns, measured.t_ns
            dt_s = None if before_ns is None else (measured.t_ns - before_ns) / 1e9
            is_new = np.ones(self.battery.n_cells, np.bool_) if before_ns is None else measured.voltage_t_ns > before_ns
        return measurement_of(
            self.battery,
            measured,
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


class DbcSource(AssembledSource):
    """Decodes in batches of one period. Called from one thread; time comes with the items."""

    def __init__(
        self,
        battery: Battery,
        source: DbcMapping,
        definitions: Definitions,
        url: str | None = None,
        *,
        name: Source = "can",
    ) -> None:
        super().__init__(battery, source, name, LinkMonitor(None), LinkMonitor(url))
        self._decoder = BatteryDecoder(battery, source, definitions)
        self._waiting: list[CanItem] = []
        self._waiting_of = 0  # number of the period of what waits
        self._two_senders = TwoSenders(battery.n_cells)
        self._can.bit_rate = source.bit_rate or bit_rate_of(url)

    def feed(self, item: Item) -> Received:
        """Take one item from a link; a measurement follows the last frame of each period."""
        if isinstance(item, LinkChange):
            return self._on_change(item)
        if isinstance(item, CanFault):
            self._can.on_fault(item)
        if not isinstance(item, CanItem) or item.sent:
            return NOTHING_RECEIVED
        self._can.on_can_frame(item.t_mono_ns, len(item.data), is_extended=item.can_id >> 31 != 0)
        period = item.t_mono_ns // self._period_ns
        if not self._waiting or period == self._waiting_of:
            self._waiting_of = period
            self._waiting.append(item)
            return NOTHING_RECEIVED
        self._waiting_of = period
        taken = self._take(item.t_mono_ns)
        self._waiting.append(item)
        events = self._two_senders.events(item.t_wall_ns)
        if taken is None:
            return Received(events=events)
        measurement = self._measurement(taken, item.t_mono_ns, item.t_wall_ns, is_fresh=True)
        return Received(measurement=measurement, events=events)

    @property
    def due_ns(self) -> int | None:
        """Return when the period ends in which frames wait."""
        if not self._waiting:
            return None
        return (self._waiting_of + 1) * self._period_ns

    def measure(self, t_mono_ns: int, t_wall_ns: int) -> Measurement:
        """Return a measurement of this instant; what waited is in it."""
        is_fresh = bool(self._waiting)
        waits = self.due_ns is not None and t_mono_ns < self.due_ns
        measurement = None if waits else self._take(t_mono_ns)
        newest = measurement or self._newest or self._assembler.measure(t_mono_ns)
        return self._measurement(newest, t_mono_ns, t_wall_ns, is_fresh=is_fresh and measurement is not None)

    def _take(self, until_ns: int) -> BatteryMeasurement | None:
        values = self._decoder.decode(frames_of_items(self._waiting)) if self._waiting else {}
        self._waiting = []
        if "voltage" in values:
            self._two_senders.take(values["voltage"])
        return self._take_values(values, until_ns)

    def _measurement(
        self, measured: BatteryMeasurement, t_mono_ns: int, t_wall_ns: int, *, is_fresh: bool
    ) -> Measurement:
        of_one = replace(measured, voltage_v=np.where(self._two_senders.cells, np.nan, measured.voltage_v))
        return super()._measurement(of_one, t_mono_ns, t_wall_ns, is_fresh=is_fresh)

    def _on_change(self, change: LinkChange) -> Received:
        if change.link != "can" or not self._can.on_change(change):
            return NOTHING_RECEIVED
        return link_event(change)


def link_event(change: LinkChange) -> Received:
    """Return the event of a link that opened or was lost."""
    if change.state == "connecting":
        return NOTHING_RECEIVED
    if change.state == "open":
        message = Message("can-open") if change.link == "can" else Message("rs232-open")
        return Received(events=(Event(change.t_wall_ns, "info", message.code, message),))
    message = link_lost(change.link, change.error)
    return Received(events=(Event(change.t_wall_ns, "watch", message.code, message),))


def measurement_of(
    battery: Battery, measured: BatteryMeasurement, t_mono_ns: int, t_wall_ns: int, **more: Any
) -> Measurement:
    """Return what a battery without a master of ours measured, as it is at an instant; `more` are other fields."""
    unknown = np.full(battery.n_cells, np.nan)
    return Measurement(
        t_mono_ns=t_mono_ns,
        t_wall_ns=t_wall_ns,
        uptime_ms=measured.t_ns // 1_000_000,
        current_a=_number(measured.current_a),
        voltage_v=measured.voltage_v,
        temperature_degc=battery.cell_temperatures(measured.temperature_degc),
        resistance_ohm=measured.resistance_ohm,
        capacity_ah=unknown,
        chip_voltage_v=unknown,
        balancing=None if np.isnan(measured.balancing).all() else measured.balancing == 1.0,
        relays_open=measured.states.get("closed") is False,
        slave_status=(None,) * battery.n_packs,
        reported=Reported(
            _number(measured.pack_voltage_v), *(_NO_EXTREME,) * 4, None, voltage_error=PACK_VOLTAGE_ERROR
        ),
        master=_master(measured),
        charger=_charger(measured),
        age_s=_of_parts({part: (t_mono_ns - t_ns) / 1e9 for part, t_ns in measured.newest_ns.items()}),
        disagreements=(),
        limits=_limits(battery, measured.limits),
        config=None,
        config_hash=None,
        voltage_age_s=np.where(np.isfinite(measured.voltage_v), (t_mono_ns - measured.voltage_t_ns) / 1e9, np.nan),
        **more,
    )


def _number(value: float) -> Number:
    return None if np.isnan(value) else value


def _of_parts(seconds: Mapping[str, float]) -> Ages:
    return Ages(**{field.name: seconds.get(field.name) for field in fields(Ages)})


def _master(measured: BatteryMeasurement) -> Master:
    states = [state for name, state in _STATES if measured.states.get(name)]
    state: MasterState = states[0] if states else ("idle" if measured.states.get("closed") is False else "unknown")
    return Master(
        state=state,
        why=Message("bms-state") if state != "unknown" else Message("bms-no-state"),
        fit=None if measured.states.get("fault") is None else not measured.states["fault"],
        flags=None,
        soc=_number(measured.soc),
        charge_drawn_ah=None,
        n_slaves=None,
        can_tx_enabled=None,
        can_rx_enabled=None,
        can_rx_active=None,
        firmware=None,
        protocol=None,
        map_hash=None,
        map_matches=None,
        boots=None,
        restarted=None,
        implausible=(),
    )


def _charger(measured: BatteryMeasurement) -> Charger:
    voltage_v, current_a = _number(measured.charger_voltage_v), _number(measured.charger_current_a)
    return Charger(None, None, None, voltage_v, current_a, None, ())


def _limits(battery: Battery, values: Mapping[str, float]) -> ProtectionLimits | None:
    """What the profile states, or the BMS tells; None where that is nothing."""
    of = {name: values[name] if isinstance(limit, SignalName) else limit for name, limit in battery.limits.items()}
    numbers = dict.fromkeys(LIMITS, np.nan) | {
        name: float(value) for name, value in of.items() if not isinstance(value, SignalName)
    }
    if np.isnan([numbers[name] for name in LIMITS]).all():
        return None
    return ProtectionLimits(
        cell_voltage_min_v=numbers["cell_voltage_min_v"],
        cell_voltage_max_v=numbers["cell_voltage_max_v"],
        temperature_min_degc=numbers["temperature_min_degc"],
        temperature_max_degc=numbers["temperature_max_degc"],
        discharge_max_a=numbers["discharge_current_max_a"],
        discharge_min_a=-numbers["charge_current_max_a"],
        charger_max_a=numbers["charge_current_max_a"],
        charger_min_a=0.0,
        accumulator_voltage_max_v=numbers["pack_voltage_max_v"],
        pack_voltage_max_v=numbers["segment_voltage_max_v"],
        in_any_state=True,
    )
