"""Sessions of the simulated car, recorded as fast as they can be computed.

The frames go through the pipeline and the recorder as those of a real car would, on the virtual car's clock, so the
session holds frames, estimates, events and configurations.
"""

import hashlib
from pathlib import Path

from app.estimation.cell_model.cell_file import format_cell, load_cell
from app.estimation.filters.estimators import make_estimator
from app.live.pipeline import Output, Pipeline
from app.live.prediction import Predictor
from app.sessions.recording.recorder import Recorder
from app.sources.items import LinkChange, SerialItem
from app.sources.master.source import MasterSource
from app.telemetry import FloatArray, Snapshot
from firmware_protocol.framing import Frame, FrameDecoder
from firmware_protocol.memory_map import N_CELLS
from simulator.library import find_scenario
from simulator.scenario_player import ScenarioPlayer
from tests.fake_clock import FunctionClock

EPOCH_NS = 1_790_000_000 * 10**9
STEP_S = 0.05
CELL = "samsung-25r-10p"
FLUSH_FRAMES = 2000


class ScenarioRecorder:
    """One scenario into one session file; `mark` sets markers on the way.

    `snapshot` is the newest, `pipeline` and `predictor` are those it went through; `sent` and `digest` tell of every
    frame that the line carried, `soc` is the newest estimate, (96,) fractions.
    Without looking ahead (power, times to limits, joints) it runs twice as fast.
    """

    def __init__(
        self,
        folder: Path,
        scenario: str,
        *,
        seed: int | None = None,
        epoch_ns: int = EPOCH_NS,
        predicts: bool = True,
    ) -> None:
        self._epoch_ns = epoch_ns
        self.player = ScenarioPlayer(find_scenario(scenario), seed=seed, step_s=STEP_S)
        self._simulation = self.player.simulation
        self._decoder = FrameDecoder()
        cell = load_cell(CELL)
        self.predictor = Predictor(cell, (12,) * 8) if predicts else None
        self.pipeline = Pipeline(
            MasterSource("serial", "simulated"),
            lambda: make_estimator("fused", cell, N_CELLS),
            filter_name="fused",
            cell_name=CELL,
            predictor=self.predictor,
        )
        self.recorder = Recorder(
            folder,
            FunctionClock(lambda: self.now_ns, lambda: epoch_ns + self.now_ns),
            version="benchmark",
            free_bytes=lambda _: 1 << 40,
            cell_file=format_cell(cell),
        )
        self._config: bytes | None = None
        self.sent = 0
        self.digest = hashlib.sha256()
        self.soc: FloatArray | None = None
        self.snapshot: Snapshot | None = None  # the newest
        self.info = self.recorder.start(scenario, {"scenario": scenario})
        self.pipeline.feed(LinkChange(0, epoch_ns, "rs232", "open"))
        self._simulation.serial_out = self._take
        self.player.run(1.0)
        self._simulation.receive(b"x")

    @property
    def now_ns(self) -> int:
        """The virtual car's time."""
        return round(self._simulation.now_s * 1e9)

    def run(self, seconds: float) -> None:
        """Let the car go on."""
        end_s = self._simulation.now_s + seconds
        while not self.player.is_over and self._simulation.now_s < end_s:
            self.player.run(min(5.0, end_s - self._simulation.now_s))

    def mark(self, text: str, kind: str = "note") -> None:
        """Set a marker now."""
        self.recorder.marker(self.now_ns, self._epoch_ns + self.now_ns, text, kind=kind)

    def close(self) -> None:
        """End the session."""
        self.recorder.close(timeout_s=60.0)

    def _take(self, data: bytes) -> None:
        now_ns = self.now_ns
        wall_ns = self._epoch_ns + now_ns
        for item in self._decoder.feed(data):
            self.recorder.frame(now_ns, wall_ns, 0, item.raw, isinstance(item, Frame))
            self._record(self.pipeline.feed(SerialItem(now_ns, wall_ns, item)))
            self.pipeline.predict()
            self.sent += 1
            self.digest.update(item.raw)
            if self.sent % FLUSH_FRAMES == 0:
                self.recorder.flush(60.0)

    def _record(self, output: Output) -> None:
        for event in output.events:
            self.recorder.event(self.now_ns, event)
        snapshot = output.snapshot
        if snapshot is None:
            return
        self.snapshot = snapshot
        if output.estimates is not None:
            estimates = output.estimates
            self.soc = estimates.soc
            self.recorder.estimates(snapshot.t_mono_ns, output.uptime_ms, estimates.soc, estimates.soc_sigma)
        if snapshot.config is not None and snapshot.config != self._config:
            why = "in force at the start" if self._config is None else "changed"
            self._config = snapshot.config
            self.recorder.config(snapshot.t_mono_ns, snapshot.t_wall_ns, snapshot.config, why)
