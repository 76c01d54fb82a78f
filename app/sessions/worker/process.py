"""The worker's side: takes a job at a time from its standard input, answers on its standard output, in pickles.

Only the service writes to it and reads from it. It ends when its input ends, so that none outlives the service.
"""

import contextlib
import os
import pickle
import queue
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

from app.errors import AppError, LimitExceeded, rebuilt
from app.sessions.worker.workers import MB, JobLimits, memory_limit
from app.words import Message, Quantity

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

NICENESS = 15
Job = tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any], JobLimits, bool]


class OutOfTime(BaseException):
    """Raised wherever the job is; no handler of mere errors keeps it."""


def main(_: Sequence[str] = ()) -> NoReturn:
    """Work until the input ends."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is no answer
    with contextlib.suppress(AttributeError, OSError):
        os.nice(NICENESS)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl+C is for the service, which ends this one
    if resource is not None:
        signal.signal(signal.SIGXCPU, _out_of_time)
    jobs: queue.SimpleQueue[Job] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(sys.stdin.buffer, jobs), daemon=True).start()
    while True:
        function, arguments, named, limits, tells = jobs.get()
        if tells:
            named = named | {"on_progress": lambda *values: _send(answers, "progress", values)}
        _send(answers, *_work(function, arguments, named, limits))


def _listen(requests: BinaryIO, jobs: "queue.SimpleQueue[Job]") -> None:
    with contextlib.suppress(EOFError, OSError, pickle.UnpicklingError):
        while True:
            jobs.put(pickle.load(requests))
    os._exit(0)


def _work(
    function: Callable[..., Any], arguments: tuple[Any, ...], named: dict[str, Any], limits: JobLimits
) -> tuple[str, object]:
    memory = limits.memory_bytes or memory_limit()
    try:
        _limit(limits.cpu_s, memory)
        try:
            return "done", function(*arguments, **named)
        finally:
            _limit(None, None)
    except OutOfTime:
        return "failed", LimitExceeded(Message("limit-time", limit=Quantity(limits.cpu_s, "s")))
    except (MemoryError, RecursionError) as error:
        if isinstance(error, RecursionError):
            return "failed", LimitExceeded(Message("limit-nesting", limit=sys.getrecursionlimit()))
        return "failed", LimitExceeded(Message("limit-memory", limit=Quantity(memory // MB, "MB")))
    except Exception as error:  # noqa: BLE001  whatever it is, the caller learns it
        return "failed", error


def _limit(cpu_s: int | None, memory_bytes: int | None) -> None:
    """Set both limits on top of what is used by now; None takes one away.

    Memory is what can be written to (RLIMIT_DATA; Linux 4.7): allocators reserve gigabytes of addresses for nothing.
    """
    if resource is None:
        return
    used = resource.getrusage(resource.RUSAGE_SELF)
    soft = resource.RLIM_INFINITY if cpu_s is None else int(used.ru_utime + used.ru_stime) + 1 + cpu_s
    resource.setrlimit(resource.RLIMIT_CPU, (soft, resource.getrlimit(resource.RLIMIT_CPU)[1]))
    with contextlib.suppress(OSError, ValueError, FileNotFoundError):  # macOS keeps no such limit
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[5])
        size = resource.RLIM_INFINITY if memory_bytes is None else pages * resource.getpagesize() + memory_bytes
        resource.setrlimit(resource.RLIMIT_DATA, (size, resource.getrlimit(resource.RLIMIT_DATA)[1]))


def _out_of_time(*_: object) -> None:
    raise OutOfTime


def _send(answers: BinaryIO, kind: str, value: object) -> None:
    sent = (type(value), value.args, vars(value)) if isinstance(value, BaseException) else value
    try:
        body = pickle.dumps((kind, sent), pickle.HIGHEST_PROTOCOL)
        rebuilt(*pickle.loads(body)[1]) if kind == "failed" else None
    except Exception:  # noqa: BLE001  of an error that cannot be sent its text is
        error = AppError(f"{type(value).__name__}: {value}")
        body = pickle.dumps(("failed", (AppError, error.args, vars(error))))
    answers.write(body)
    answers.flush()


if __name__ == "__main__":
    main()
