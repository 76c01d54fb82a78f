"""The season lake of a service: made when a session closes, and asked in SQL. Both by processes of their own.

So neither takes memory, time or the interpreter from what reads, estimates and records: a build runs at the lowest
priority, a question is killed where it passes its limits.
"""

from __future__ import annotations

import json
import logging
import os
import pickle
import subprocess
import tempfile
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, TypeVar

from app.errors import AppError, ExtraMissing, NotNow
from app.season.lake.arrow import name_of_table
from app.season.lake.place import Place
from app.season.lake.schema import MARK
from app.season.store.store import Limits, QueryFailed
from app.sessions.storage.files import SUFFIX
from app.sessions.worker.child_process import command_of
from app.telemetry import Event
from app.words import Message

log = logging.getLogger(__name__)
CLOSING: Final = ("recording-stopped", "recording-split")  # events after which there is a session more
NEEDED: Final = ("duckdb", "fsspec", "pyarrow")
END_S: Final = 5.0
NICE: Final = 19  # of a build: the lowest priority
START_S: Final = 20.0  # a question's process may take so long to start, on a busy Raspberry Pi
ANSWER_MB: Final = 16  # of an answer as JSON, of which this process holds some copies
REMEMBERED: Final = 8  # answers: some words and cars
_MB: Final = 1 << 20
T = TypeVar("T")
BOX: Final = Limits(seconds=20.0, memory_mb=512, rows=5000)


