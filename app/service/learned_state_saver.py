"""Saves what was learned about the cells, every few minutes and at the end."""

import threading
from pathlib import Path

from app.clock import Clock
from app.live.learned_state import LearnedState, learned_file, load_learned_state, save_learned_state
from app.live.pipeline import Output, Pipeline
from app.live.pipeline_factory import PipelineFactory
from app.live.prediction import Predictor
from app.sources.loaded_battery import team_battery
from app.telemetry import Source

EVERY_S = 300.0
END_S = 5.0  # for the disk, at the end


class LearnedStateSaver:
    """Reads the pipeline in its own thread, and once more after that thread has ended; another waits for the disk."""

    def __init__(self, path: Path, pipeline: Pipeline, predictor: Predictor, clock: Clock) -> None:
        self._path = path
        self._pipeline = pipeline
        self._predictor = predictor
        self._clock = clock
        self._saved_ns = clock.monotonic_ns()
        self._writing: threading.Thread | None = None

    def on_output(self, output: Output, t_mono_ns: int) -> None:
        """Save where the last time is long ago."""
        if output.snapshot is not None and t_mono_ns - self._saved_ns > EVERY_S * 1e9:
            self._begin()

    def save(self) -> None:
        """Save now; nothing before the first estimate."""
        self._wait()
        self._begin()
        self._wait()

    def _wait(self) -> None:
        if self._writing is not None:
            self._writing.join(END_S)

    def _begin(self) -> None:
        """Save in a thread of its own, unless the disk has not taken the last one yet."""
        self._saved_ns = self._clock.monotonic_ns()
        if self._writing is not None and self._writing.is_alive():
            return
        estimates = self._pipeline.estimates
        if estimates is not None:
            cells = self._predictor.learned_cells
            state = LearnedState(self._clock.wall_ns(), estimates.soc, estimates.soc_sigma, cells)
            self._writing = threading.Thread(
                target=save_learned_state, args=(self._path, state), name="learned state", daemon=True
            )
            self._writing.start()


def learning_pipeline(
    data: Path, factory: PipelineFactory, clock: Clock, source: Source, serial_url: str | None, can_url: str | None
) -> tuple[Pipeline, LearnedStateSaver]:
    """Return the pipeline of the live source, which goes on from what earlier runs learned, and what saves it."""
    battery = factory.battery.battery
    path = data / learned_file(battery.name, is_team=battery == team_battery().battery)
    learned = load_learned_state(path, battery.n_cells)
    predictor = factory.predictor(None if learned is None else learned.cells)
    start_soc = None if learned is None else learned.start(clock.wall_ns())
    pipeline = factory.pipeline(source, serial_url, can_url, predictor=predictor, start_soc=start_soc)
    return pipeline, LearnedStateSaver(path, pipeline, predictor, clock)
