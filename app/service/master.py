"""The service's side of a master: commands to it, who it is, and what is known of its configuration.

A command is in the signed log and in the event log with its outcome. A master that appears, or starts again, is asked
who it is and what it has stored.
"""

import contextlib
import logging
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from app.clock import Clock
from app.configuration.config_sources import ConfigSources
from app.configuration.configuration_store import ConfigurationStore
from app.configuration.history import ConfigHistory
from app.configuration.issue import ConfigIssue
from app.configuration.rules import Context, allowed_ranges, review
from app.configuration.safe_write import ConfigurationWriter
from app.configuration.slave_check import SlaveCheckLog
from app.configuration.write_log import Note, WriteLog
from app.errors import AppError, LinkError
from app.estimation.cell_model.circuit import CellModel
from app.live.can_trace import CanTrace
from app.live.pipeline import Output
from app.service.events import Events
from app.service.links import ServiceLinks
from app.sessions.catalogue import Catalogue
from app.sources.items import Item, LinkChange, SerialItem
from app.sources.loaded_battery import LoadedBattery
from app.sources.master.client import MasterClient
from app.words import Message
from firmware_protocol.can_tables import ids_of
from firmware_protocol.config_image import default_image, image_hash
from firmware_protocol.framing import BadFrame, Frame
from firmware_protocol.messages import Command, EventCode, MessageType

NEEDED = ("charge-stop", "balance-stop", "stream-stop", "clear-faults")  # are sent although the disk takes no record


class MasterCommands:
    """Carries out what a user asked for. Blocking; thread-safe."""

    def __init__(self, links: ServiceLinks, events: Events, log: WriteLog) -> None:
        self._links = links
        self._events = events
        self._log = log

    def send(self, name: str, command: Command, who: str, details: str = "") -> None:
        """Send a named command and wait for the master's answer.

        Raises:
            LinkError: see MasterClient.request.
            RecordingFailed: the signed log does not take it, so nothing was sent; what is NEEDED is sent anyway.
        """
        text = f"{name} {details}".strip()
        try:
            with self._log.signed(who, "command", text, is_needed=name in NEEDED):
                self._links.master.request(command)
        except LinkError as error:
            self._events.note("warning", "command-failed", Message("of-source", source=text, reason=error.message), who)
            raise
        self._events.note("info", "command", Message("command", command=text), who)

    def stream(self, who: str, *, on: bool) -> None:
        """Start or stop the master's stream.

        Raises:
            LinkLost: no RS232 port is configured, or it is not open.
            RecordingFailed: see send.
        """
        name = "stream-start" if on else "stream-stop"
        with self._log.signed(who, "command", name, is_needed=name in NEEDED):
            self._links.stream(on=on)
        self._events.note("info", "command", Message("command", command=name), who)


log = logging.getLogger(__name__)
AGAIN_S = 10.0  # a master that does not know IDENT is not asked at every frame
NEWS = (bytes([EventCode.BOOT]), bytes([EventCode.CONFIG_STORED]))


class MasterIdentification:
    """Sees every item in the pipeline's thread; asks in a thread of its own, since an answer takes its time."""

    def __init__(
        self, master: MasterClient, configuration: ConfigurationWriter, clock: Clock, jobs: Executor | None = None
    ) -> None:
        self._master = master
        self._configuration = configuration
        self._jobs = jobs or ThreadPoolExecutor(max_workers=1, thread_name_prefix="identification")
        self._clock = clock
        self._is_done = False
        self._not_before_ns = 0

    def on_item(self, item: Item) -> None:
        """Look at what the RS232 link delivered."""
        if isinstance(item, SerialItem) and not isinstance(item.frame, BadFrame):
            self._on_frame(item.frame)
        elif isinstance(item, LinkChange) and item.link == "rs232":
            self._start_over()  # the next frame may be another master's

    def stop(self) -> None:
        """Ask nothing more, once what is being asked has been answered."""
        self._jobs.shutdown(wait=True, cancel_futures=True)

    def _start_over(self) -> None:
        self._is_done, self._not_before_ns = False, 0

    def _on_frame(self, frame: Frame) -> None:
        """Ask where the sender is not known, or says that it started or stored."""
        if frame.type == MessageType.EVENT and frame.body[:1] in NEWS:
            self._start_over()
        if not self._is_done and self._clock.monotonic_ns() >= self._not_before_ns:
            self._is_done = True
            with contextlib.suppress(RuntimeError):  # shutting down
                self._jobs.submit(self._ask)

    def _ask(self) -> None:
        try:
            self._master.identify()
            self._configuration.read_stored()
        except AppError as error:
            log.info("the master did not identify itself: %s", error)
            self._not_before_ns = self._clock.monotonic_ns() + int(AGAIN_S * 1e9)
            self._is_done = False


