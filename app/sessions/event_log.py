"""The event log: what happened, kept over restarts in one SQLite file. One thread writes and reads it."""

import logging
import sqlite3
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import astuple, dataclass
from itertools import count
from pathlib import Path
from typing import TypeVar

import orjson

from app.clock import Clock
from app.sessions.errors import SessionError
from app.sessions.storage.migrate import EVENTS
from app.sessions.storage.own_database import OnSetAside, OwnDatabase, nobody_asks
from app.telemetry import Event
from app.words import Message

logger = logging.getLogger(__name__)
T = TypeVar("T")

MAX_UNWRITTEN = 10_000  # events kept in memory while the disk takes none
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


class EventLog:
    """An append-only list of events. All methods may be called from any thread; only `append` returns at once."""

    def __init__(self, path: Path, clock: Clock, on_set_aside: OnSetAside = nobody_asks) -> None:
        """Open the log, or begin one; a damaged one is set aside.

        Raises:
            SchemaTooNew: the file is a newer program's.
            SessionError: it cannot be created.
        """
        self._clock = clock
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._database = OwnDatabase(path, EVENTS, on_set_aside)
            last = self._database.run(_last_id)
        except (OSError, sqlite3.Error) as error:
            raise SessionError(Message("event-log", error=f"{path}: {error}")) from error
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
        """Why events are waiting in memory, None when all are on the disk."""
        return self._error

    def append(self, event: Event, uptime_ms: int | None = None) -> int:
        """Add an event and return its id; ids grow over all restarts."""
        message = _message_json(event)
        event_id = next(self._ids)
        self._last_id = max(self._last_id, event_id)
        logged = LoggedEvent(
            event_id,
            event.time_ns,
            uptime_ms,
            event.severity,
            event.code,
            event.text,
            event.cell,
            event.value,
            event.limit,
            event.unit,
            event.who,
            message,
        )
        try:
            self._executor.submit(self._write, logged)
        except RuntimeError:  # closed: whoever still has something to tell at the end must not fail by it
            log.warning("told after the event log was closed: %s", event.text)
        return event_id

    def query(
        self,
        after: int = 0,
        limit: int = 200,
        severity: str | None = None,
        cell: int | None = None,
        up_to: int | None = None,
    ) -> list[LoggedEvent]:
        """Return at most `limit` events with an id above `after`, and none above `up_to`, newest first."""
        return self._in_thread(lambda: self._query(after, limit, severity, cell, up_to))

    def get(self, event_id: int) -> LoggedEvent | None:
        """Return one event, None where there is none."""
        found = self._in_thread(lambda: self._query(event_id - 1, 1, None, None, up_to=event_id))
        return found[0] if found else None

    def acknowledge(self, event_id: int, who: str) -> bool:
        """Note who has seen an event; the first one stays. False where there is no such event."""
        return self._in_thread(lambda: self._acknowledge(event_id, who))

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

    def _in_thread(self, work: Callable[[], T]) -> T:
        future: Future[T] = self._executor.submit(work)
        try:
            return future.result()
        except sqlite3.Error as error:
            raise SessionError(Message("event-log", error=str(error))) from error

    def _write(self, event: LoggedEvent) -> None:
        self._unwritten.append(event)
        if len(self._unwritten) > MAX_UNWRITTEN:
            del self._unwritten[0]
            self._dropped += 1
        self._write_waiting()

    def _write_waiting(self) -> None:
        if not self._unwritten:
            return
        rows = [astuple(event)[:-2] for event in self._unwritten]  # not who has seen it
        try:
            self._database.run(lambda connection: _insert(connection, rows))
        except sqlite3.Error as error:
            if self._error is None:
                logger.warning("event log does not reach the disk: %s", error)
            self._error = Message(
                "event-log-waits", error=str(error), waiting=len(self._unwritten), dropped=self._dropped
            )
        else:
            if self._error is not None:
                logger.info("event log reaches the disk again")
            self._error = None
            self._unwritten.clear()

    def _query(
        self, after: int, limit: int, severity: str | None, cell: int | None, up_to: int | None = None
    ) -> list[LoggedEvent]:
        self._write_waiting()
        query = (
            f"SELECT {_COLUMNS} FROM events WHERE id > :after AND (:up_to IS NULL OR id <= :up_to)"
            " AND (:severity IS NULL OR severity = :severity) AND (:cell IS NULL OR cell = :cell)"
            " ORDER BY id DESC LIMIT :limit"
        )
        given = {"after": after, "up_to": up_to, "severity": severity, "cell": cell, "limit": limit}
        rows = self._database.run(lambda connection: connection.execute(query, given).fetchall())
        waiting = [
            event
            for event in reversed(self._unwritten)
            if event.id > after
            and (up_to is None or event.id <= up_to)
            and severity in (None, event.severity)
            and cell in (None, event.cell)
        ]
        return (waiting + [LoggedEvent(*row) for row in rows])[:limit]

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
