"""Plays a bad day without anybody watching: simulator, line, pipeline and recorder, faster than real time."""

import subprocess
import tempfile
import threading
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from app.analysis.drill.days import Day
from app.analysis.drill.product import reports_fault
from app.clock import Clock
from app.errors import LinkLost
from app.live.pipeline import Pipeline
from app.live.pipeline_factory import PipelineFactory
from app.sessions.recording.auto_recorder import AutoRecorder
from app.sessions.worker.child_process import command_of
from app.sources.items import Item, LinkChange, SerialItem
from app.sources.links.can import CanLink
from app.sources.links.serial import SerialLink
from app.telemetry import Event
from app.words import Message
from firmware_protocol.framing import Frame

PORTS: Final = ("--serial", "tcp:0", "--can", "slcan-tcp:0")
CAN_OPTIONS: Final = "?sleep_after_open=0&timeout=0.05"
BUS_SPEED: Final = 2.0  # faster, one link lags behind the other by what a silent bus looks like
END_S: Final = 20.0  # of real time, for the simulator to end by itself
_JUDGE_NS: Final = 1_000_000_000


class CarClock(Clock):
    """The car's time as its frames tell it, from where the real clock stood, or a given time of day: at any speed."""

    def __init__(self, start_wall_ns: int | None = None) -> None:
        self._mono_ns = super().monotonic_ns()
        self._wall_ns = super().wall_ns() if start_wall_ns is None else start_wall_ns
        self._uptime_ms = self._base_ms = 0

    @property
    def car_s(self) -> float:
        """Seconds since the start, restarts of the master counted through."""
        return (self._base_ms + self._uptime_ms) / 1000

    def advance(self, uptime_ms: int) -> None:
        """Go on to a frame; one whose uptime goes back comes after a restart."""
        if uptime_ms < self._uptime_ms:
            self._base_ms += self._uptime_ms
        self._uptime_ms = uptime_ms

    def monotonic_ns(self) -> int:
        """Return nanoseconds of the car's time."""
        return self._mono_ns + round(self.car_s * 1e9)

    def wall_ns(self) -> int:
        """Return nanoseconds since 1970 UTC, moved on with it."""
        return self._wall_ns + round(self.car_s * 1e9)


@dataclass(frozen=True, slots=True)
class Played:
    """A day that is over: its session, and the events with their time in the car's clock [s]."""

    session: Path | None
    events: list[tuple[float, Event]]

    def after(self, at_s: float) -> list[tuple[float, Event]]:
        """Return the events since then that tell of something."""
        return [(t_s, event) for t_s, event in self.events if t_s >= at_s and reports_fault(event.severity, event.code)]


def play(day: Day, folder: Path, speed: float, factory: PipelineFactory, start_wall_ns: int | None = None) -> Played:
    """Play a day to its end.

    Args:
        day: to play.
        folder: where the session goes.
        speed: times real time; a day of the bus or the charger takes at most BUS_SPEED.
            Where the machine cannot do it, the day takes longer.
        factory: of the pipeline.
        start_wall_ns: when the day begins; None: now.
    """
    return _Player(folder, factory, start_wall_ns).play(day, speed if day.kind == "car" else min(speed, BUS_SPEED))


class _Player:
    def __init__(self, folder: Path, factory: PipelineFactory, start_wall_ns: int | None) -> None:
        self._clock = CarClock(start_wall_ns)
        self._events: list[tuple[float, Event]] = []
        self._pipeline: Pipeline = factory.pipeline("simulator", "simulated", "simulated")
        self._recorder = AutoRecorder(
            folder, automatic=True, on_event=self._on_event, clock=self._clock, source="simulator"
        )
        self._lock = threading.Lock()
        self._ended = threading.Event()
        self._links = 0  # that are open
        self._n_items = 0  # items
        self._judged_ns = 0
        self._session: Path | None = None

    def play(self, day: Day, speed: float) -> Played:
        with tempfile.TemporaryDirectory(prefix="voltwall-drill-") as place:
            scenario = Path(place) / "day.toml"
            scenario.write_text(day.scenario, encoding="utf-8")
            # a socket: what waits in it is not lost, as it would be in a pseudo-terminal at many times real time
            command = command_of("simulator.cli", *PORTS, "--scenario", str(scenario))
            more = ["--speed", str(speed), "--duration", str(day.length_s), "--with-parent"]
            with subprocess.Popen([*command, *more], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as simulator:
                serial_url, can_url = _urls(simulator)
                links: list[SerialLink | CanLink] = [SerialLink(serial_url, self._take, Clock())]
                if day.kind != "car":  # else it is not heard, as in a car without an adapter
                    links.append(CanLink(can_url, self._take, Clock()))
                self._links = len(links)
                for link in links:
                    link.start()
                try:
                    simulator.wait(day.length_s / speed * 10 + END_S)
                    heard = -1
                    while not self._ended.wait(END_S) and self._n_items != heard:  # a slow machine has yet to read it
                        heard = self._n_items
                finally:
                    simulator.kill()
                    for link in links:
                        link.stop()
        self._recorder.close()
        return Played(self._session, self._events)

    def _take(self, item: Item) -> None:
        with self._lock:
            self._n_items += 1
            if isinstance(item, LinkChange) and item.state == "lost":
                self._links -= 1  # the end of the day is no failure
                if self._links == 0:  # what waits on the slower link is part of the day
                    self._ended.set()
                return
            if isinstance(item, SerialItem) and isinstance(item.frame, Frame):
                self._clock.advance(item.frame.uptime_ms)
            item = replace(item, t_mono_ns=self._clock.monotonic_ns(), t_wall_ns=self._clock.wall_ns())
            self._recorder.on_item(item)
            output = self._pipeline.feed(item)
            for event in output.events:
                self._on_event(event)
            self._recorder.on_output(output)
            if output.snapshot is not None and output.t_mono_ns - self._judged_ns >= _JUDGE_NS:
                self._judged_ns = output.t_mono_ns
                self._pipeline.predict()
            if self._session is None and (session := self._recorder.session) is not None:
                self._session = session.path

    def _on_event(self, event: Event) -> None:
        self._recorder.on_event(event)
        self._events.append((self._clock.car_s, event))


def _urls(simulator: "subprocess.Popen[bytes]") -> tuple[str, str]:
    """Return where the line and the CAN bus end, once the simulator says that it is ready.

    Raises:
        LinkLost: it ended before.
    """
    urls: dict[str, str] = {}
    for line in simulator.stdout or ():
        name, _, value = line.decode(errors="replace").strip().partition(": ")
        if name == "ready":
            return urls["serial"], urls["can"] + CAN_OPTIONS
        urls[name] = value
    raise LinkLost(Message("closed-by-other-end"))
