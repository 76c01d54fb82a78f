"""The running service: links, one pipeline thread, recorder, event log, hub. Started and stopped by main.create_app."""

import contextlib
import logging
import queue
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

from app.analysis.black_box.from_session import keep_black_boxes
from app.analysis.black_box.recorder import BlackBoxRecorder
from app.analysis.passport.keeper import PassportKeeper
from app.configuration.finding import Finding
from app.configuration.history import ConfigHistory
from app.configuration.lookup import ConfigSources
from app.configuration.profile_store import Profiles
from app.configuration.rules import Context, review
from app.configuration.safe_write import Configuration
from app.configuration.slave_check_log import SlaveCheckLog
from app.errors import ConfigError, LinkLost, NotNow
from app.estimation.cell_model.cell_file import bundled_cells
from app.estimation.errors import EstimatorError
from app.live.can_trace import CanTrace
from app.live.history import History
from app.live.hub import Hub
from app.live.learned_state import Past, load_past, save_past
from app.live.pipeline import Output, Pipeline
from app.live.pipeline_factory import Chain
from app.live.prediction import Lookout
from app.live.trend import Trend
from app.service.failures import Failures
from app.service.master_identification import Greeter
from app.service.mqtt import configured_publisher
from app.service.operator import Operator
from app.service.settings import Settings
from app.sessions.catalogue import Catalogue
from app.sessions.event_log import EventLog
from app.sessions.recording.auto_recorder import AutoRecorder
from app.sessions.recording.writer import DiskLimits
from app.sessions.replay import Replaying
from app.sessions.retention import Retention, RetentionRule
from app.sessions.transfer.import_jobs import Importing
from app.sessions.transfer.jobs import Bringing
from app.sources.links.can import CanLink
from app.sources.links.can_sender import CanSender
from app.sources.links.serial import SerialLink
from app.sources.master.client import MasterClient
from app.telemetry import CanItem, Event, FloatArray, Item, LinkChange, SerialItem, Snapshot, Source
from firmware_protocol.config_image import image_hash
from firmware_protocol.framing import BadFrame
from firmware_protocol.memory_map import N_CELLS

log = logging.getLogger(__name__)
TICK_S = 1.0
KEEP_PAST_S = 300.0
STALL_S = 3 * TICK_S  # without a snapshot for so long, the pipeline stands still
INBOX_ITEMS = 4096  # beyond it the links wait, and what the line cannot hold shows up as a gap in the sequence


