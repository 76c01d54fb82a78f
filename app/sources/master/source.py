"""The team's master as a source of measurements: shadow of its memory, CAN tables, events, counters of both links.

Everything that knows the master's protocol stands in this folder; a measurement is what leaves it. No I/O.
"""

from dataclasses import replace

from app.battery.battery import Battery
from app.sources.items import CanFault, CanItem, Item, LinkChange, SerialItem, UnframedBytes
from app.sources.links.monitor import LinkMonitor, rs232_monitor
from app.sources.loaded_battery import team_battery
from app.sources.master.agreement import Agreement
from app.sources.master.client import identity_of
from app.sources.master.decode import PARTS, Decoder
from app.sources.master.events import boot_cause, describe, state_of
from app.sources.master.shadow import ShadowImage
from app.sources.master.uptime_clock import UptimeClock
from app.sources.source import NOTHING_RECEIVED, Received
from app.telemetry import BusState, Charger, Event, Identity, Links, Master, Severity, Source
from app.telemetry.events import link_lost
from app.telemetry.measurement import Measurement
from app.words import Message, Quantity
from firmware_protocol.can_tables import TableReader, bit_rate, tx_messages
from firmware_protocol.config_image import default_image, image_hash
from firmware_protocol.errors import DecodeError
from firmware_protocol.framing import BadFrame
from firmware_protocol.memory_map import CAN_ID_EXTENDED, CONFIG, CONFIG_SIZE
from firmware_protocol.messages import Data, EventCode, EventMessage, Ident, MessageType, Reply, decode_message
from firmware_protocol.older_maps import fields_of, present_image

VOLTAGE_OFFSET = PARTS["voltage"][0]
CAN_SNAPSHOT_NS = 50_000_000
CAN_ERRORS_NS = 5_000_000_000  # between two events of error frames on the CAN bus
CAN_ERRORS_LEAST = 5  # in that time
EVENT_INTERVAL_NS = 60 * 10**9  # at least, between two events of one kind of what is wrong on the line
UPTIME_WRAP_MS = 1 << 32
RESTART_SHOWN_NS = 60 * 10**9  # a restart is shown for so long
MAX_STEP_S = 3600.0
WARM_RESETS = (1, 2, 3)  # causes of a boot in which the accumulator and the master stay together: not power on
_BUS_STATES: dict[BusState, tuple[Severity, Message]] = {
    "active": ("info", Message("can-active")),
    "warning": ("watch", Message("can-warning")),
    "passive": ("warning", Message("can-bus-passive")),
    "off": ("warning", Message("can-bus-off")),
}


