"""Items in, snapshots out: shadow, estimator, watch, in one place and one order. No I/O; time comes with items.

Replaying recorded items through a fresh Pipeline gives the same snapshots again.
"""

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from app.estimation.errors import EstimatorError
from app.estimation.filters.estimators import CellEstimator, Estimates
from app.estimation.prediction.driver_soc import DriverSoc
from app.estimation.prediction.power import Limits
from app.live.accumulator import accumulator_of, state_of
from app.live.alarms import Watch
from app.live.cells import cells_of, packs_of
from app.live.plausibility import PlausibilityChecks
from app.live.prediction import Lookout, Outlook
from app.sources.links.monitor import LIVE_S, LinkMonitor, rs232_monitor
from app.sources.master.agreement import Agreement
from app.sources.master.decode import PARTS, Decoder
from app.sources.master.events import describe
from app.sources.master.shadow import ShadowImage
from app.telemetry import (
    CanFault,
    CanItem,
    Estimator,
    Event,
    FloatArray,
    Identity,
    Item,
    LinkChange,
    Links,
    Master,
    SerialItem,
    Snapshot,
    Source,
)
from firmware_protocol.can_tables import TableReader, bit_rate, tx_messages
from firmware_protocol.config_image import default_image, image_hash
from firmware_protocol.errors import DecodeError
from firmware_protocol.framing import BadFrame, Frame
from firmware_protocol.memory_map import CAN_ID_EXTENDED, CONFIG, CONFIG_SIZE, N_CELLS
from firmware_protocol.messages import Data, EventCode, Ident, MessageType, Reply, decode_message
from firmware_protocol.messages import Event as MasterEvent

VOLTAGE_OFFSET = PARTS["voltage"][0]
CAN_SNAPSHOT_NS = 50_000_000
UPTIME_WRAP_MS = 1 << 32
MAX_STEP_S = 3600.0
MIN_CURRENT_LIMIT_A = 1.0
MAX_ENERGY_STEP_S = 10.0  # what flowed in a longer gap is not known, and not made up
_BUS_STATES = {
    "active": ("info", "CAN bus is well again"),
    "warning": ("watch", "CAN bus with many errors"),
    "passive": ("warning", "CAN controller error-passive"),
    "off": ("warning", "CAN controller off the bus"),
}


@dataclass(frozen=True, slots=True)
class Output:
    """What one item led to."""

    snapshot: Snapshot | None = None
    events: tuple[Event, ...] = ()
    reply: Reply | None = None
    estimates: Estimates | None = None  # where this item made the estimator step
    uptime_ms: int = 0


