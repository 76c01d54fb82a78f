"""All sessions of a folder estimated again: in parallel, resumable, one failed session does not stop the rest."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from dataclasses import dataclass, field
from typing import Any

from app.season.estimates.executor import Engine
from app.season.estimates.results import EstimateSet, Results
from app.season.estimates.session import Job, estimate_session
from app.sessions.errors import SessionError
from app.sessions.info import SessionInfo
from app.sessions.reading.reader import SessionFile

Wanted = Sequence[tuple[EstimateSet, str | None]]  # each set with the text of its cell file


@dataclass(frozen=True)
class Progress:
    """After each session: `done` of `total`, with `left_s` still to go, None before anything is known."""

    session: str
    done: int
    total: int
    error: str | None
    left_s: float | None


@dataclass
class Outcome:
    """What a run did; `failed` are sessions with their reasons."""

    estimated: list[str] = field(default_factory=list)
    kept: list[str] = field(default_factory=list)
    failed: dict[str, str] = field(default_factory=dict)
    took_s: float = 0.0
    processor_s: float = 0.0


def estimate_season(
    sessions: Sequence[SessionInfo],
    wanted: Wanted,
    filter_name: str,
    results: Results,
    engine: Engine,
    tell: Callable[[Progress], None] = lambda _: None,
    again: bool = False,
) -> Outcome:
    """Estimate every session of which a result is missing, and keep each result as soon as it is there.

    Args:
        sessions: finished ones, in the order in which they are begun.
        wanted: the sets to make.
        filter_name: of the filter.
        results: where they go.
        engine: what runs the tasks.
        tell: is told after each session.
        again: also those of which there is a result.
    """
    began_s, outcome = time.monotonic(), Outcome()
    for made, _ in wanted:
        results.begin(made)
    tasks: list[_Task] = []
    for info in sessions:
        content = None if again else _content(info)
        lacking = [pair for pair in wanted if content is None or not results.has(pair[0], info.id, content)]
        if lacking:
            job = Job(str(info.path.resolve()), tuple(text for _, text in lacking), filter_name)
            tasks.append(_Task(info, [made for made, _ in lacking], job))
        else:
            outcome.kept.append(info.id)
    all_bytes = max(sum(task.info.size_bytes for task in tasks), 1)
    done_bytes = 0

    def settle(task: _Task, found: list[dict[str, Any]] | None, error: str | None) -> None:
        nonlocal done_bytes
        done_bytes += task.info.size_bytes
        if found is None:
            outcome.failed[task.info.id] = error or "?"
        else:
            for made, result in zip(task.sets, found, strict=True):
                results.write(made, result)
                outcome.processor_s += result["processor_s"]
            outcome.estimated.append(task.info.id)
        spent_s = time.monotonic() - began_s
        left_s = spent_s * (all_bytes - done_bytes) / done_bytes if done_bytes else None
        done = len(outcome.estimated) + len(outcome.failed)
        tell(Progress(task.info.id, done, len(tasks), error, left_s))

    _run(tasks, engine, settle)
    outcome.took_s = time.monotonic() - began_s
    return outcome


@dataclass(frozen=True)
class _Task:
    info: SessionInfo
    sets: list[EstimateSet]
    job: Job


def _content(info: SessionInfo) -> str | None:
    """What the session holds; None where it is damaged, as whoever estimates it will say."""
    try:
        with SessionFile(info.path) as session:
            return session.content_digest
    except SessionError:
        return None


def _run(tasks: Sequence[_Task], engine: Engine, settle: Callable[[_Task, Any, str | None], None]) -> None:
    """Run tasks a window at a time; where this is left early, those that were not begun are cancelled."""
    waiting, running = deque(tasks), dict[Future[Any], _Task]()
    try:
        while waiting or running:
            while waiting and len(running) < engine.window:
                task = waiting.popleft()
                running[engine.submit(estimate_session, task.job)] = task
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                found, error = _outcome(future)
                settle(running.pop(future), found, None if error is None else str(error) or type(error).__name__)
    finally:
        for future in running:
            future.cancel()


def _outcome(future: Future[Any]) -> tuple[Any, BaseException | None]:
    try:
        return future.result(), None
    except (Exception, CancelledError) as error:  # noqa: BLE001 (whatever a session does to the code that reads it)
        return None, error
