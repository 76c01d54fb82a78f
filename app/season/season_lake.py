"""The season lake of a service: made when a session closes, and asked in SQL, both in worker processes."""

from __future__ import annotations

import json
import logging
import os
import pickle
import tempfile
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, TypeVar

from app.errors import AppError, ExtraMissing, LimitExceeded, NotNow, WorkerEnded
from app.season.lake.build import build_new
from app.season.lake.place import LakeFolder
from app.season.lake.schema import MARK, name_of_table
from app.season.store.questions import answer_at
from app.season.store.store import QueryFailed, QueryLimits
from app.sessions.storage.files import SUFFIX
from app.sessions.worker import DAY, JobLimits, Workers
from app.telemetry import Event
from app.words import Message, render

log = logging.getLogger(__name__)
CLOSING: Final = ("recording-stopped", "recording-split")  # events after which there is a session more
NEEDED: Final = ("duckdb", "fsspec", "pyarrow")
START_S: Final = 20.0  # a question's process may take so long to start, on a busy Raspberry Pi
ANSWER_MB: Final = 16  # megabytes of an answer as JSON, of which this process holds some copies
REMEMBERED: Final = 8  # answers: some words and cars
T = TypeVar("T")
BOX: Final = QueryLimits(seconds=20.0, memory_mb=512, rows=5000)


class SeasonLake:
    """Builds one after the other; `query` may be called from any thread, one at a time."""

    def __init__(self, data: Path, place: str | None, workers: Workers, *, builds: bool) -> None:
        """Keep the lake of a data folder at `place`, a folder or URL, or in `lake` of it; `workers` answer questions.

        Raises:
            ConfigError: `place` is no folder, or cannot be written into.
        """
        self.place = place or str(data / "lake")
        if place and not self.missing:
            LakeFolder(place).make()
        self._data = data
        self.builds = builds and not self.missing
        self._workers = workers
        self._builder = Workers(1, most_idle=0)
        self._lock = threading.Lock()
        self._is_wanted = self._is_under_way = self._is_ending = False
        self._built_s = 0.0
        self._asking = threading.Lock()
        self._answers: OrderedDict[bytes, Any] = OrderedDict()  # the last one asked for last
        self._remembering = threading.Lock()

    @property
    def missing(self) -> list[str]:
        """Packages of the extra `season` that are not installed."""
        return [name for name in NEEDED if find_spec(name) is None]

    def start(self) -> None:
        """Begin; what was closed after the last build is built."""
        self.update(self._data.joinpath("sessions").glob(f"*{SUFFIX}"))

    def stop(self) -> None:
        """End; a build under way is ended too, and leaves the lake whole."""
        self._is_ending = True
        self._builder.close()

    @property
    def is_building(self) -> bool:
        """Return whether sessions are on their way into the lake."""
        return self._is_under_way

    def update(self, closed: Iterable[Path]) -> None:
        """Build where one of these sessions has changed since the last build began."""
        if self.builds and not self.is_building and self._is_behind(closed):
            self._build_soon()

    def on_event(self, event: Event) -> None:
        """Build where a session was closed."""
        if self.builds and event.code in CLOSING:
            self._build_soon()

    def query(self, question: str, given: Mapping[str, str], limits: QueryLimits = BOX) -> dict[str, Any]:
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
        most = JobLimits(2 * int(limits.seconds) + 30, wall_s=limits.seconds + START_S)
        try:
            text = self._workers.run(most, answer_at, self.place, question, dict(given), limits, ANSWER_MB)
        except LimitExceeded as error:
            if error.message.code == "limit-memory":
                raise QueryFailed(Message("query-too-large", megabytes=limits.memory_mb)) from error
            raise QueryFailed(Message("query-too-long", seconds=limits.seconds)) from error
        except WorkerEnded as error:
            if self._is_ending:
                raise NotNow(Message("query-ended")) from error
            raise QueryFailed(Message("query-too-large", megabytes=limits.memory_mb)) from error
        finally:
            self._asking.release()
        answer: dict[str, Any] = json.loads(text)
        return answer

    def remembered(self, question: tuple[object, ...], make: Callable[[], T]) -> T:
        """Return what was answered to a question about the lake as it is; else make it, and remember it.

        Args:
            question: all that the answer depends on but the lake; it can be pickled.
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
            return [(str(mark), (stat := mark.stat()).st_mtime_ns, stat.st_size) for mark in marks]
        except OSError:  # one is replaced at this moment
            return None

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

    def _build_soon(self) -> None:
        """Build now, or once more when the build under way has ended."""
        with self._lock:
            self._is_wanted = True
            if self._is_under_way:
                return
            self._is_under_way = True
        threading.Thread(target=self._build, name="season", daemon=True).start()

    def _build(self) -> None:
        while self._takes_turn():
            try:
                self._built_s = _disk_s(self._data)
                for line in self._builder.run(DAY, build_new, self.place, self._data):
                    log.warning("season lake: %s", render(line))
            except (OSError, AppError) as error:
                if not self._is_ending:
                    log.warning("season lake: %s: %s", self.place, error)

    def _takes_turn(self) -> bool:
        with self._lock:
            self._is_under_way = self._is_wanted and not self._is_ending
            self._is_wanted = False
            return self._is_under_way


def _disk_s(folder: Path) -> float:
    """Return what the disk takes for now."""
    with tempfile.TemporaryFile(dir=folder) as file:
        return os.fstat(file.fileno()).st_mtime
