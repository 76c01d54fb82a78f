"""All sessions of a folder estimated again: in parallel, resumable, one failed session does not stop the rest."""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from app.errors import ConfigError, ExtraMissing
from app.season.estimates.results import EstimateSet, Results
from app.season.estimates.session import EstimateJob, estimate_session
from app.sessions.errors import SessionError
from app.sessions.info import SessionInfo
from app.sessions.reading.reader import SessionFile
from app.sessions.worker import DAY, Workers

Wanted = Sequence[tuple[EstimateSet, str | None]]  # each set with the text of its cell file


@dataclass(frozen=True)
class EstimateProgress:
    """After each session: `done` of `total`, with `left_s` still to go, None before anything is known."""

    session: str
    done: int
    total: int
    error: str | None
    left_s: float | None


@dataclass
class Outcome:
    """Result of a run; `failed` are sessions with their reasons."""

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
    tell: Callable[[EstimateProgress], None] = lambda _: None,
    again: bool = False,
) -> Outcome:
    """Estimate every session of which a result is missing, and keep each result as soon as it is there.

    Args:
        sessions: finished ones, in the order in which they are begun.
        wanted: the sets to make.
        filter_name: of the filter.
        results: where they go.
        engine: what runs the tasks.
        tell: called after each session.
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
            job = EstimateJob(str(info.path.resolve()), tuple(text for _, text in lacking), filter_name)
            tasks.append(_Task(info, [made for made, _ in lacking], job))
        else:
            outcome.kept.append(info.id)
    all_bytes = max(sum(task.info.size_bytes for task in tasks), 1)
    done_bytes = 0

    def settle(task: _Task, estimates: list[dict[str, Any]] | None, error: str | None) -> None:
        nonlocal done_bytes
        done_bytes += task.info.size_bytes
        if estimates is None:
            outcome.failed[task.info.id] = error or "?"
        else:
            for made, result in zip(task.sets, estimates, strict=True):
                results.write(made, result)
                outcome.processor_s += result["processor_s"]
            outcome.estimated.append(task.info.id)
        spent_s = time.monotonic() - began_s
        left_s = spent_s * (all_bytes - done_bytes) / done_bytes if done_bytes else None
        done = len(outcome.estimated) + len(outcome.failed)
        tell(EstimateProgress(task.info.id, done, len(tasks), error, left_s))

    _run(tasks, engine, settle)
    outcome.took_s = time.monotonic() - began_s
    return outcome


@dataclass(frozen=True)
class _Task:
    info: SessionInfo
    sets: list[EstimateSet]
    job: EstimateJob


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
                results, error = _outcome(future)
                settle(running.pop(future), results, None if error is None else str(error) or type(error).__name__)
    finally:
        for future in running:
            future.cancel()


def _outcome(future: Future[Any]) -> tuple[Any, BaseException | None]:
    try:
        return future.result(), None
    except (Exception, CancelledError) as error:  # noqa: BLE001 (whatever a session does to the code that reads it)
        return None, error


CONNECT_S = 20.0
DASK = "dask://"


@dataclass(frozen=True)
class Engine:
    """`submit` begins a call of a function; `window` is how many are begun at once."""

    submit: Callable[..., Future[Any]]
    window: int


@contextmanager
def open_engine(url: str, processes: int | None = None) -> Iterator[Engine]:
    """Open `processes`, or `dask://HOST:PORT`, and close it at the end.

    Raises:
        ConfigError: the URL is neither, or nobody answers there.
        ExtraMissing: `distributed` is not installed.
    """
    if url == "processes":
        count = processes or os.cpu_count() or 1
        with closing(Workers(count, most_idle=count)) as workers:
            yield Engine(partial(workers.start, DAY), count)
        return
    address = url.removeprefix(DASK)
    if not url.startswith(DASK) or ":" not in address:
        raise ConfigError("--engine", url, "processes, or dask://HOST:PORT")
    try:
        from distributed import Client
    except ImportError as error:
        raise ExtraMissing("a Dask cluster", "distributed", "cluster") from error
    try:
        client: Any = Client(f"tcp://{address}", timeout=CONNECT_S, set_as_default=False)  # type: ignore[no-untyped-call]
    except (OSError, TimeoutError) as error:
        raise ConfigError("--engine", url, f"a Dask scheduler that answers: {error}") from error
    try:
        # a task of a worker that is lost is given to another one, as often as the scheduler allows
        window = max(4 * sum(client.nthreads().values()), 64)
        yield Engine(client.get_executor(pure=False).submit, window)
    finally:
        with suppress(OSError, TimeoutError):
            client.close(timeout=5)
