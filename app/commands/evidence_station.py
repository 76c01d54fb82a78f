"""The reaction test: one serial link to the master, all that comes recorded, and the walk through the faults."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from app.analysis.evidence.evidence import MARKER
from app.analysis.evidence.master_samples import MasterSample, SampledValues, master_samples
from app.analysis.evidence.steps import STEPS
from app.analysis.evidence.timing import TRIPS, ConfiguredLimits
from app.clock import Clock
from app.commands.evidence_benches import Bench, Skipped
from app.errors import AppError, LinkLost, MasterRefused, MasterSilent
from app.sessions.info import SessionInfo
from app.sessions.recording.recorder import Recorder
from app.sources.items import Item, LinkChange, SerialItem
from app.sources.links.serial import SerialLink
from app.sources.master.client import MasterClient
from app.telemetry.events import link_lost
from app.words import Message
from firmware_protocol.framing import BAUD_RATE, Frame
from firmware_protocol.memory_map import CONFIG, CONFIG_SIZE
from firmware_protocol.messages import Command, CommandId, EventMessage, Write

READY_S: Final = 20.0  # for telemetry to begin, and for the circuit to close again
OPENS_S: Final = 6.0  # within which a fault has to open the circuit
LEAD_S, SETTLE_S, AFTER_S = 3.0, 1.0, 0.5
TEST_INTERVAL_MS: Final = 40  # the quickest telemetry that the line carries


class NotReady(AppError):
    """The master does not get to where the test can begin or go on."""


class Station:
    """Reads and records from `start` to `stop`. Waits sample at the newest fast frame and at every event."""

    def __init__(self, url: str, folder: Path, version: str, clock: Clock) -> None:
        self._clock = clock
        self.recorder = Recorder(folder, clock, version=version, keeps_empty=False)
        self._link = SerialLink(url, self._take, clock)
        self.client = MasterClient(self._link.write, clock)
        self._link.on_frame, self._link.on_lost = self.client.on_frame, self.client.on_lost
        self._news = threading.Condition()
        self._newest: MasterSample | None = None
        self._lost: LinkChange | None = None
        self._trips: list[EventMessage] = []

    def start(self, name: str, metadata: dict[str, object]) -> SessionInfo:
        """Open the link and begin the session."""
        info = self.recorder.start(name, metadata)
        self._link.start()
        return info

    def stop(self) -> None:
        """End the stream and the session; everything is on the disk on return."""
        self.client.close()
        self._link.stop()
        self.recorder.close(30.0)

    def read_config(self) -> bytes:
        """Return the configuration in force, and record it."""
        image = self.client.read(0, CONFIG_SIZE)
        self.recorder.config(self._clock.monotonic_ns(), self._clock.wall_ns(), image, "in force at the start")
        return image

    def mark(self, kind: str, text: str) -> None:
        """Set a marker now."""
        self.recorder.marker(self._clock.monotonic_ns(), self._clock.wall_ns(), text, kind=kind)

    def forget_trips(self) -> None:
        """Forget the trips received so far."""
        with self._news:
            self._trips.clear()

    def wait(self, condition: Callable[[SampledValues, list[EventMessage]], bool], seconds: float) -> bool:
        """Wait until the newest values and the trips since `forget_trips` fulfil a condition; False after the time."""
        with self._news:
            return self._news.wait_for(lambda: self._holds(condition), seconds)

    def wait_for_telemetry(self, seconds: float) -> bool:
        """Wait for telemetry; False after the time.

        Raises:
            LinkLost: the port cannot be opened.
        """
        with self._news:
            self._news.wait_for(lambda: self._newest is not None or self._lost is not None, seconds)
            if self._newest is None and self._lost is not None:
                raise LinkLost(link_lost("rs232", self._lost.error))
            return self._newest is not None

    def rest(self, seconds: float) -> None:
        """Let so much be recorded."""
        self.wait(lambda *_: False, seconds)

    def _holds(self, condition: Callable[[SampledValues, list[EventMessage]], bool]) -> bool:
        values = None if self._newest is None else self._newest.values
        return values is not None and condition(values, self._trips)

    def _take(self, item: Item) -> None:
        if isinstance(item, LinkChange) and item.state == "lost":
            with self._news:
                self._lost = item
                self._news.notify_all()
        if not isinstance(item, SerialItem):
            return
        frame = item.frame
        self.recorder.frame(item.t_mono_ns, item.t_wall_ns, 0, frame.raw, isinstance(frame, Frame))
        if not isinstance(frame, Frame):
            return
        for sample in master_samples([(item.t_mono_ns, frame.raw)], BAUD_RATE):
            with self._news:
                if sample.values is not None:
                    self._newest = sample
                if sample.event is not None and sample.event.code in TRIPS:
                    self._trips.append(sample.event)
                self._news.notify_all()


def walk(station: Station, bench: Bench, names: set[str], say: Callable[[str], None]) -> None:
    """Do the steps of these names; each is marked in the session.

    Raises:
        NotReady: no telemetry, or the circuit is open before the first step.
        LinkLost, MasterSilent, MasterRefused: the port cannot be opened, the master does not answer, or refuses.
    """
    if not station.wait_for_telemetry(READY_S):
        raise NotReady(Message("evidence-no-telemetry"))
    station.client.identify()
    image = station.read_config()
    limits = ConfiguredLimits.of(image)
    with _quick_telemetry(station, image, say):
        station.rest(LEAD_S)
        for number, step in enumerate(STEPS, 1):
            if step.name not in names:
                continue
            say(f"[{number}/{len(STEPS)}] {step.name} ({step.rule})")
            if not station.wait(lambda values, _: values.is_ok, READY_S):
                station.mark(MARKER, f"{step.name} skipped the shutdown circuit was open")
                say("  not tested: the shutdown circuit is open")
                continue
            station.forget_trips()
            station.rest(SETTLE_S)
            station.mark(MARKER, f"{step.name} armed")
            station.rest(AFTER_S)
            try:
                bench.fail(step, limits)
            except Skipped as reason:
                station.mark(MARKER, f"{step.name} skipped {reason}")
                continue
            opened = station.wait(lambda values, trips: not values.is_ok or bool(trips), OPENS_S)
            station.rest(AFTER_S)
            station.mark(MARKER, f"{step.name} done")
            say("  the circuit opened" if opened else f"  the circuit did not open within {OPENS_S:g} s")
            bench.repair(step)
            _clear(station)
        station.rest(SETTLE_S)


def _clear(station: Station) -> None:
    """Clear faults as soon as the master takes it: it refuses while the cause lasts, and may have a button instead."""
    tries = round(READY_S / SETTLE_S)
    for _ in range(tries):
        try:
            station.client.request(Command(CommandId.CLEAR_FAULTS, 0))
        except (MasterRefused, MasterSilent):
            station.rest(SETTLE_S)
            continue
        if station.wait(lambda values, _: values.is_ok, SETTLE_S):
            return


@contextmanager
def _quick_telemetry(station: Station, image: bytes, say: Callable[[str], None]) -> Iterator[None]:
    """Set the telemetry to its quickest, and back: only in force, never stored."""
    period = CONFIG["telemetry_period"]
    own_ms = period.unpack(image)[0]
    if own_ms <= TEST_INTERVAL_MS:
        yield
        return
    try:
        station.client.request(Write(period.offset, TEST_INTERVAL_MS.to_bytes(period.size, "little")))
    except (MasterRefused, MasterSilent) as error:
        say(f"telemetry stays at {own_ms} ms, the bands get wider: {error}")
        yield
        return
    try:
        yield
    finally:
        station.client.request(Write(period.offset, own_ms.to_bytes(period.size, "little")))
