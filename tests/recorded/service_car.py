"""A simulated car and the service that receives it, in one process and on the virtual car's clock: as fast as it goes.

`create_app` of the running service, fed through its inbox and its pipeline's own step: alarms, black boxes and verdicts
are made by what makes them at the track. What the fault was is kept by the caller, never in the data folder.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from math import inf
from pathlib import Path
from types import TracebackType
from typing import Any, Final
from unittest.mock import patch

from app.api.application import create_app
from app.estimation.health.cell_watch import CellWatch
from app.live.pipeline_factory import PipelineFactory
from app.live.prediction import LearnedCells, Predictor
from app.service import wiring
from app.service.settings import Settings
from app.sources.items import CanFault, CanItem, Item, LinkChange, SerialItem
from app.telemetry import BusState, Snapshot, TripCause
from firmware_protocol.framing import FrameDecoder
from firmware_protocol.memory_map import CAN_ID_EXTENDED
from simulator.can_bus import PASSIVE, WARNING, CanFrame
from simulator.scenario import Scenario
from simulator.scenario_player import ScenarioPlayer
from tests.fake_clock import FunctionClock
from tests.in_process import InProcess

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # it asks for another HTTP client than ours
    from starlette.testclient import TestClient

CELL: Final = "samsung-25r-10p"  # as fresh as the simulator's
EPOCH_NS: Final = 1_790_000_000 * 10**9
START_NS: Final = 1000 * 10**9
STEP_S: Final = 0.05  # step of the physics
STREAM_S: Final = 0.2  # then the service asks for telemetry
TURN_S: Final = 0.05  # virtual time between two polls of the lines
FLUSH_S: Final = 60.0
AFTER_END: Final = 6  # seconds of the car after its recording
WAIT_S: Final = 0.5  # virtual time between two checks whether a trip is being explained
LINKS: Final = {"serial_url": "socket://127.0.0.1:1", "can_url": "virtual:never-opened"}


class _Listener:
    """The pit laptop's CAN adapter: one that hands on data frames and error frames, as SocketCAN does."""

    is_listening_only = False
    bit_rate = 500_000

    def __init__(self, take: Callable[[CanFrame, float], None]) -> None:
        self._take = take

    def can_received(self, frame: CanFrame, now_s: float) -> None:
        """Hand a frame on."""
        self._take(frame, now_s)


class _NoForecast(PipelineFactory):
    """Without power, energy and times to limits: a third of the work, and nothing that is found depends on them."""

    def predictor(
        self, learned_before: LearnedCells | None = None, watch: CellWatch | None = None, *, predicts: bool = False
    ) -> Predictor:
        """Return a predictor that judges the cells alone."""
        return super().predictor(learned_before, watch, predicts=False)


class Car:
    """Runs a scenario; `get` asks the service over REST."""

    def __init__(self, folder: Path, scenario: Scenario) -> None:
        """Start the service in an empty data folder; nothing has been received yet."""
        self.folder = folder
        self.player = ScenarioPlayer(scenario, seed=scenario.seed, step_s=STEP_S)
        self._simulation = self.player.simulation
        self._clock = FunctionClock(lambda: START_NS + self._now_ns, lambda: EPOCH_NS + self._now_ns)
        settings = Settings(data=folder, season=False, cell=CELL)
        with patch.object(wiring, "Workers", InProcess), patch.object(wiring, "PipelineFactory", _NoForecast):
            app = create_app(settings, "simulator", clock=self._clock, **LINKS)
        self._service = app.state.parts.service
        self._client = TestClient(app, base_url="http://127.0.0.1", client=("127.0.0.1", 1))
        self._decoder = FrameDecoder()
        self._error_frames = 0
        self._asked_s = self._flushed_s = self._waited_s = STREAM_S
        self._causes: set[TripCause | None] = set()
        self.banners: list[dict[str, Any]] = []  # the first snapshot with each verdict
        self._listener = _Listener(self._can)
        self._simulation.bus.attach(self._listener)
        self._simulation.bus.error_listeners.append(self._can_error)
        self._simulation.serial_out = self._serial
        for link in ("rs232", "can"):
            self._take(LinkChange(self._clock.monotonic_ns(), self._clock.wall_ns(), link, "open"))
        self._simulation.run_until(STREAM_S)
        self._simulation.receive(b"x")

    def __enter__(self) -> Car:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._service.stop()

    @property
    def _now_ns(self) -> int:
        return round(self._simulation.now_s * 1e9)

    def run(self, seconds: float = inf) -> None:
        """Let the car go on so long, or to the end of its scenario."""
        service, car = self._service, self._simulation
        end_s = car.now_s + seconds
        while not self.player.is_over and car.now_s < end_s:
            self.player.run(TURN_S)
            before = service.live.snapshot
            service.live.step(0.0)  # the ages, where nothing came
            if service.live.snapshot is not before and car.now_s - self._asked_s > 1.0:  # as the link answers silence
                self._asked_s = car.now_s
                car.receive(b"x")
            if car.now_s - self._flushed_s > FLUSH_S:
                self._flushed_s = car.now_s
                service.recorder.flush()
            if car.now_s - self._waited_s > WAIT_S:
                self._waited_s = car.now_s
                service.black_boxes.wait()
                service.session_watch.wait()
            self._keep_explained(service.live.snapshot)

    def _keep_explained(self, snapshot: Snapshot | None) -> None:
        causes = set() if snapshot is None else {alarm.cause for alarm in snapshot.alarms} - {None}
        if causes != self._causes:
            self._causes = causes
            self.banners.append(self.get("/snapshot"))

    def get(self, path: str) -> Any:
        """Return what the service answers."""
        answer = self._client.get(f"/api/v1{path}")
        answer.raise_for_status()
        return answer.json()

    def end_recording(self) -> str:
        """End the session and return its id."""
        session_id = self._service.recorder.session_id
        assert session_id is not None, "nothing was recorded"
        self._service.recorder.stop()
        self._service.recorder.flush()
        for _ in range(AFTER_END):  # the last look at it, and what it names
            self._simulation.run_until(self._simulation.now_s + 1.0)
            self._service.session_watch.wait()
        return str(session_id)

    def _take(self, item: Item) -> None:
        self._service.live._inbox.put(item)
        self._service.live.step(0.0)

    def _serial(self, data: bytes) -> None:
        for frame in self._decoder.feed(data):
            self._take(SerialItem(self._clock.monotonic_ns(), self._clock.wall_ns(), frame))

    def _can(self, frame: CanFrame, _: float) -> None:
        can_id = frame.can_id | (CAN_ID_EXTENDED if frame.is_extended else 0)
        self._take(CanItem(self._clock.monotonic_ns(), self._clock.wall_ns(), can_id, frame.data))

    def _can_error(self) -> None:
        station = self._simulation.bus.station(self._listener)
        errors = max(station.transmit_errors, station.receive_errors)
        state: BusState = "passive" if errors >= PASSIVE else "warning" if errors >= WARNING else "active"
        self._error_frames += 1
        self._take(CanFault(self._clock.monotonic_ns(), self._clock.wall_ns(), state, self._error_frames))
