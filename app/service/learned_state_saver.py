"""Saves what was learned about the cells, every few minutes and at the end, and what is open whenever it changes."""

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from app.clock import Clock
from app.live.learned_state import LearnedState, digest_of, learned_file, load_learned_state, save_learned_state
from app.live.open_alarms import alarm_file, load_open_alarms, save_open_alarms
from app.live.pipeline import Output, Pipeline
from app.live.pipeline_factory import PipelineFactory
from app.live.prediction import Predictor
from app.sources.loaded_battery import team_battery
from app.telemetry import Alarm, Source

EVERY_S = 300.0
END_S = 5.0  # for the disk, at the end


class _Writer:
    """A thread a time that waits for the disk."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._thread: threading.Thread | None = None

    @property
    def is_busy(self) -> bool:
        """The disk has not taken the last one yet."""
        return self._thread is not None and self._thread.is_alive()

    def begin(self, write: Callable[..., None], *arguments: Any) -> None:
        """Write in a thread of its own."""
        self._thread = threading.Thread(target=write, args=arguments, name=self._name, daemon=True)
        self._thread.start()

    def wait(self) -> None:
        """Wait for what is being written, so long as is reasonable at the end."""
        if self._thread is not None:
            self._thread.join(END_S)


class LearnedStateSaver:
    """Reads the pipeline in its own thread, and once more after that thread has ended; others wait for the disk."""

    def __init__(
        self, path: Path, pipeline: Pipeline, predictor: Predictor, clock: Clock, alarms: Path | None = None
    ) -> None:
        """Save what was learned into `path`, and open alarms into `alarms`; None: not at all."""
        self._path = path
        self._alarms_path = alarms
        self._pipeline = pipeline
        self._predictor = predictor
        self._clock = clock
        self._saved_ns = clock.monotonic_ns()
        self._saved_findings = _findings_of(predictor)
        self._alarms: tuple[Alarm, ...] = ()
        self._saved_alarms: tuple[object, ...] = ()
        self._state_writer, self._alarm_writer = _Writer("learned state"), _Writer("open alarms")

    def on_output(self, output: Output, t_mono_ns: int) -> None:
        """Save what was learned where the last time is long ago, or a finding came or went."""
        is_due = t_mono_ns - self._saved_ns > EVERY_S * 1e9 or _findings_of(self._predictor) != self._saved_findings
        if output.snapshot is not None and is_due:
            self._begin()

    def on_alarms(self, output: Output, t_mono_ns: int) -> None:
        """Save the open alarms where one began, ended, or was acknowledged or explained."""
        if output.snapshot is None:
            return
        self._alarms = output.snapshot.alarms
        if (
            self._alarms_path is not None
            and _open(self._alarms) != self._saved_alarms
            and not self._alarm_writer.is_busy
        ):
            self._save_alarms(self._alarms_path)

    def save(self) -> None:
        """Save now; nothing before the first estimate, or the first snapshot."""
        self._state_writer.wait()
        self._begin()
        self._state_writer.wait()
        if self._alarms_path is not None and (self._alarms or self._saved_alarms):
            self._alarm_writer.wait()
            self._save_alarms(self._alarms_path)
            self._alarm_writer.wait()

    def _save_alarms(self, path: Path) -> None:
        self._saved_alarms = _open(self._alarms)
        self._alarm_writer.begin(save_open_alarms, path, self._alarms)

    def _begin(self) -> None:
        """Save in a thread of its own, unless the disk has not taken the last one yet."""
        self._saved_ns = self._clock.monotonic_ns()
        if self._state_writer.is_busy:
            return
        charge = self._pipeline.charge
        if charge is not None:
            self._saved_findings = _findings_of(self._predictor)
            state = LearnedState(charge, self._predictor.learned_cells, digest_of(self._predictor.cell))
            self._state_writer.begin(save_learned_state, self._path, state)


def _findings_of(predictor: Predictor) -> set[tuple[str, int]]:
    return {(finding.code, finding.cell) for finding in predictor.findings}


def _open(alarms: tuple[Alarm, ...]) -> tuple[object, ...]:
    """What a restart must not lose of alarms; their values change all the time."""
    return tuple((alarm.id, alarm.active, alarm.acknowledged_by, alarm.cause) for alarm in alarms)


def learning_pipeline(
    data: Path, factory: PipelineFactory, clock: Clock, source: Source, serial_url: str | None, can_url: str | None
) -> tuple[Pipeline, LearnedStateSaver]:
    """Return the pipeline of the live source, which goes on from what earlier runs left, and what saves it."""
    battery = factory.battery.battery
    path = data / learned_file(battery.name, is_team=battery == team_battery().battery)
    learned = load_learned_state(path, battery.n_cells, factory.cell)
    predictor = factory.predictor(None if learned is None else learned.cells)
    remembered = None if learned is None else learned.charge
    open_path = data / alarm_file(path.name, is_simulated=source == "simulator")
    alarms = load_open_alarms(open_path, battery.n_cells, len(battery.segments))
    pipeline = factory.pipeline(source, serial_url, can_url, predictor=predictor, remembered=remembered, alarms=alarms)
    return pipeline, LearnedStateSaver(path, pipeline, predictor, clock, open_path)
