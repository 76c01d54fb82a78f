"""The event log: what happened, kept over restarts in one SQLite file.

One thread writes it; readers have a connection of their own and never wait for what the disk does not take.
"""

import logging
import sqlite3
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import astuple, dataclass, replace
from itertools import count
from operator import attrgetter
from pathlib import Path
from typing import Any, TypeVar

import orjson

from app.clock import Clock
from app.sessions.errors import RecordingFailed, SessionError
from app.sessions.storage.database import EVENTS
from app.sessions.storage.own_database import OnSetAside, OwnDatabase, nobody_asks
from app.telemetry import Event
from app.words import Message, Quantity, condition_of, render

T = TypeVar("T")

MAX_UNWRITTEN = 10_000  # events kept in memory while the disk takes none
RETRY_S = 1.0
ACKNOWLEDGED_S = 1.0  # then it is refused
_GIVEN = "id, t_wall_ns, uptime_ms, severity, code, text, cell, value, limit_value, unit, who, message"
_COLUMNS = f"{_GIVEN}, acknowledged_by, acknowledged_ns"
_INSERT = f"INSERT INTO events ({_GIVEN}) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)"
log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class LoggedEvent:
    """One line of the log; `value` and `limit` in `unit`."""

    id: int
    t_wall_ns: int  # since 1970 UTC
    uptime_ms: int | None  # the master's clock
    severity: str
    code: str
    text: str
    cell: int | None
    value: float | None
    limit: float | None
    unit: str
    who: str | None
    message: str | None  # in JSON; None in rows of before version 2, which have their text alone
    acknowledged_by: str | None = None
    acknowledged_ns: int | None = None


def _logged(row: Sequence[Any]) -> LoggedEvent:
    """A row of the file; the code of a condition is today's."""
    logged = LoggedEvent(*row)
    return replace(logged, code=condition_of(logged.code))