class MasterSource:
    """One master behind RS232, CAN or both. Called from one thread."""

    def __init__(self, name: Source, rs232_url: str | None = None, can_url: str | None = None) -> None:
        self.name: Source = name
        self.due_ns: int | None = None  # every item is measured at once
        self.battery: Battery = team_battery().battery
        self.identity: Identity | None = None
        self._recorded_map: str | None = None  # map of a recording, until it holds the master's IDENT
        self._malformed = 0  # frames with an impossible body
        self._last_event_ns: dict[str, int] = {}
        self._shadow = ShadowImage()
        self._rs232, self._can = rs232_monitor(rs232_url), LinkMonitor(can_url)
        self._agreement = Agreement()
        self._uptime_ms: int | None = None
        self._uptime_clock = UptimeClock()
        self._restart: tuple[int, Message] | None = None  # when and why
        self._booted: int | None = None  # the cause of a boot since the last measurement
        self._last_can_snapshot_ns = 0
        self._can_errors = (0, 0)  # when last looked at, and how many there were
        self._last_trip: Message | None = None
        self._config: tuple[bytes, str] | None = None
        self._config_from_ns = 0  # bytes measured before are of an older configuration
        self._use_can_tables(default_image())

    def feed(self, item: Item) -> Received:
        """Take one item from a link."""
        if isinstance(item, SerialItem):
            return self._on_serial(item)
        if isinstance(item, UnframedBytes):
            return self._on_unframed(item)
        if isinstance(item, CanItem):
            return self._on_can(item)
        if isinstance(item, CanFault):
            return self._on_fault(item)
        return self._on_change(item) if isinstance(item, LinkChange) else NOTHING_RECEIVED

    def measure(self, t_mono_ns: int, t_wall_ns: int) -> Measurement:
        """Return a measurement in which nothing is new but the ages."""
        return self._measurement(t_mono_ns, t_wall_ns, is_fresh=False)

    def _on_change(self, change: LinkChange) -> Received:
        self._recorded_map = change.map_hash or self._recorded_map
        is_news = {"rs232": self._rs232, "can": self._can}[change.link].on_change(change)
        if change.state == "connecting" or not is_news:
            return NOTHING_RECEIVED
        severity: Severity = "watch"
        message = link_lost(change.link, change.error)
        if change.state == "open":
            severity, message = "info", Message("rs232-open") if change.link == "rs232" else Message("can-open")
        event = Event(change.t_wall_ns, severity, message.code, message)
        return Received(events=(event,))

    def _on_fault(self, fault: CanFault) -> Received:
        is_news = self._can.on_fault(fault)
        if not is_news or fault.bus_state is None:
            return self._on_error_frames(fault)
        severity, message = _BUS_STATES[fault.bus_state]
        if fault.errors is not None:
            message = Message("with-errors", what=message, n=fault.errors)
        event = Event(fault.t_wall_ns, severity, f"can-{fault.bus_state}", message)
        return Received(events=(event,))

    def _on_error_frames(self, fault: CanFault) -> Received:
        """Report error frames at most every CAN_ERRORS_NS, and single ones not at all."""
        counted_ns, counted = self._can_errors
        errors = fault.errors or 0
        if errors < counted:
            self._can_errors = fault.t_mono_ns, errors
        new, waited_ns = errors - counted, fault.t_mono_ns - counted_ns
        if waited_ns < CAN_ERRORS_NS:
            return NOTHING_RECEIVED
        self._can_errors = fault.t_mono_ns, errors
        if new < CAN_ERRORS_LEAST or waited_ns > 2 * CAN_ERRORS_NS:
            return NOTHING_RECEIVED
        message = Message("can-error-frames", n=new, time=Quantity(waited_ns / 1e9, "s", 0))
        return Received(events=(Event(fault.t_wall_ns, "watch", message.code, message),))

    def _on_serial(self, item: SerialItem) -> Received:
        if isinstance(item.frame, BadFrame):
            self._rs232.on_frame(item.t_mono_ns, item.frame)
            return NOTHING_RECEIVED
        identity: Identity | None = None
        try:
            message = decode_message(item.frame)
            if isinstance(message, Reply) and message.request_type == MessageType.IDENT and not message.result:
                identity = identity_of(Ident.from_bytes(message.data))
        except DecodeError:
            self._rs232.on_malformed(item.t_mono_ns, item.frame)
            self._malformed += 1
            return self._rate_limited_event(item, "malformed", Message("frames-malformed", n=self._malformed))
        uptime_ms = item.frame.uptime_ms
        measured_ns = self._uptime_clock.measured_ns(uptime_ms, item.t_mono_ns, item.waited_max_ns)
        self._rs232.on_frame(item.t_mono_ns, item.frame, measured_ns)
        if isinstance(message, Data):
            return self._on_data(item, message, uptime_ms, measured_ns)
        if isinstance(message, EventMessage):
            if message.code in (EventCode.CONFIG_WRITTEN, EventCode.BOOT):
                self._config_from_ns = measured_ns
            if message.code == EventCode.BOOT and self._uptime_ms is not None:  # else it is the first one received
                self._restart = item.t_mono_ns, boot_cause(message)
                self._booted = message.value
            event, trip = describe(message, item.t_wall_ns)
            if trip is not None or message.code == EventCode.FAULTS_CLEARED:
                self._last_trip = trip
            return Received(events=(event,))
        if identity is None or identity == self.identity:
            return NOTHING_RECEIVED
        if not item.is_asked:
            unasked = Message("ident-unasked", map_hash=identity.map_hash)
            return self._rate_limited_event(item, "unasked", unasked)
        self.identity = identity
        return NOTHING_RECEIVED

    def _on_unframed(self, item: UnframedBytes) -> Received:
        self._rs232.on_unframed(item)
        rate = self._rs232.status(item.t_mono_ns).bytes_per_s
        return self._rate_limited_event(item, "unframed", Message("rs232-unframed", n=round(rate)))

    def _rate_limited_event(self, item: SerialItem | UnframedBytes, kind: str, message: Message) -> Received:
        """What is wrong on the line, as an event; of one kind at most one every EVENT_INTERVAL_NS."""
        last_ns = self._last_event_ns.get(kind)
        if last_ns is not None and item.t_mono_ns - last_ns < EVENT_INTERVAL_NS:
            return NOTHING_RECEIVED
        self._last_event_ns[kind] = item.t_mono_ns
        return Received(events=(Event(item.t_wall_ns, "watch", message.code, message),))

    def _on_data(self, item: SerialItem, data: Data, uptime_ms: int, measured_ns: int) -> Received:
        self._shadow.write(data.windows, measured_ns)
        self._agreement.on_rs232(self._shadow, measured_ns)
        if not any(w.offset <= VOLTAGE_OFFSET < w.offset + len(w.data) for w in data.windows):
            return NOTHING_RECEIVED
        self._rs232.on_snapshot(item.t_mono_ns)
        before_ms = self._uptime_ms
        dt_s = self._dt_s(uptime_ms)
        is_reset = before_ms is not None and 0 < before_ms - uptime_ms < UPTIME_WRAP_MS // 2
        if is_reset and self._restarted(item.t_mono_ns) is None:
            self._restart = item.t_mono_ns, Message("boot-cause-unknown")
        was_off = is_reset if self._booted is None else self._booted not in WARM_RESETS
        self._booted = None
        measurement = self._measurement(item.t_mono_ns, item.t_wall_ns, dt_s=dt_s, is_sample=True)
        return Received(replace(measurement, was_off=was_off))

    def _restarted(self, t_mono_ns: int) -> Message | None:
        """Why the master restarted, for RESTART_SHOWN_NS."""
        if self._restart is None or t_mono_ns - self._restart[0] > RESTART_SHOWN_NS:
            return None
        return self._restart[1]

    def _dt_s(self, uptime_ms: int) -> float | None:
        """Seconds by the master's clock since the last measurement; None at the first one and after a reset."""
        before, self._uptime_ms = self._uptime_ms, uptime_ms
        if before is None:
            return None
        dt_s = ((uptime_ms - before) % UPTIME_WRAP_MS) / 1000
        return dt_s if dt_s <= MAX_STEP_S else None

    def _on_can(self, item: CanItem) -> Received:
        self._can.on_can_frame(item.t_mono_ns, len(item.data), is_extended=bool(item.can_id & CAN_ID_EXTENDED))
        if item.sent:
            return NOTHING_RECEIVED
        windows = self._can_tables.windows(item.can_id, item.data)
        if not windows:
            return NOTHING_RECEIVED
        if self._rs232.is_live(item.t_mono_ns):  # it carries the same memory, sampled together
            self._agreement.on_can(windows, item.t_mono_ns)
            return NOTHING_RECEIVED
        self._shadow.write_whole_elements(windows, item.t_mono_ns)
        if item.t_mono_ns - self._last_can_snapshot_ns < CAN_SNAPSHOT_NS:
            return NOTHING_RECEIVED
        self._last_can_snapshot_ns = item.t_mono_ns
        return Received(self._measurement(item.t_mono_ns, item.t_wall_ns))

    def _use_can_tables(self, image: bytes) -> None:
        """Decode CAN by the tables of a configuration image."""
        self._can_tables = TableReader(image)
        self._agreement.watch(tx_messages(image))
        self._can.bit_rate = bit_rate(CONFIG["can_brp"].unpack(image)[0])

    def _config_in_force(self) -> tuple[bytes, str] | None:
        """Image and hash as last received as a whole: never the pieces of two configurations."""
        if int(self._shadow.measured_ns[:CONFIG_SIZE].min()) < self._config_from_ns:
            return self._config
        image = present_image(self._shadow.image[:CONFIG_SIZE])
        if self._config is None or self._config[0] != image:
            self._config = image, image_hash(image)
            self._use_can_tables(image)
        return self._config

    def _measurement(
        self,
        t_mono_ns: int,
        t_wall_ns: int,
        *,
        dt_s: float | None = None,
        is_sample: bool = False,
        is_fresh: bool = True,
    ) -> Measurement:
        decoder = Decoder(self._shadow, t_mono_ns)
        charger = decoder.charger()
        config = self._config_in_force()
        age_s = decoder.ages()
        return Measurement(
            t_mono_ns=t_mono_ns,
            t_wall_ns=t_wall_ns,
            uptime_ms=self._uptime_ms,
            dt_s=dt_s,
            is_sample=is_sample,
            is_fresh=is_fresh,
            current_a=decoder.number("i_fs"),
            voltage_v=decoder.voltages_v(),
            temperature_degc=decoder.temperatures_degc(),
            resistance_ohm=decoder.array("r_fs", (0,)),
            capacity_ah=decoder.array("c", (0,)),
            chip_voltage_v=decoder.chip_voltages_v(),
            balancing=decoder.balancing(),
            relays_open=decoder.relays_open(),
            slave_status=decoder.slave_status(),
            reported=decoder.reported(),
            master=self._master(decoder, charger, t_mono_ns),
            charger=charger,
            age_s=age_s,
            links=self._links(t_mono_ns),
            disagreements=self._agreement.disagreements(t_mono_ns),
            limits=None if age_s.config is None else decoder.limits(),
            config=config and config[0],
            config_hash=config and config[1],
        )

    def _master(self, decoder: Decoder, charger: Charger, t_mono_ns: int) -> Master:
        flags = decoder.flags()
        state, why = state_of(flags, charger.state, self._last_trip)
        identity = self.identity
        map_hash = self._recorded_map if identity is None else identity.map_hash
        soc, drawn_ah = decoder.number("soc"), decoder.number("dod", fields_of(map_hash))
        if soc == 0.0 and drawn_ah == 0.0:  # empty and full: the count has not begun
            soc = drawn_ah = None
        return Master(
            state=state,
            why=why,
            fit=None if flags is None else flags.fit,
            flags=flags,
            soc=soc,
            charge_drawn_ah=drawn_ah,
            n_slaves=decoder.integer("n_slaves"),
            can_tx_enabled=decoder.integer("status.can_tx_msg_en"),
            can_rx_enabled=decoder.integer("status.can_rx_msg_en"),
            can_rx_active=decoder.integer("status.can_rx_msg_active"),
            firmware=None if identity is None else identity.firmware,
            protocol=None if identity is None else identity.protocol,
            map_hash=None if identity is None else identity.map_hash,
            map_matches=None if identity is None else identity.is_compatible,
            boots=None if identity is None else identity.boots,
            restarted=self._restarted(t_mono_ns),
            implausible=decoder.implausible(),
        )

    def _links(self, t_mono_ns: int) -> Links:
        """Both links; a CAN controller drops bad frames itself and does not count them."""
        can = self._can.status(t_mono_ns)
        return Links(self._rs232.status(t_mono_ns), replace(can, crc_errors=None, resyncs=None))
