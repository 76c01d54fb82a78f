"""Leaves a process a share of a core: by a control group where one can be made, else by stopping it again and again."""

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

PERIOD_S = 0.1
GROUPS = Path("/sys/fs/cgroup")


@contextmanager
def starved(pid: int, share: float) -> Iterator[str]:
    """Let a process run `share` of each tenth of a second, for the length of a with-block; yield how."""
    with suppress(OSError):
        group = _group(share)
        try:
            (group / "cgroup.procs").write_text(str(pid))
            yield "control group"
        finally:
            with suppress(OSError):
                (group.parent / "cgroup.procs").write_text(str(pid))
            with suppress(OSError):
                group.rmdir()
        return
    is_over = threading.Event()
    thread = threading.Thread(target=_stop_and_go, args=(pid, share, is_over))
    thread.start()
    try:
        yield "stopped and continued"
    finally:
        is_over.set()
        thread.join()


def _group(share: float) -> Path:
    """Return a new control group, version 1 or 2.

    Raises:
        OSError: none can be made here.
    """
    period_us = round(1e6 * PERIOD_S)
    first = GROUPS / "cpu"
    group = (first if first.is_dir() else GROUPS) / f"voltwall-{os.getpid()}"
    group.mkdir(exist_ok=True)
    try:
        if first.is_dir():
            (group / "cpu.cfs_period_us").write_text(str(period_us))
            (group / "cpu.cfs_quota_us").write_text(str(round(period_us * share)))
        else:
            (group / "cpu.max").write_text(f"{round(period_us * share)} {period_us}")
    except OSError:
        group.rmdir()
        raise
    return group


def _stop_and_go(pid: int, share: float, is_over: threading.Event) -> None:
    with suppress(ProcessLookupError):
        while not is_over.is_set():
            os.kill(pid, signal.SIGCONT)
            is_over.wait(PERIOD_S * share)
            os.kill(pid, signal.SIGSTOP)
            is_over.wait(PERIOD_S * (1 - share))
        os.kill(pid, signal.SIGCONT)