class Pipeline:
    """One source's chain. `feed` and `tick` are called from one thread; `acknowledge` from any."""

    def __init__(
        self,
        source: Source,
        make_estimator: Callable[[], CellEstimator],
        *,
        filter_name: str,
        cell_name: str,
        rs232_url: str | None = None,
        can_url: str | None = None,
        stopwatch_ns: Callable[[], int] | None = None,
        lookout: Lookout | None = None,
        start_soc: tuple[FloatArray, FloatArray] | None = None,
    ) -> None:
        self.source = source
        self.shadow = ShadowImage()
        self.identity: Identity | None = None
        self._make_estimator = make_estimator
        self._estimator: CellEstimator | None = None
        self._spare: CellEstimator | None = None
        self._skipped = 0  # measurements without a current, without any voltage, or on which the estimator failed
        self.filter_name, self.cell_name = filter_name, cell_name
        self._monitors = {"rs232": rs232_monitor(rs232_url), "can": LinkMonitor(can_url)}
        self._watch = Watch()
        self._watch_lock = threading.Lock()
        self._driver = DriverSoc(N_CELLS)
        self._plausibility = PlausibilityChecks()
        self._estimates: Estimates | None = None
        self._uptime_ms: int | None = None
        self._last_can_snapshot_ns = 0
        self._last_trip: str | None = None
        self._sequence = 0
        self._driver_percent: int | None = None
        self._energy_out_wh = self._energy_in_wh = 0.0
        self._stopwatch_ns = stopwatch_ns
        self._lookout = lookout
        self._start_soc = start_soc  # (soc, sigma) of an earlier run
        self._measured: tuple[float, FloatArray] | None = None  # current and temperatures the lookout has not seen
        self._step_us: float | None = None
        self._config: tuple[bytes, str] | None = None
        self._config_from_ns = 0  # bytes that arrived before are of an older configuration
        self._estimator_error: str | None = None
        self._agreement = Agreement()
        self.use_can_tables(default_image())

    def warm_up(self) -> None:
        """Make the estimator before it is needed: compiling it takes longer than frames can wait. From any thread."""
        self._spare = self._make_estimator()

    def feed(self, item: Item) -> Output:
        """Take one item from a link."""
        if isinstance(item, SerialItem):
            return self._on_serial(item)
        if isinstance(item, CanItem):
            return self._on_can(item)
        if isinstance(item, CanFault):
            return self._on_fault(item)
        return self._on_change(item)

    def tick(self, t_mono_ns: int, t_wall_ns: int) -> Output:
        """Return a snapshot in which nothing is new but the ages."""
        return self._publish(t_mono_ns, t_wall_ns, fresh=False)

    @property
    def estimates(self) -> Estimates | None:
        """The estimator's latest."""
        return self._estimates

    def look_ahead(self) -> None:
        """Judge what lies ahead, for the next snapshot; call it when the last one has gone out."""
        if self._lookout is None or self._measured is None or self._estimator is None or self._estimates is None:
            return
        current_a, temperatures_degc = self._measured
        self._measured = None
        self._lookout.look(self._estimator, self._estimates, temperatures_degc, current_a, self._limits())
        self._lookout.teach(self._estimator)

    def _limits(self) -> Limits:
        """The configuration's, the cell's own where none was heard."""
        if self._config is None:
            return Limits()

        def limit(name: str) -> float:
            field = CONFIG[name]
            return float(field.unpack(self.shadow.image)[0] * field.scale)

        return Limits(
            v_min_v=limit("v_cell_min"),
            v_max_v=limit("v_cell_max"),
            discharge_max_a=max(limit("i_disc_max"), MIN_CURRENT_LIMIT_A),
            charge_max_a=max(-limit("i_disc_min"), MIN_CURRENT_LIMIT_A),
            temperature_max_degc=limit("t_cell_max"),
        )

    def acknowledge(self, alarm_id: int, who: str) -> bool:
        """Mark an alarm as seen."""
        with self._watch_lock:
            return self._watch.acknowledge(alarm_id, who)

    def _on_change(self, change: LinkChange) -> Output:
        is_news = self._monitors[change.link].on_change(change)
        label = {"rs232": "RS232", "can": "CAN"}[change.link]
        if change.state == "connecting" or not is_news:
            return Output()
        severity, text = (
            ("info", f"{label} open") if change.state == "open" else ("watch", f"{label} lost: {change.error}")
        )
        event = Event(change.t_wall_ns, severity, f"{change.link}-{change.state}", text)  # type: ignore[arg-type]
        return Output(events=(event,))

    def _on_fault(self, fault: CanFault) -> Output:
        if not self._monitors["can"].on_fault(fault) or fault.bus_state is None:
            return Output()
        severity, text = _BUS_STATES[fault.bus_state]
        errors = "" if fault.errors is None else f" ({fault.errors} errors)"
        event = Event(fault.t_wall_ns, severity, f"can-{fault.bus_state}", f"{text}{errors}")  # type: ignore[arg-type]
        return Output(events=(event,))

    def _on_serial(self, item: SerialItem) -> Output:
        self._monitors["rs232"].on_frame(item.t_mono_ns, item.frame)
        if isinstance(item.frame, BadFrame):
            return Output()
        try:
            message = decode_message(item.frame)
        except DecodeError:
            return Output()
        if isinstance(message, Data):
            self.shadow.write(message.windows, item.t_mono_ns)
            self._agreement.on_rs232(self.shadow, item.t_mono_ns)
            if any(w.offset <= VOLTAGE_OFFSET < w.offset + len(w.data) for w in message.windows):
                self._monitors["rs232"].on_snapshot(item.t_mono_ns)
                return self._on_measurement(item, item.frame)
            return Output()
        if isinstance(message, MasterEvent):
            if message.code in (EventCode.CONFIG_WRITTEN, EventCode.BOOT):
                self._config_from_ns = item.t_mono_ns
            event, trip = describe(message, item.t_wall_ns)
            self._last_trip = trip if trip is not None else self._last_trip
            return Output(events=(event,))
        if message.request_type == MessageType.IDENT:
            self._identify(message)
        return Output(reply=message)

    def _identify(self, reply: Reply) -> None:
        try:
            ident = Ident.from_bytes(reply.data)
        except DecodeError:
            return
        self.identity = Identity(
            ".".join(map(str, ident.firmware)), ident.protocol, ident.map_hash.hex(), ident.is_compatible, ident.boots
        )

    def _on_measurement(self, item: SerialItem, frame: Frame) -> Output:
        dt_s = self._dt_s(frame.uptime_ms)
        decoder = Decoder(self.shadow, item.t_mono_ns)
        current_a = decoder.number("i_fs")
        voltages_v = decoder.voltages_v()
        estimates: Estimates | None = None
        events: tuple[Event, ...] = ()
        if current_a is not None and not np.isnan(voltages_v).all():
            true_a = current_a if self._lookout is None else current_a - self._lookout.offset_a
            estimates, events = self._estimate(item, dt_s, true_a, voltages_v, decoder.temperatures_degc())
            power_w = float(np.nansum(voltages_v)) * current_a
            self._plausibility.step(dt_s, current_a, voltages_v, decoder)
            if self._lookout is not None:
                self._lookout.step(dt_s, current_a, voltages_v, power_w, estimates, decoder.relays_open())
                self._measured = current_a, decoder.temperatures_degc()
            if dt_s is not None and dt_s <= MAX_ENERGY_STEP_S:
                self._energy_out_wh += max(power_w, 0.0) * dt_s / 3600
                self._energy_in_wh += max(-power_w, 0.0) * dt_s / 3600
        self._skipped += estimates is None
        output = self._publish(item.t_mono_ns, item.t_wall_ns, fresh=True)
        return Output(output.snapshot, events + output.events, None, estimates, frame.uptime_ms)

    def _dt_s(self, uptime_ms: int) -> float | None:
        """Seconds by the master's clock since the last measurement; None at the first one and after a reset."""
        before, self._uptime_ms = self._uptime_ms, uptime_ms
        if before is None:
            return None
        dt_s = ((uptime_ms - before) % UPTIME_WRAP_MS) / 1000
        return dt_s if dt_s <= MAX_STEP_S else None

    def _estimate(
        self, item: SerialItem, dt_s: float | None, current_a: float, voltages_v: FloatArray, degc: FloatArray
    ) -> tuple[Estimates | None, tuple[Event, ...]]:
        """Step the estimator; one that fails is begun anew at the next measurement, which is told once."""
        started_ns = self._stopwatch_ns() if self._stopwatch_ns else 0
        try:
            if self._estimator is None:
                estimator, self._spare = self._spare or self._make_estimator(), None
                if self._lookout is not None:
                    self._lookout.teach(estimator)
                _start(estimator, voltages_v, degc, current_a, self._start_soc)
                self._estimator, dt_s = estimator, 0.0
            self._estimates = self._estimator.step(dt_s or 0.0, current_a, voltages_v, degc)
        except (EstimatorError, ArithmeticError, ValueError) as error:
            self._estimator = self._estimates = None
            is_news, self._estimator_error = self._estimator_error is None, str(error)
            text = f"the estimator failed and begins anew: {error}"
            event = Event(item.t_wall_ns, "warning", "estimator-failed", text)
            return None, (event,) if is_news else ()
        self._estimator_error = None
        self._driver_percent = self._driver.step(self._estimates.soc).percent
        if self._stopwatch_ns and dt_s:
            took_us = (self._stopwatch_ns() - started_ns) / 1000
            self._step_us = took_us if self._step_us is None else self._step_us + 0.02 * (took_us - self._step_us)
        return self._estimates, ()

    def _on_can(self, item: CanItem) -> Output:
        monitor = self._monitors["can"]
        monitor.on_can_frame(item.t_mono_ns, len(item.data), is_extended=bool(item.can_id & CAN_ID_EXTENDED))
        if item.sent:
            return Output()
        windows = self._can_tables.windows(item.can_id, item.data)
        if not windows:
            return Output()
        if self._monitors["rs232"].is_live(item.t_mono_ns):  # it carries the same memory, sampled together
            self._agreement.on_can(windows, item.t_mono_ns)
            return Output()
        self.shadow.write_whole_elements(windows, item.t_mono_ns)
        if item.t_mono_ns - self._last_can_snapshot_ns < CAN_SNAPSHOT_NS:
            return Output()
        self._last_can_snapshot_ns = item.t_mono_ns
        return self._publish(item.t_mono_ns, item.t_wall_ns, fresh=True)

    def use_can_tables(self, image: bytes) -> None:
        """Decode CAN by the tables of a configuration image."""
        self._can_tables = TableReader(image)
        self._agreement.watch(tx_messages(image))
        self._monitors["can"].bit_rate = bit_rate(CONFIG["can_brp"].unpack(image)[0])

    def _config_in_force(self) -> tuple[bytes, str] | None:
        """Image and hash as last heard as a whole: never the pieces of two configurations."""
        if int(self.shadow.arrived_ns[:CONFIG_SIZE].min()) < self._config_from_ns:
            return self._config
        image = bytes(self.shadow.image[:CONFIG_SIZE])
        if self._config is None or self._config[0] != image:
            self._config = image, image_hash(image)
            self.use_can_tables(image)
        return self._config

    def _publish(self, t_mono_ns: int, t_wall_ns: int, *, fresh: bool) -> Output:
        decoder = Decoder(self.shadow, t_mono_ns)
        age_s = decoder.ages()
        estimates = self._estimates if age_s.voltage is not None and age_s.voltage <= LIVE_S * 10 else None
        outlook = self._lookout.outlook if self._lookout is not None and estimates is not None else Outlook()
        cells = cells_of(decoder, estimates, outlook)
        charger = decoder.charger()
        flags = decoder.flags()
        state, why = state_of(flags, charger.state, self._last_trip)
        identity, config = self.identity, self._config_in_force()
        self._sequence += 1
        snapshot = Snapshot(
            sequence=self._sequence,
            t_mono_ns=t_mono_ns,
            t_wall_ns=t_wall_ns,
            uptime_s=None if self._uptime_ms is None else self._uptime_ms / 1000,
            source=self.source,
            image=bytes(self.shadow.image),
            age_s=age_s,
            cells=cells,
            accumulator=accumulator_of(cells, decoder, self._driver_percent, self._energy_out_wh, self._energy_in_wh),
            packs=packs_of(cells, decoder),
            prediction=outlook.prediction,
            master=Master(
                state=state,
                why=why,
                fit=None if flags is None else flags.fit,
                flags=flags,
                soc=decoder.number("soc"),
                charge_drawn_ah=decoder.number("dod"),
                n_slaves=decoder.integer("n_slaves"),
                can_tx_enabled=decoder.integer("status.can_tx_msg_en"),
                can_rx_enabled=decoder.integer("status.can_rx_msg_en"),
                can_rx_active=decoder.integer("status.can_rx_msg_active"),
                firmware=None if identity is None else identity.firmware,
                protocol=None if identity is None else identity.protocol,
                map_hash=None if identity is None else identity.map_hash,
                map_matches=None if identity is None else identity.is_compatible,
                boots=None if identity is None else identity.boots,
            ),
            charger=charger,
            links=self._links(t_mono_ns),
            estimator=self._estimator_state(),
            plausibility=self._plausibility.verdicts(cells, decoder),
            config=config and config[0],
            config_hash=config and config[1],
            disagreements=self._agreement.disagreements(t_mono_ns),
            is_fresh=fresh,
        )
        with self._watch_lock:
            alarms, events = self._watch.step(snapshot)
        return Output(replace(snapshot, alarms=alarms), tuple(events))

    def _links(self, t_mono_ns: int) -> Links:
        """Both links; a CAN controller sorts bad frames out by itself and does not tell how many."""
        can = self._monitors["can"].status(t_mono_ns)
        return Links(self._monitors["rs232"].status(t_mono_ns), replace(can, crc_errors=None, resyncs=None))

    def _estimator_state(self) -> Estimator:
        sensor = None if self._lookout is None else self._lookout.sensor
        return Estimator(
            filter=self.filter_name,
            cell=self.cell_name,
            step_us=self._step_us,
            started=self._estimator is not None,
            skipped=self._skipped,
            current_offset_a=sensor.offset_a if sensor is not None and sensor.is_observed else None,
            current_offset_sigma_a=None if sensor is None else sensor.sigma_a,
        )


def _start(
    estimator: CellEstimator,
    voltages_v: FloatArray,
    degc: FloatArray,
    current_a: float,
    known: tuple[FloatArray, FloatArray] | None,
) -> None:
    """Start from the voltages, and where an earlier run's charge agrees with them within 3 sigma, from that."""
    estimator.start(voltages_v, degc, current_a)
    if known is None:
        return
    soc, sigma = known
    by_voltage, variance = estimator.state_mean[0], estimator.state_cov[:, 0, 0]
    agrees = np.abs(soc - by_voltage) < 3.0 * np.sqrt(variance + sigma**2)
    estimator.start(voltages_v, degc, current_a, np.where(agrees, soc, np.nan), sigma)
