"""The service's side: hands jobs to worker processes, ends one that takes too long, keeps an idle one for a while."""

import os
import pickle
import subprocess
import threading
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

from app.errors import LimitExceeded, NotNow, WorkerEnded, rebuilt
from app.sessions.worker.child_process import command_of
from app.sessions.worker.limits import Limits
from app.words import Message, Quantity

AT_ONCE = 2  # a long import and what somebody looks at meanwhile
WAITING = 8
KEPT_S = 180.0  # somebody who looks at the season reads for minutes between two answers
_ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
_LITTLE_MEMORY = {"ARROW_DEFAULT_MEMORY_POOL": "system", "MALLOC_ARENA_MAX": "2"}  # its own pool maps 1 GB at once
P = ParamSpec("P")
T = TypeVar("T")


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


class Workers:
    """Runs functions of modules, with arguments that can be pickled, in processes with limits."""

    def __init__(self) -> None:
        self._free = threading.Semaphore(AT_ONCE)
        self._lock = threading.Lock()
        self._waiting = 0
        self._idle: list[_Worker] = []
        self._busy: set[_Worker] = set()
        self._sweeper: threading.Timer | None = None
        self._is_closed = False

    def run(self, limits: Limits, function: Callable[P, T], *args: P.args, **named: P.kwargs) -> T:
        """Return what `function` returns.

        Raises:
            LimitExceeded: it needed more memory or time than `limits`.
            WorkerEnded: the process was killed, or crashed.
            NotNow: too many others wait, or the service ends.
            Exception: what `function` raised.
        """
        return self._run((function, args, named, limits, False), lambda: None)  # type: ignore[no-any-return]

    def run_with_progress(
        self, limits: Limits, function: Callable[..., T], on_progress: Callable[..., None], *args: Any, **named: Any
    ) -> T:
        """Same, of a function that takes `on_progress`, which is called here."""
        return self._run((function, args, named, limits, True), on_progress)  # type: ignore[no-any-return]

    def close(self) -> None:
        """End every process; jobs under way fail."""
        with self._lock:
            self._is_closed = True
            for worker in self._busy:
                worker.process.kill()  # the thread that waits for it does the rest
            if self._sweeper is not None:
                self._sweeper.cancel()
        self._sweep()

    def _run(self, job: tuple[Any, ...], on_progress: Callable[..., None]) -> Any:
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
                return worker.run(job, job[3].wall_s, on_progress)
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
            if worker.process.poll() is not None or self._is_closed or self._idle:
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