class SeasonLake:
    """Builds in a thread that waits for its process; `query` may be called from any thread, one at a time."""

    def __init__(self, data: Path, place: str | None, *, builds: bool) -> None:
        """Keep the lake of a data folder at `place`, a folder or URL, or in `lake` of it.

        Raises:
            ConfigError: `place` is no folder, or cannot be written into.
        """
        self.place = place or str(data / "lake")
        if place and not self.missing:
            Place(place).make()
        self._data = data
        self.builds = builds and not self.missing
        self._wanted, self._ending = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="season", daemon=True)
        self._process: subprocess.Popen[str] | None = None
        self._built_s = 0.0
        self._asking = threading.Lock()
        self._query_process: subprocess.Popen[bytes] | None = None
        self._answers: OrderedDict[bytes, Any] = OrderedDict()  # the last one asked for last
        self._remembering = threading.Lock()

    @property
    def missing(self) -> list[str]:
        """Packages of the extra `season` that are not installed."""
        return [name for name in NEEDED if find_spec(name) is None]

    def start(self) -> None:
        """Begin; what was closed after the last build is built."""
        if self.builds:
            if self._is_behind(self._data.joinpath("sessions").glob(f"*{SUFFIX}")):
                self._wanted.set()
            self._thread.start()

    def stop(self) -> None:
        """End; a build under way is ended too, and leaves the lake whole; so is a question."""
        self._ending.set()
        self._wanted.set()
        if (asked := self._query_process) is not None:
            asked.kill()
        if (process := self._process) is not None:
            process.terminate()
        if self._thread.is_alive():
            self._thread.join(END_S)

    @property
    def is_building(self) -> bool:
        """Whether sessions are on their way into the lake."""
        return self.builds and (self._wanted.is_set() or self._process is not None)

    def update(self, closed: Iterable[Path]) -> None:
        """Build where one of these sessions has changed since the last build began."""
        if self.builds and not self.is_building and self._is_behind(closed):
            self._wanted.set()

    def on_event(self, event: Event) -> None:
        """Build where a session was closed."""
        if event.code in CLOSING:
            self._wanted.set()

    def query(self, question: str, given: Mapping[str, str], limits: Limits = BOX) -> dict[str, Any]:
        """Answer one SELECT or a question by its name: `columns`, `rows` and `is_cut`.

        Raises:
            ExtraMissing: the extra `season` is not installed.
            NotNow: another question is being answered, or the service ends.
            QueryFailed: it is wrong, not allowed, or passes a limit.
        """
        if missing := self.missing:
            raise ExtraMissing(Message("the-season-lake"), missing[0], "season")
        if not self._asking.acquire(blocking=False):
            raise NotNow(Message("query-under-way"))
        try:
            return self._ask(question, given, limits)
        finally:
            self._asking.release()

    def remembered(self, question: tuple[object, ...], make: Callable[[], T]) -> T:
        """Return what was answered to a question about the lake as it is; else make it, and remember it.

        Args:
            question: all that the answer hangs on beside the lake; it can be pickled.
            make: the answer.
        """
        state = self._state()
        if state is None:
            return make()
        key = pickle.dumps((state, question))
        with self._remembering:
            if key in self._answers:
                self._answers.move_to_end(key)
                return self._answers[key]  # type: ignore[no-any-return]
        answer = make()
        with self._remembering:
            self._answers[key] = answer
            while len(self._answers) > REMEMBERED:
                self._answers.popitem(last=False)
        return answer

    def _state(self) -> list[tuple[str, int, int]] | None:
        """Return every session of the lake with its file's time and size; None of a URL, which is asked each time."""
        if "://" in self.place:
            return None
        try:
            marks = sorted(Path(self.place).glob(f"car=*/season=*/session=*/{name_of_table(MARK)}"))
            return [(str(mark), (known := mark.stat()).st_mtime_ns, known.st_size) for mark in marks]
        except OSError:  # one is replaced at this moment
            return None

    def _ask(self, question: str, given: Mapping[str, str], limits: Limits) -> dict[str, Any]:
        values = [part for name, value in given.items() for part in ("--set", f"{name}={value}")]
        most = ("--limit-s", limits.seconds, "--limit-mb", limits.memory_mb, "--limit-rows", limits.rows)
        Place(self.place).make()  # before the first session has ended there is none, and an answer all the same
        arguments = ["query", "--json", "--lake", self.place, *map(str, most), *values, "--", question]
        is_late = threading.Event()
        pipe = subprocess.PIPE
        with subprocess.Popen(_command(arguments), stdin=subprocess.DEVNULL, stdout=pipe, stderr=pipe) as process:
            self._query_process = process
            if self._ending.is_set():
                process.kill()
            assert process.stdout is not None
            assert process.stderr is not None
            watch = threading.Timer(limits.seconds + START_S, _end, (process, is_late))
            watch.daemon = True
            watch.start()
            try:
                output = process.stdout.read(ANSWER_MB * _MB + 1)
                if is_large := len(output) > ANSWER_MB * _MB:
                    process.kill()
                errors = process.stderr.read().decode(errors="replace").strip().removeprefix("voltwall season: ")
                code = process.wait()
            finally:
                watch.cancel()
                self._query_process = None
        if self._ending.is_set():
            raise NotNow(Message("query-ended"))
        if is_large:
            raise QueryFailed(Message("answer-too-large", megabytes=ANSWER_MB))
        if is_late.is_set():
            raise QueryFailed(Message("query-too-long", seconds=limits.seconds))
        if code != 0:
            raise QueryFailed(errors or Message("query-too-large", megabytes=limits.memory_mb))
        answer: dict[str, Any] = json.loads(output)
        return answer

    def _is_behind(self, sessions: Iterable[Path]) -> bool:
        """Whether one has changed since the last build began, by the clock of the disk; of a URL: by the last here.

        That clock stands still for some milliseconds: what changed at the very moment may have been missed.
        """
        mark = Path(self.place) / ".lock"
        try:
            built_s = max(self._built_s, mark.stat().st_mtime if mark.is_file() else 0.0)
            return any(path.stat().st_mtime >= built_s for path in sessions)
        except OSError:
            return False

    def _run(self) -> None:
        while True:
            self._wanted.wait()
            self._wanted.clear()
            if self._ending.is_set():
                return
            try:
                self._build()
            except (OSError, AppError) as error:
                log.warning("season lake: %s", error)
            finally:
                self._process = None

    def _build(self) -> None:
        self._built_s = _disk_s(self._data)
        arguments = command_of("app.season.lake.background", str(self._data), self.place, str(NICE))
        self._process = subprocess.Popen(arguments, stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        if self._ending.is_set():
            self._process.terminate()
        _, errors = self._process.communicate()
        if errors.strip() and not self._ending.is_set():
            log.warning("season lake: %s", errors.strip())


def _disk_s(folder: Path) -> float:
    """Return what the disk takes for now."""
    with tempfile.TemporaryFile(dir=folder) as file:
        return os.fstat(file.fileno()).st_mtime


def _end(process: subprocess.Popen[bytes], is_late: threading.Event) -> None:
    is_late.set()
    process.kill()


def _command(arguments: Sequence[str]) -> list[str]:
    return command_of("app.cli", "season", *arguments)
