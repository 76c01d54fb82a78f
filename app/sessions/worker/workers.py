"""The one runner of jobs: functions of modules in processes of low priority, with limits on memory and time.

It ends a process that takes too long, and keeps an idle one for a while. All that is read from elsewhere, and whatever
takes long, runs here: imports, exports, reports, definitions, inference, balancing, the season and its estimates.
"""

import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final, ParamSpec, TypeVar

from app.errors import LimitExceeded, NotNow, WorkerEnded, rebuilt
from app.words import Message, Quantity

AT_ONCE = 2  # a long import and what somebody looks at meanwhile
WAITING = 8
KEPT_S = 180.0  # somebody who looks at the season reads for minutes between two answers
_ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
_LITTLE_MEMORY = {"ARROW_DEFAULT_MEMORY_POOL": "system", "MALLOC_ARENA_MAX": "2"}  # its own pool maps 1 GB at once
P = ParamSpec("P")
T = TypeVar("T")

MB: Final = 1 << 20
MEMORY_BYTES: Final = 2048 * MB  # or half of the machine's
LEAST_BYTES: Final = 384 * MB
_IMPORT_S, _IMPORT_S_PER_MB = 120, 20

# With `-m` alone Python looks for modules in the working folder first: a file `can.py` there would be run in place of
# python-can. `-P` turns that off; the folder of this package is named instead.
_RUN: Final = (
    "import runpy, sys; folder, module = sys.argv[1:3]; del sys.argv[1:3]; "
    "folder in sys.path or sys.path.insert(0, folder); runpy.run_module(module, run_name='__main__', alter_sys=True)"
)
_ABOVE: Final = __name__.removesuffix("app.sessions.worker.workers")  # in a wheel `voltwall.`
_FOLDER: Final = Path(__file__).resolve().parents[3 + _ABOVE.count(".")]


@dataclass(frozen=True, slots=True)
class JobLimits:
    """Limits of a job's use of the machine.

    Attributes:
        cpu_s: processor time [s].
        memory_bytes: without what the program itself takes [bytes]; None: what `memory_limit` says.
        wall_s: time from its start [s]; None: by the processor time, on a machine that does much else.
    """

    cpu_s: int
    memory_bytes: int | None = None
    wall_s: float | None = None

    @property
    def longest_s(self) -> float:
        """After which its process is ended [s]."""
        return 60.0 + 6.0 * self.cpu_s if self.wall_s is None else self.wall_s


DEFINITIONS = JobLimits(30)  # a DBC, a battery's profile
INSPECTION = JobLimits(120)  # the table in a file
REPORT = JobLimits(180)
EXPORT = JobLimits(600)
DAY: Final = JobLimits(86_400)  # a season built, or one session of it estimated


