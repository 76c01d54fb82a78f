"""The service and its simulated car in processes that start at once: forked from one that has imported everything.

`python -m app.cli serve` spends a second on its imports, its simulator another, and the tests start both a hundred
times. multiprocessing's fork server imports once. What runs afterwards is what a command line starts.
"""

import contextlib
import ctypes
import importlib
import os
import signal
import subprocess
import sys
import threading
import time
import traceback
import types
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import TextIO

from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from app.sessions.worker import command_of

CONTEXT = get_context("forkserver")
CONTEXT.set_forkserver_preload(["tests.forked", "tests.warmed"])
PARENTS_THREADS = 2  # threads of a service that starts its car before it has others
POLL_S = 0.01
PLUGGED = "TESTS_PLUGGED"  # paths that a program finds plugged in as adapters on USB, joined by os.pathsep
MODULE_AT = command_of("MODULE").index("MODULE")  # in a command line of a process of ours
BEFORE_OTHERS = -10  # nice(2)
PR_SET_PDEATHSIG = 1  # prctl(2)


class ForkedSimulator:
    """The simulated car that a service starts; to it the part of `subprocess.Popen` that it uses."""

    def __init__(self, command: list[str]) -> None:
        stdin, self._stdin = os.pipe()
        output, stdout = os.pipe()
        self.returncode: int | None = None
        self.pid = os.fork()
        if self.pid == 0:
            _become(command[MODULE_AT], command[MODULE_AT + 1 :], stdin, stdout)
        os.close(stdin)
        os.close(stdout)
        self.stdout = os.fdopen(output, "rb")

    def __enter__(self) -> "ForkedSimulator":
        return self

    def __exit__(self, *_: object) -> None:
        self.stdout.close()
        self.wait()
        os.close(self._stdin)

    def poll(self) -> int | None:
        """The exit code, None while it runs."""
        if self.returncode is None:
            found, status = os.waitpid(self.pid, os.WNOHANG)
            self.returncode = os.waitstatus_to_exitcode(status) if found else None
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """The exit code, once it has ended."""
        until = None if timeout is None else time.monotonic() + timeout
        while (code := self.poll()) is None:
            if until is not None and time.monotonic() > until:
                raise subprocess.TimeoutExpired("simulator.cli", timeout or 0.0)
            time.sleep(POLL_S)
        return code

    def terminate(self) -> None:
        """Ask it to end."""
        if self.poll() is None:
            os.kill(self.pid, signal.SIGTERM)

    def kill(self) -> None:
        """End it."""
        if self.poll() is None:
            os.kill(self.pid, signal.SIGKILL)


class ForkedWorker(ForkedSimulator):
    """The process that a service reads files in, forked before the service has threads."""

    def __init__(self) -> None:
        super().__init__(command_of("app.sessions.worker.process"))
        self.stdin = os.fdopen(self._stdin, "wb")


def _worker_first(first: ForkedWorker) -> types.SimpleNamespace:
    """Stand for `subprocess` where workers are started: the first one is there already."""
    ready = [first]

    def start(command: list[str], **options: object) -> "ForkedWorker | subprocess.Popen[bytes]":
        return ready.pop() if ready else subprocess.Popen(command, **options)

    return types.SimpleNamespace(Popen=start, PIPE=subprocess.PIPE)


def _start_simulator(command: list[str], **options: object) -> "ForkedSimulator | subprocess.Popen[bytes]":
    if threading.active_count() > PARENTS_THREADS:  # a lock that another thread holds would stay locked in a fork
        return subprocess.Popen(command, **options)
    return ForkedSimulator(command)


def _become(module: str, arguments: list[str], stdin: int, stdout: int) -> None:
    """Be a program of its own: its standard input and output, no file of the parent, and its exit code."""
    os.setsid()
    os.dup2(stdin, 0)
    os.dup2(stdout, 1)
    os.closerange(3, 1024)
    sys.stdin, sys.stdout = os.fdopen(0, closefd=False), os.fdopen(1, "w", buffering=1, closefd=False)
    code = 1
    try:
        code = importlib.import_module(module).main(arguments)
    except Exception:
        traceback.print_exc()
        raise
    finally:
        os._exit(code)


def _end_with_parent() -> None:
    """Be killed when the fork server ends: tests that were interrupted leave no service behind (Linux only)."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def go_first() -> None:
    """Be scheduled before tests and browsers that fill the machine: a car and its service have moments to keep.

    Where that is not allowed (it takes root, in a container the right to it), they wait like everybody.
    """
    with contextlib.suppress(OSError):
        os.nice(BEFORE_OTHERS)


def _plugged(path: str) -> ListPortInfo:
    """Return what pySerial tells of an adapter; by itself it lists no pseudo-terminal."""
    port = ListPortInfo(path)
    port.vid, port.description = 0x0403, "FT232R USB UART"
    return port


def _run(module: str, arguments: list[str], environment: dict[str, str], output: Connection) -> None:
    """Be the program of a module with these arguments, everything it says on one pipe."""
    from app.service import simulator_process
    from app.sessions.worker import workers

    _end_with_parent()
    go_first()
    os.dup2(output.fileno(), 1)
    os.dup2(output.fileno(), 2)
    output.close()
    sys.stdout, sys.stderr = (os.fdopen(number, "w", buffering=1, closefd=False) for number in (1, 2))
    os.environ.clear()
    os.environ.update(environment)
    if ports := os.environ.get(PLUGGED):
        list_ports.comports = lambda: [_plugged(path) for path in ports.split(os.pathsep)]
    simulator_process.subprocess = types.SimpleNamespace(
        Popen=_start_simulator, PIPE=subprocess.PIPE, TimeoutExpired=subprocess.TimeoutExpired
    )
    if arguments[:1] == ["serve"]:
        workers.subprocess = _worker_first(ForkedWorker())
    sys.exit(importlib.import_module(module).main(arguments))


def start_program(
    module: str, arguments: list[str], environment: dict[str, str] | None = None
) -> tuple[BaseProcess, TextIO]:
    """Start what `python -m MODULE` starts; return the process and what it will say."""
    reader, writer = CONTEXT.Pipe(duplex=False)
    process = CONTEXT.Process(
        target=_run, args=(module, arguments, dict(environment or os.environ), writer), daemon=True
    )
    process.start()
    writer.close()
    lines = os.fdopen(os.dup(reader.fileno()))
    reader.close()
    return process, lines