class Rules:
    """The rules with what they are judged by: the cell, and the periods measured on the CAN bus."""

    def __init__(self, cell: CellModel, trace: CanTrace) -> None:
        self._cell = cell
        self._trace = trace

    def context(self) -> Context:
        """Return what the rules need to know now."""
        periods_s = {can_id: seen.period_s for can_id, seen in self._trace.by_id().items() if seen.period_s is not None}
        return Context(self._cell, periods_s)

    def review(self, image: bytes) -> list[ConfigIssue]:
        """Return what the rules say about a configuration."""
        return review(image, self.context())

    def allowed_ranges(self, image: bytes) -> dict[str, tuple[int, int]]:
        """Return what each field may be while the others stay [raw counts]."""
        return allowed_ranges(image, self.context())


class ConfigurationInForce:
    """The newer of what the stream brought as a whole and what was read back after a write."""

    def __init__(self, configuration: ConfigurationWriter, clock: Clock) -> None:
        self._configuration = configuration
        self._clock = clock
        self._received: tuple[int, bytes] | None = None  # monotonic ns, image

    def on_output(self, output: Output, t_mono_ns: int) -> None:
        """Keep the configuration that the stream brought."""
        snapshot = output.snapshot
        if snapshot is None or snapshot.config is None:
            return
        age_s = snapshot.age_s.config
        if age_s is not None:
            self._received = snapshot.t_mono_ns - int(age_s * 1e9), snapshot.config

    def image(self) -> bytes | None:
        """Return the 420 bytes as last received or read, None before the first time."""
        return None if (newest := self._newest()) is None else newest[1]

    def age_s(self) -> float | None:
        """Return the seconds since the configuration was received or read."""
        return None if (newest := self._newest()) is None else max(0.0, (self._clock.monotonic_ns() - newest[0]) / 1e9)

    def stored_hash(self) -> str | None:
        """Return the hash of what the EEPROM holds, None where it was not read or holds nothing."""
        return None if (stored := self._configuration.stored) is None else image_hash(stored.image)

    def _newest(self) -> tuple[int, bytes] | None:
        images = [image for image in (self._received, self._configuration.last_read) if image is not None]
        return max(images, key=lambda image: image[0], default=None)


def ids_of_others(trace: CanTrace, battery: LoadedBattery, in_force: ConfigurationInForce) -> set[int]:
    """Return the CAN ids that the battery's master or BMS sends or listens to, or that anybody else has sent."""
    received = {can_id for can_id, traced in trace.by_id().items() if not traced.latest.sent}
    if not battery.has_memory_map:
        return received | set(battery.definitions.by_id())
    return received | ids_of(in_force.image() or default_image())


@dataclass(frozen=True, slots=True)
class MasterConfiguration:
    """The parts around the configuration of a master."""

    writer: ConfigurationWriter
    in_force: ConfigurationInForce
    rules: Rules
    history: ConfigHistory
    write_log: WriteLog
    sources: ConfigSources
    profiles: ConfigurationStore
    slave_checks: SlaveCheckLog


def master_configuration(
    data: Path,
    master: MasterClient,
    rules: Rules,
    catalogue: Catalogue,
    note: Note,
    clock: Clock,
) -> MasterConfiguration:
    """Return the parts, connected; what they keep is in the data folder.

    Raises:
        AppError: a file of the data folder cannot be used.
    """
    history = ConfigHistory(data)
    write_log = WriteLog(history, note, clock)
    writer = ConfigurationWriter(master, rules.context, write_log, clock)
    in_force = ConfigurationInForce(writer, clock)
    profiles = ConfigurationStore(data / "profiles", clock)
    sources = ConfigSources(writer, in_force.image, profiles, history, catalogue)
    return MasterConfiguration(writer, in_force, rules, history, write_log, sources, profiles, SlaveCheckLog(data))