class Runtime:
    """Owns every thread of the service but the web server's."""

    def __init__(self, settings: Settings, *, serial_url: str | None, can_url: str | None, source: Source) -> None:
        self.settings = settings
        self.source = source
        self.started_at = time.monotonic()
        self.hub: Hub[Snapshot] = Hub()
        self.history = History()
        self.trend = Trend()
        self.trace = CanTrace()
        settings.data.mkdir(parents=True, exist_ok=True)
        self.events = EventLog(settings.data / "events.sqlite")
        self.catalogue = Catalogue(settings.data / "sessions")
        self.recorder = AutoRecorder(
            settings.data / "sessions",
            automatic=settings.record,
            on_event=self.log_event,
            event=settings.event,
            limits=DiskLimits(session_bytes=settings.split_bytes),
            source=source,
        )
        self.retention = Retention(
            self.catalogue,
            RetentionRule(settings.keep_days, settings.keep_gb),
            lambda text: self.note("info", "session-expired", text),
        )
        self.black_boxes = BlackBoxRecorder(settings.data / "blackboxes.sqlite", self._session_id, self._box_made)
        self.mqtt = configured_publisher(settings, lambda: self.service_state()["recording"])
        self.bringing = Bringing(settings.data / "sessions", self.catalogue, self.note)
        self.importing = Importing(settings.data, lambda: self.new_pipeline("replay", "imported"), self.note)
        self._inbox: queue.Queue[Item | None] = queue.Queue(INBOX_ITEMS)
        self._chain = Chain(settings.filter, settings.cell)
        cell = self._chain.cell
        self.passports = PassportKeeper(
            settings.data,
            self.catalogue,
            cell,
            simulated=source == "simulator",
            also=lambda session: keep_black_boxes(session, self.black_boxes.store),
        )
        self._past_path = settings.data / "cells.npz"
        self._past_saved_ns = time.monotonic_ns()
        past = load_past(self._past_path)
        self._lookout = Lookout(cell, N_CELLS, None if past is None else past.cells)
        start_soc = None if past is None else past.start(time.time_ns())
        self.pipeline = self.new_pipeline(source, serial_url, can_url, self._lookout, start_soc)
        self.serial = SerialLink(serial_url, self.put) if serial_url else None
        self.can = CanLink(can_url, self.put) if can_url else None
        self.can_sender = CanSender(self._send_can)
        self.master = MasterClient(self._send)
        self.configuration = Configuration(self.master, lambda: self.pipeline.identity, self._rule_context)
        self.config_history = ConfigHistory(settings.data)
        self.slave_checks = SlaveCheckLog(settings.data)
        self.profiles = Profiles(settings.data / "profiles")
        self.sources = ConfigSources(
            self.configuration, self.config_in_force, self.profiles, self.config_history, self.catalogue
        )
        self.operator = Operator(self.configuration, self.master, self.serial, self.note, self.config_history)
        tell = partial(self.note, "warning", "replay-failed")
        self.replaying = Replaying(self.new_pipeline, self.hub.publish_threadsafe, tell)
        self._jobs = ThreadPoolExecutor(max_workers=1, thread_name_prefix="greet")
        self._greeter = Greeter(self.master, self.configuration, self._jobs)
        self._thread = threading.Thread(target=self._run, name="pipeline", daemon=True)
        self._stopped = threading.Event()
        self._is_closing = False
        self._failures = Failures()
        self.pipeline_snapshot: Snapshot | None = None  # of the live source, also while a replay is shown

    def new_pipeline(
        self,
        source: Source,
        serial_url: str | None = None,
        can_url: str | None = None,
        lookout: Lookout | None = None,
        start_soc: tuple[FloatArray, FloatArray] | None = None,
        filter_name: str | None = None,
        cell_name: str | None = None,
    ) -> Pipeline:
        """A fresh chain with the configured estimator, or with another filter or cell.

        Raises:
            ConfigError: there is no such filter or cell.
        """
        settings, chain = self.settings, self._chain
        if filter_name is not None or cell_name is not None:
            cell_name = cell_name or settings.cell
            if cell_name not in (*bundled_cells(), settings.cell):
                raise ConfigError("cell", cell_name, f"one of {', '.join(bundled_cells())}, or the service's own")
            chain = Chain(filter_name or settings.filter, cell_name)
        return chain.pipeline(
            source, serial_url, can_url, lookout=lookout, start_soc=start_soc, stopwatch_ns=time.perf_counter_ns
        )

    def start(self) -> None:
        """Start the threads; the links are opened as soon as the estimator is ready for what they bring."""
        self._thread.start()
        self.retention.start()
        if self.mqtt is not None:
            self.mqtt.start()
        self._jobs.submit(self._open)

    def _open(self) -> None:
        try:
            self.pipeline.warm_up()
        except EstimatorError as error:
            log.warning("the estimator could not be made ready: %s", error)
        for link in (self.serial, self.can):
            if link is not None and not self._is_closing:
                link.start()

    def put(self, item: Item) -> None:
        """Take an item from a link; waits while the pipeline is behind."""
        while not self._stopped.is_set():
            with contextlib.suppress(queue.Full):
                self._inbox.put(item, timeout=0.5)
                return

    def stop(self) -> None:
        """Close the links, drain, close the recording: in this order."""
        self._is_closing = True
        self.replaying.stop()
        self.retention.stop()
        self.master.close()
        self.can_sender.stop()
        for link in (self.serial, self.can):
            if link is not None:
                link.stop()
        self._stopped.set()
        with contextlib.suppress(queue.Full):  # then it ends when the inbox is empty
            self._inbox.put_nowait(None)
        if self._thread.is_alive():
            self._thread.join(timeout=5.0)
        self._keep_past()
        self._jobs.shutdown(wait=True, cancel_futures=True)
        self.passports.close()
        self.black_boxes.close()
        self.recorder.close()
        if self.mqtt is not None:
            self.mqtt.stop()
        self.events.close()

    def log_event(self, event: Event) -> None:
        """Put an event into the log, into the recording, and on the console."""
        log.log(logging.INFO if event.severity == "info" else logging.WARNING, "%s: %s", event.code, event.text)
        self.events.append(
            event.severity,
            event.code,
            event.text,
            cell=event.cell,
            value=event.value,
            limit=event.limit,
            unit=event.unit,
            who=event.who,
            uptime_ms=self._uptime_ms(),
            t_wall_ns=event.time_ns,
        )
        self.recorder.on_event(event)
        if self.mqtt is not None:
            self.mqtt.offer_event(event)

    def _uptime_ms(self) -> int | None:
        snapshot = self.pipeline_snapshot
        if snapshot is None or snapshot.uptime_s is None or snapshot.links.rs232.state != "live":
            return None
        return round(snapshot.uptime_s * 1000)

    def note(self, severity: str, code: str, text: str, who: str | None = None) -> None:
        """Log something that the service or a user did."""
        self.log_event(Event(time.time_ns(), severity, code, text, who=who))  # type: ignore[arg-type]

    def _session_id(self) -> str | None:
        session = self.recorder.session
        return None if session is None else session.id

    def _box_made(self, box: dict[str, Any]) -> None:
        text = f"black box of {box['text']}" if box["is_complete"] else f"black box, incomplete, of {box['text']}"
        self.log_event(Event(time.time_ns(), "info", "blackbox", text, cell=box["cell"]))

    def latest(self) -> Snapshot | None:
        """The newest snapshot, of the replay while one runs."""
        return self.hub.latest

    def _send(self, data: bytes) -> None:
        if self.serial is None:
            raise LinkLost("no RS232 port is configured")
        self.serial.write(data)

    def _send_can(self, can_id: int, data: bytes) -> None:
        if self.can is None:
            raise LinkLost("no CAN bus is configured")
        self.can.send(can_id, data)

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
                    output = self.pipeline.tick(now_ns, time.time_ns())
                    self._deliver(output)
                    self.black_boxes.take(output.events, output.snapshot, now_ns)
            except Exception as error:  # noqa: BLE001  the supervisor: one item must not end the thread
                self._failures.add(error)

    def _take(self, item: Item) -> int | None:
        try:
            self.recorder.on_item(item)
        except Exception as error:  # noqa: BLE001  what is not recorded is shown all the same
            self._failures.add(error)
        if isinstance(item, CanItem):
            self.trace.add(item)
        output = self.pipeline.feed(item)
        self._deliver(output)
        self.black_boxes.take(output.events, output.snapshot, item.t_mono_ns)
        if output.reply is not None:
            self.master.on_reply(output.reply)
        if isinstance(item, SerialItem) and not isinstance(item.frame, BadFrame):
            self._greeter.heard(item.frame.type, item.frame.body)
        elif isinstance(item, LinkChange) and item.link == "rs232" and item.state != "open":
            self._greeter.forget()
        if output.snapshot is None:
            return None
        self.pipeline.look_ahead()
        if item.t_mono_ns - self._past_saved_ns > KEEP_PAST_S * 1e9:
            self._keep_past()
        return item.t_mono_ns

    def _keep_past(self) -> None:
        self._past_saved_ns = time.monotonic_ns()
        estimates = self.pipeline.estimates
        if estimates is not None:
            save_past(self._past_path, Past(time.time_ns(), estimates.soc, estimates.soc_sigma, self._lookout.past))

    def _deliver(self, output: Output) -> None:
        for event in output.events:
            self.log_event(event)
        if output.snapshot is None:
            return
        self.pipeline_snapshot = output.snapshot
        self.recorder.on_output(output)
        self.history.add(output.snapshot)
        if self.mqtt is not None:
            self.mqtt.offer(output.snapshot)
        self.trend.add(output.snapshot)
        if not self.replaying.is_active:
            self.hub.publish_threadsafe(output.snapshot)

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
        silent_s = (time.monotonic_ns() - snapshot.t_mono_ns) / 1e9
        if silent_s > STALL_S:
            reasons.append(f"no snapshot for {silent_s:.0f} s: the pipeline stands still")
        if self._failures.reason is not None:
            reasons.append(self._failures.reason)
        for name, status in snapshot.links.items():
            if status.state not in ("off", "live"):
                reasons.append(f"{name.upper()} {status.state}" + (f": {status.error}" if status.error else ""))
        recorder = self.recorder.status
        mqtt = None if self.mqtt is None else self.mqtt.problem
        return reasons + [text for text in (recorder.error or recorder.warning, self.events.error, mqtt) if text]

    def review(self, image: bytes) -> list[Finding]:
        """What the rules say about a configuration."""
        return review(image, self._rule_context())

    def _rule_context(self) -> Context:
        heard = {can_id: known.period_s for can_id, known in self.trace.by_id().items() if known.period_s is not None}
        return Context(self._chain.cell, heard)

    def config_in_force(self) -> bytes | None:
        """The 420 bytes as last heard or read, None before the first time."""
        return None if (known := self._config()) is None else known[1]

    def config_age_s(self) -> float | None:
        """Seconds since the configuration was heard or read."""
        return None if (known := self._config()) is None else max(0.0, (time.monotonic_ns() - known[0]) / 1e9)

    def _config(self) -> tuple[int, bytes] | None:
        """The newer of what the stream brought as a whole and what was read back after a write."""
        snapshot, read = self.pipeline_snapshot, self.configuration.last_read
        age_s = None if snapshot is None else snapshot.age_s.config
        if snapshot is None or snapshot.config is None or age_s is None:
            return read
        heard = snapshot.t_mono_ns - int(age_s * 1e9), snapshot.config
        return heard if read is None or heard[0] > read[0] else read

    def acknowledge_alarm(self, alarm_id: int, who: str) -> bool:
        """Mark an alarm as seen, False where there is none.

        Raises:
            NotNow: the alarms that are shown are a replay's.
        """
        if self.replaying.is_active:
            raise NotNow("these alarms are of a replay; stop it to acknowledge the car's")
        if not self.pipeline.acknowledge(alarm_id, who):
            return False
        self.note("info", "alarm-acknowledged", f"alarm {alarm_id} acknowledged", who)
        return True

    def can_rx_active(self) -> int | None:
        """Mask of rx messages that are alive."""
        return None if self.pipeline_snapshot is None else self.pipeline_snapshot.master.can_rx_active

    def stored_hash(self) -> str | None:
        """Hash of what the EEPROM holds, None where it was not read or holds nothing."""
        return None if (stored := self.configuration.stored) is None else image_hash(stored.image)