class EventLog:
    """An append-only list of events. All methods may be called from any thread."""

    def __init__(
        self, path: Path, clock: Clock, on_set_aside: OnSetAside = nobody_asks, segments: Sequence[int] = ()
    ) -> None:
        """Open the log, or begin one; a damaged one is set aside. English texts name cells by `segments`.

        Raises:
            SchemaTooNew: the file is a newer program's.
            SessionError: it cannot be created.
        """
        self._clock = clock
        self._segments = segments
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._database = OwnDatabase(path, EVENTS, on_set_aside)
            last = self._database.run(_last_id)
        except (OSError, sqlite3.Error) as error:
            raise SessionError(Message("event-log", error=f"{path}: {error}")) from error
        self._lock = threading.Lock()  # guards the attributes below
        self._is_queued = False  # a write of all that waits
        self._ids = count(last + 1)
        self._last_id = last
        self._unwritten: list[LoggedEvent] = []
        self._dropped = 0
        self._error: Message | None = None
        self._executor = ThreadPoolExecutor(max_workers=1, thread_name_prefix="event-log")

    @property
    def last_id(self) -> int:
        """Id of the newest event, 0 without any."""
        return self._last_id

    @property
    def error(self) -> Message | None:
        """Return why events are waiting in memory, None when all are on the disk."""
        return self._error

    def append(self, event: Event, uptime_ms: int | None = None) -> int:
        """Add an event and return its id; ids grow over all restarts."""
        text, message = render(event.message, self._segments), _message_json(event)
        log.log(logging.INFO if event.severity == "info" else logging.WARNING, "%s: %s", event.code, text)
        event_id = next(self._ids)
        self._last_id = max(self._last_id, event_id)
        logged = LoggedEvent(
            event_id,
            event.time_ns,
            uptime_ms,
            event.severity,
            event.code,
            text,
            event.cell,
            event.value,
            event.limit,
            event.unit,
            event.who,
            message,
        )
        with self._lock:
            self._unwritten.append(logged)
            if len(self._unwritten) > MAX_UNWRITTEN:
                del self._unwritten[0]
                self._dropped += 1
        if not self._queue_write():  # whoever still has something to say at the end must not fail by it
            log.warning("event after the event log was closed: %s", text)
        return event_id

    def query(
        self,
        after: int = 0,
        limit: int = 200,
        severity: str | None = None,
        cell: int | None = None,
        up_to: int | None = None,
    ) -> list[LoggedEvent]:
        """Return at most `limit` events with an id above `after`, and none above `up_to`, newest first.

        Raises:
            SessionError: the file cannot be read.
        """
        with self._lock:  # before the file is read: what is written meanwhile is in one of both
            waiting = self._unwritten.copy()
        query = (
            f"SELECT {_COLUMNS} FROM events WHERE id > :after AND (:up_to IS NULL OR id <= :up_to)"
            " AND (:severity IS NULL OR severity = :severity) AND (:cell IS NULL OR cell = :cell)"
            " ORDER BY id DESC LIMIT :limit"
        )
        given = {"after": after, "up_to": up_to, "severity": severity, "cell": cell, "limit": limit}
        try:
            rows = self._database.read(
                lambda connection: connection.execute(query, given).fetchall(),
                lambda work: self._in_thread(work, ACKNOWLEDGED_S),
            )
        except (sqlite3.Error, TimeoutError) as error:
            raise SessionError(Message("event-log", error=str(error))) from error
        events = {
            event.id: event
            for event in waiting
            if event.id > after
            and (up_to is None or event.id <= up_to)
            and severity in (None, event.severity)
            and cell in (None, event.cell)
        } | {row[0]: _logged(row) for row in rows}
        return sorted(events.values(), key=attrgetter("id"), reverse=True)[:limit]

    def get(self, event_id: int) -> LoggedEvent | None:
        """Return one event, None where there is none."""
        events = self.query(event_id - 1, 1, up_to=event_id)
        return events[0] if events else None

    def acknowledge(self, event_id: int, who: str) -> bool:
        """Note who has seen an event; the first one stays. False where there is no such event.

        Raises:
            RecordingFailed: the disk does not take it within ACKNOWLEDGED_S.
        """
        try:
            return self._in_thread(lambda: self._acknowledge(event_id, who), ACKNOWLEDGED_S)
        except TimeoutError as error:
            late = Message("not-written-within", time=Quantity(ACKNOWLEDGED_S, "s"))
            raise RecordingFailed(Message("event-log", error=late)) from error

    def flush(self) -> None:
        """Return once every event is on the disk.

        Raises:
            SessionError: the disk does not take them.
        """
        self._in_thread(self._write_waiting)
        if self._error:
            raise SessionError(self._error)

    def close(self) -> None:
        """Write what is left and close the file."""
        self._executor.submit(self._write_waiting)
        self._executor.shutdown(wait=True)
        self._database.close()

    def _queue_write(self) -> bool:
        """Let the thread write what waits, once however many ask; False after the end."""
        with self._lock:
            if self._is_queued:
                return True
            try:
                self._executor.submit(self._write_waiting)
            except RuntimeError:
                return False
            self._is_queued = True
        return True

    def _in_thread(self, work: Callable[[], T], timeout_s: float | None = None) -> T:
        future: Future[T] = self._executor.submit(work)
        try:
            return future.result(timeout_s)
        except sqlite3.Error as error:
            raise SessionError(Message("event-log", error=str(error))) from error

    def _write_waiting(self) -> None:
        with self._lock:
            self._is_queued = False
            writing = self._unwritten.copy()
        if not writing:
            return
        try:
            rows = [astuple(event)[:-2] for event in writing]  # not who has seen it
            self._database.run(lambda connection: _insert(connection, rows))
        except sqlite3.Error as error:
            if self._error is None:
                log.warning("event log cannot be written: %s", error)
            self._error = Message("event-log-waits", error=str(error), waiting=len(writing), dropped=self._dropped)
            again = threading.Timer(RETRY_S, self._queue_write)
            again.daemon = True
            again.start()
            return
        if self._error is not None:
            log.info("event log is written again")
        self._error = None
        written = {event.id for event in writing}
        with self._lock:
            self._unwritten = [event for event in self._unwritten if event.id not in written]

    def _acknowledge(self, event_id: int, who: str) -> bool:
        self._write_waiting()
        update = "UPDATE events SET acknowledged_by = ?, acknowledged_ns = ? WHERE id = ? AND acknowledged_by IS NULL"
        given = (who, self._clock.wall_ns(), event_id)

        def work(connection: sqlite3.Connection) -> bool:
            connection.execute(update, given)
            return connection.execute("SELECT 1 FROM events WHERE id = ?", (event_id,)).fetchone() is not None

        return self._database.run(work)


def _last_id(connection: sqlite3.Connection) -> int:
    return int(connection.execute("SELECT coalesce(max(id), 0) FROM events").fetchone()[0])


def _insert(connection: sqlite3.Connection, rows: Sequence[tuple[object, ...]]) -> None:
    """Insert all of them, or none."""
    connection.execute("BEGIN IMMEDIATE")
    try:
        connection.executemany(_INSERT, rows)
        connection.execute("COMMIT")
    except sqlite3.Error:
        if connection.in_transaction:
            connection.execute("ROLLBACK")
        raise


def _message_json(event: Event) -> str | None:
    """Return code and arguments as JSON; None where an argument has none: the text is logged all the same."""
    try:
        return orjson.dumps(event.message, option=orjson.OPT_SERIALIZE_NUMPY).decode()
    except orjson.JSONEncodeError:
        return None
