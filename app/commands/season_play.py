"""Records a simulated session: simulator, line, pipeline and recorder, faster than real time."""

import subprocess
import tempfile
import threading
from dataclasses import replace
from pathlib import Path
from typing import Final

from app.clock import Clock
from app.errors import LinkLost
from app.live.pipeline import Pipeline
from app.live.pipeline_factory import PipelineFactory
from app.sessions.recording.auto_recorder import AutoRecorder
from app.sessions.worker import command_of
from app.sources.items import Item, LinkChange, SerialItem
from app.sources.links.serial import SerialLink
from app.telemetry import Event
from app.words import Message
from firmware_protocol.framing import Frame

END_S: Final = 20.0  # real time for the simulator to end
_JUDGE_NS: Final = 1_000_000_000


class PlaybackClock(Clock):
    """The car's time by its frames, from a given time of day: at any speed."""

    def __init__(self, start_wall_ns: int) -> None:
        self._mono_ns = super().monotonic_ns()
        self._wall_ns = start_wall_ns
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


def play(
    scenario: str, length_s: float, folder: Path, speed: float, factory: PipelineFactory, start_wall_ns: int
) -> Path | None:
    """Return the session of a scenario that was played to its end; None where nothing was recorded.

    Args:
        scenario: TOML, for the simulator.
        length_s: of the car's time.
        folder: where the session goes.
        speed: times real time. Where the machine cannot do it, the session takes longer.
        factory: of the pipeline.
        start_wall_ns: when the session begins.
    """
    return _Player(folder, factory, start_wall_ns).play(scenario, length_s, speed)


class _Player:
    def __init__(self, folder: Path, factory: PipelineFactory, start_wall_ns: int) -> None:
        self._clock = PlaybackClock(start_wall_ns)
        self._pipeline: Pipeline = factory.pipeline("simulator", "simulated", "simulated")
        self._recorder = AutoRecorder(
            folder, automatic=True, on_event=self._on_event, clock=self._clock, source="simulator"
        )
        self._ended = threading.Event()
        self._n_items = 0
        self._judged_ns = 0
        self._session: Path | None = None

    def play(self, scenario: str, length_s: float, speed: float) -> Path | None:
        with tempfile.TemporaryDirectory(prefix="voltwall-season-") as place:
            path = Path(place) / "scenario.toml"
            path.write_text(scenario, encoding="utf-8")
            # a socket: what waits in it is not lost, as it would be in a pseudo-terminal at many times real time
            command = command_of("simulator.cli", "--serial", "tcp:0", "--scenario", str(path))
            more = ["--speed", str(speed), "--duration", str(length_s), "--with-parent"]
            with subprocess.Popen([*command, *more], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as simulator:
                link = SerialLink(_serial_url(simulator), self._take, Clock())
                link.start()
                try:
                    simulator.wait(length_s / speed * 10 + END_S)
                    received = -1
                    while not self._ended.wait(END_S) and self._n_items != received:  # a slow machine has yet to read
                        received = self._n_items
                finally:
                    simulator.kill()
                    link.stop()
        self._recorder.close()
        return self._session

    def _take(self, item: Item) -> None:
        self._n_items += 1
        if isinstance(item, LinkChange) and item.state == "lost":
            self._ended.set()  # the end of the session is no failure
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


def _serial_url(simulator: "subprocess.Popen[bytes]") -> str:
    """Return where the line ends, once the simulator is ready.

    Raises:
        LinkLost: it ended before.
    """
    url = ""
    for line in simulator.stdout or ():
        name, _, value = line.decode(errors="replace").strip().partition(": ")
        if name == "ready":
            return url
        if name == "serial":
            url = value
    raise LinkLost(Message("closed-by-other-end"))
