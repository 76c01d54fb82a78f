"""The running service: links, one pipeline thread, recorder, event log, hub. Started and stopped by main.create_app."""

import contextlib
import logging
import queue
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from app.configuration import Configuration
from app.errors import AppError, ConfigError, LinkLost
from app.estimation.cellfile import load_cell
from app.estimation.errors import EstimatorError
from app.estimation.estimators import CellEstimator, make_estimator
from app.history import History
from app.hub import Hub
from app.links.can import CanLink
from app.links.master import MasterClient
from app.links.serial import SerialLink
from app.operations import Operator
from app.pipeline import Output, Pipeline
from app.recording import AutoRecorder
from app.replaying import Replaying
from app.sessions.catalogue import Catalogue
from app.sessions.eventlog import EventLog
from app.settings import Settings
from app.telemetry import CanItem, Event, Item, SerialItem, Snapshot, Source
from app.trace import CanTrace
from firmware_protocol.config_image import image_hash
from firmware_protocol.framing import BadFrame
from firmware_protocol.memory_map import CONFIG_SIZE, N_CELLS
from firmware_protocol.messages import EventCode, MessageType

log = logging.getLogger(__name__)
TICK_S = 1.0


class Runtime:
    """Owns every thread of the service but the web server's."""

    def __init__(self, settings: Settings, *, serial_url: str | None, can_url: str | None, source: Source) -> None:
        self.settings = settings
        self.source = source
        self.started_at = time.monotonic()
        self.hub: Hub[Snapshot] = Hub()
        self.history = History()
        self.trace = CanTrace()
        settings.data.mkdir(parents=True, exist_ok=True)
        self.events = EventLog(settings.data / "events.sqlite")
        self.catalogue = Catalogue(settings.data / "sessions")
        self.recorder = AutoRecorder(settings.data / "sessions", automatic=settings.record, on_event=self.log_event)
        self._inbox: queue.SimpleQueue[Item | None] = queue.SimpleQueue()
        try:
            cell = load_cell(settings.cell)
        except EstimatorError as error:
            raise ConfigError("cell", settings.cell, str(error)) from error

        def new_estimator() -> CellEstimator:
            return make_estimator(settings.filter, cell, N_CELLS)

        self._new_estimator: Callable[[], CellEstimator] = new_estimator
        self.pipeline = self.new_pipeline(source, serial_url, can_url)
        self.serial = SerialLink(serial_url, self._inbox.put) if serial_url else None
        self.can = CanLink(can_url, self._inbox.put) if can_url else None
        self.master = MasterClient(self._send)
        self.configuration = Configuration(self.master, lambda: self.pipeline.identity)
        self.operator = Operator(self.configuration, self.master, self.serial, self.note)
        self.replaying = Replaying(self.new_pipeline, self._show)
        self._jobs = ThreadPoolExecutor(max_workers=1, thread_name_prefix="greet")
        self._thread = threading.Thread(target=self._run, name="pipeline", daemon=True)
        self._greeted = False
        self._stopped = threading.Event()
        self.pipeline_snapshot: Snapshot | None = None  # of the live source, also while a replay is shown

    def new_pipeline(self, source: Source, serial_url: str | None = None, can_url: str | None = None) -> Pipeline:
        """A fresh chain with the configured estimator."""
        settings = self.settings
        return Pipeline(
            source,
            self._new_estimator,
            filter_name=settings.filter,
            cell_name=settings.cell,
            rs232_url=serial_url,
            can_url=can_url,
            stopwatch_ns=time.perf_counter_ns,
        )

    def start(self) -> None:
        """Start the threads, then open the links."""
        self._thread.start()
        for link in (self.serial, self.can):
            if link is not None:
                link.start()

    def stop(self) -> None:
        """Close the links, drain, close the recording: in this order."""
        self.replaying.stop()
        for link in (self.serial, self.can):
            if link is not None:
                link.stop()
        self._stopped.set()
        self._inbox.put(None)
        self._thread.join(timeout=5.0)
        self._jobs.shutdown(wait=True, cancel_futures=True)
        self.recorder.close()
        self.events.close()

    def log_event(self, event: Event) -> None:
        """Put an event into the log and into the recording."""
        self.events.append(
            event.severity,
            event.code,
            event.text,
            cell=event.cell,
            value=event.value,
            limit=event.limit,
            unit=event.unit,
            who=event.who,
            t_wall_ns=event.time_ns,
        )
        self.recorder.on_event(event)

    def note(self, severity: str, code: str, text: str, who: str | None = None) -> None:
        """Log something that the service or a user did."""
        self.log_event(Event(time.time_ns(), severity, code, text, who=who))  # type: ignore[arg-type]

    def latest(self) -> Snapshot | None:
        """The newest snapshot, of the replay while one runs."""
        return self.hub.latest

    def _send(self, data: bytes) -> None:
        if self.serial is None:
            raise LinkLost("no RS232 port is configured")
        self.serial.write(data)

    def _run(self) -> None:
        published_ns = 0
        while True:
            try:
                item = self._inbox.get(timeout=TICK_S / 4)
            except queue.Empty:
                item = None
                if self._stopped.is_set():
                    return
            else:
                if item is None:
                    return
            try:
                if item is not None:
                    published_ns = self._take(item) or published_ns
                now_ns = time.monotonic_ns()
                if now_ns - published_ns >= TICK_S * 1e9:
                    published_ns = now_ns
                    self._deliver(self.pipeline.tick(now_ns, time.time_ns()))
            except Exception:
                log.exception("the pipeline failed on one item and goes on")

    def _take(self, item: Item) -> int | None:
        self.recorder.on_item(item)
        if isinstance(item, CanItem):
            self.trace.add(item)
        output = self.pipeline.feed(item)
        self._deliver(output)
        if output.reply is not None:
            self.master.on_reply(output.reply)
        if isinstance(item, SerialItem) and not isinstance(item.frame, BadFrame):
            self._greet_if_new(item.frame.type, item.frame.body)
        elif not isinstance(item, SerialItem | CanItem) and item.link == "rs232" and item.state != "open":
            self._greeted = False
        return item.t_mono_ns if output.snapshot is not None else None

    def _deliver(self, output: Output) -> None:
        for event in output.events:
            self.log_event(event)
        if output.snapshot is None:
            return
        self.pipeline_snapshot = output.snapshot
        self.recorder.on_output(output)
        self.history.add(output.snapshot)
        if not self.replaying.is_active:
            self._show(output.snapshot)

    def _show(self, snapshot: Snapshot) -> None:
        self.hub.publish_threadsafe(snapshot)

    def _greet_if_new(self, frame_type: int, body: bytes) -> None:
        """Ask a master that appeared, or started again, who it is and what it has stored."""
        if frame_type == MessageType.EVENT and body[:1] in (
            bytes([EventCode.BOOT]),
            bytes([EventCode.CONFIG_STORED]),
        ):
            self._greeted = False
        if not self._greeted:
            self._greeted = True
            with contextlib.suppress(RuntimeError):  # shutting down
                self._jobs.submit(self._greet)

    def _greet(self) -> None:
        try:
            self.master.identify()
            self.configuration.read_stored()
        except AppError as error:
            log.info("the master did not introduce itself: %s", error)
            self._greeted = False

    def service_state(self) -> dict[str, Any]:
        """What a snapshot is sent with that is the service's, not the battery's."""
        session = self.recorder.session
        return {
            "recording": session
            and {
                "session_id": session.id,
                "since": session.started_wall_ns / 1e9,
                "frames": session.frames,
                "bytes": session.size_bytes,
            },
            "replay": self.replaying.state(),
            "last_event_id": self.events.last_id,
            "config_stored_hash": self.stored_hash(),
        }

    def degraded(self) -> list[str]:
        """What is missing, in words; empty while all is well."""
        snapshot = self.pipeline_snapshot
        reasons = []
        if snapshot is None:
            return ["no snapshot yet"]
        for name, status in snapshot.links.items():
            if status.state not in ("off", "live"):
                reasons.append(f"{name} {status.state}" + (f": {status.error}" if status.error else ""))
        trouble = self.recorder.status.error or self.recorder.status.warning
        return reasons + ([trouble] if trouble else [])

    def config_in_force(self) -> bytes | None:
        """The 420 bytes as last heard, None before the first time."""
        snapshot = self.pipeline_snapshot
        if snapshot is None or snapshot.config_hash is None:
            return None
        return snapshot.image[:CONFIG_SIZE]

    def config_age_s(self) -> float | None:
        """Seconds since the configuration was heard."""
        return None if self.pipeline_snapshot is None else self.pipeline_snapshot.age_s["config"]

    def can_rx_active(self) -> int | None:
        """Mask of rx messages that are alive."""
        return None if self.pipeline_snapshot is None else self.pipeline_snapshot.master["can_rx_active"]

    def stored_hash(self) -> str | None:
        """Hash of what the EEPROM holds, None where it was not read or holds nothing."""
        stored = self.configuration.stored
        return None if stored is None else image_hash(stored.image)

    def query_events(self, *, after: int, limit: int, severity: str | None, cell: int | None) -> list[dict[str, Any]]:
        """Events of the log as JSON, newest first."""
        found = self.events.query(after, limit, severity, cell)
        return [
            {
                "id": event.id,
                "time": event.t_wall_ns / 1e9,
                "severity": event.severity,
                "code": event.code,
                "text": event.text,
                "cell": event.cell,
                "value": event.value,
                "limit": event.limit,
                "unit": event.unit,
                "who": event.who,
                "acknowledged_by": event.acknowledged_by,
            }
            for event in found
        ]
