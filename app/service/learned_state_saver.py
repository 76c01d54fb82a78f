"""Saves what was learned about the cells, every few minutes and at the end."""

from pathlib import Path

from app.clock import Clock
from app.live.learned_state import LearnedState, save_learned_state
from app.live.pipeline import Output, Pipeline
from app.live.prediction import Predictor

EVERY_S = 300.0


class LearnedStateSaver:
    """Reads the pipeline in its own thread, and once more after that thread has ended."""

    def __init__(self, path: Path, pipeline: Pipeline, predictor: Predictor, clock: Clock) -> None:
        self._path = path
        self._pipeline = pipeline
        self._predictor = predictor
        self._clock = clock
        self._saved_ns = clock.monotonic_ns()

    def on_output(self, output: Output, t_mono_ns: int) -> None:
        """Save where the last time is long ago."""
        if output.snapshot is not None and t_mono_ns - self._saved_ns > EVERY_S * 1e9:
            self.save()

    def save(self) -> None:
        """Save now; nothing before the first estimate."""
        self._saved_ns = self._clock.monotonic_ns()
        estimates = self._pipeline.estimates
        if estimates is not None:
            cells = self._predictor.learned_cells
            state = LearnedState(self._clock.wall_ns(), estimates.soc, estimates.soc_sigma, cells)
            save_learned_state(self._path, state)