def import_limits(size_bytes: int) -> JobLimits:
    """Return what the import of a file may use, by its size."""
    return JobLimits(_IMPORT_S + _IMPORT_S_PER_MB * (size_bytes // MB))


@cache
def memory_limit() -> int:
    """Return what a job may take on this machine [bytes]: half of its memory, at most 2 GB."""
    try:
        physical = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):  # Windows
        return MEMORY_BYTES
    return max(LEAST_BYTES, min(MEMORY_BYTES, physical // 2))


def command_of(module: str, *arguments: str) -> list[str]:
    """Return the command line that runs a module as a program of its own, whatever lies in the working folder."""
    return [sys.executable, "-P", "-c", _RUN, str(_FOLDER), _ABOVE + module, *arguments]


class _Worker:
    """One process."""

    def __init__(self) -> None:
        self.process = subprocess.Popen(
            command_of("app.sessions.worker.process"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | _ONE_THREAD | _LITTLE_MEMORY,
        )
        self.is_late = False

    def run(self, job: tuple[Any, ...], wall_s: float, on_progress: Callable[..., None]) -> Any:
        """Return what a job returns, or raise what it raises."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        watch = threading.Timer(wall_s, self._too_late)
        watch.daemon = True
        watch.start()
        try:
            pickle.dump(job, self.process.stdin, pickle.HIGHEST_PROTOCOL)
            self.process.stdin.flush()
            while True:
                kind, value = pickle.load(self.process.stdout)
                if kind != "progress":
                    break
                on_progress(*value)
        except (EOFError, BrokenPipeError, pickle.UnpicklingError) as error:
            self.end()
            if self.is_late:
                raise LimitExceeded(Message("limit-wall-time", limit=Quantity(round(wall_s), "s"))) from error
            raise WorkerEnded(Message("worker-ended", code=self.process.returncode)) from error
        finally:
            watch.cancel()
        if kind == "failed":
            raise rebuilt(*value)
        return value

    def end(self) -> None:
        """Kill it: it keeps nothing but what it works on."""
        self.process.kill()
        self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe is not None:
                try:
                    pipe.close()
                except BrokenPipeError:
                    continue

    def _too_late(self) -> None:
        self.is_late = True
        self.process.kill()


class Job(Future[T]):
    """A job that was started; any thread may wait for it or cancel it."""

    def __init__(self) -> None:
        super().__init__()
        self.set_running_or_notify_cancel()
        self._lock = threading.Lock()
        self._worker: _Worker | None = None
        self._is_cancelled = False

    def begin(self, worker: _Worker) -> None:
        """Note which process works on it; one that was cancelled before ends at once."""
        with self._lock:
            self._worker = worker
            if self._is_cancelled:
                worker.process.kill()

    def cancel(self) -> bool:
        """End its process; then it has failed. False where it had ended before."""
        with self._lock:
            if self.done():
                return False
            self._is_cancelled = True
            if self._worker is not None:
                self._worker.process.kill()
        return True


class Workers:
    """Runs functions of modules, with arguments that can be pickled, in processes with limits."""

    def __init__(self, at_once: int = AT_ONCE, most_idle: int = 1) -> None:
        """Prepare; a process is started when a job needs one, and `most_idle` are kept for the next."""
        self._free = threading.Semaphore(at_once)
        self._most_idle = most_idle
        self._lock = threading.Lock()
        self._waiting = 0
        self._idle: list[_Worker] = []
        self._busy: set[_Worker] = set()
        self._sweeper: threading.Timer | None = None
        self._is_closed = False

    def run(self, limits: JobLimits, function: Callable[P, T], *args: P.args, **named: P.kwargs) -> T:
        """Return what `function` returns.

        Raises:
            LimitExceeded: it needed more memory or time than `limits`.
            WorkerEnded: the process was killed, or crashed.
            NotNow: too many others wait, or the service ends.
            Exception: what `function` raised.
        """
        return self._run((function, args, named, limits, False))  # type: ignore[no-any-return]

    def start(
        self,
        limits: JobLimits,
        function: Callable[..., T],
        *args: Any,
        on_progress: Callable[..., None] | None = None,
        **named: Any,
    ) -> "Job[T]":
        """Same as `run`, in a thread of its own, whose job has what is returned or raised.

        With `on_progress` the function takes one, too: what it is called with there, this one is called with here.
        """
        job: Job[T] = Job()

        def work() -> None:
            try:
                wanted = (function, args, named, limits, on_progress is not None)
                job.set_result(self._run(wanted, on_progress or (lambda: None), job.begin))
            except Exception as error:  # noqa: BLE001  whatever it is, it is the caller's
                job.set_exception(error)

        threading.Thread(target=work, name="job", daemon=True).start()
        return job

    def close(self) -> None:
        """End every process; jobs under way fail."""
        with self._lock:
            self._is_closed = True
            for worker in self._busy:
                worker.process.kill()  # the thread that waits for it does the rest
            if self._sweeper is not None:
                self._sweeper.cancel()
        self._sweep()

    def _run(
        self,
        job: tuple[Any, ...],
        on_progress: Callable[..., None] = lambda: None,
        begin: Callable[[_Worker], None] = lambda worker: None,
    ) -> Any:
        with self._lock:
            if self._is_closed or self._waiting >= WAITING:
                raise NotNow(Message("workers-busy"))
            self._waiting += 1
        try:
            self._free.acquire()
        finally:
            with self._lock:
                self._waiting -= 1
        try:
            worker = self._take()
            try:
                begin(worker)
                return worker.run(job, job[3].longest_s, on_progress)
            finally:
                self._give_back(worker)
        finally:
            self._free.release()

    def _take(self) -> _Worker:
        with self._lock:
            if self._is_closed:
                raise NotNow(Message("workers-busy"))
            worker = self._idle.pop() if self._idle else _Worker()
            self._busy.add(worker)
            return worker

    def _give_back(self, worker: _Worker) -> None:
        with self._lock:
            self._busy.discard(worker)
            if worker.process.poll() is not None or self._is_closed or len(self._idle) >= self._most_idle:
                keeps = False
            else:
                self._idle.append(worker)
                keeps = True
                if self._sweeper is not None:
                    self._sweeper.cancel()
                self._sweeper = threading.Timer(KEPT_S, self._sweep)
                self._sweeper.daemon = True
                self._sweeper.start()
        if not keeps:
            worker.end()

    def _sweep(self) -> None:
        with self._lock:
            ended = self._idle[:]
            self._idle.clear()
        for worker in ended:
            worker.end()
