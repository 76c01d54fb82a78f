"""The recorder: callers hand over what was received and go on at once; one thread brings it to the disk.

Items wait in memory for at most `COMMIT_S`, then go into one transaction that is forced to the disk. Where the disk
does not take them they stay in memory, up to a limit, and are tried again; beyond it the oldest are left out, counted,
and written down as an event as soon as the disk takes anything. Nobody but the thread waits for a disk.
"""

import logging
import sqlite3
import threading
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.clock import Clock
from app.errors import NotNow, message_of
from app.sessions.errors import RecordingFailed, SessionError
from app.sessions.info import RecorderState, RecorderStatus, SessionInfo
from app.sessions.recording.commit_queue import CommitQueue
from app.sessions.recording.disk import DiskLimits, loss_event, low_warning, up_to_now
from app.sessions.recording.disk import free_bytes as free_bytes_of
from app.sessions.recording.session_writer import MEMORY_MAP, Row, SessionWriter, event_row
from app.sessions.recording.waiting_rows import START, STOP
from app.sessions.storage.files import new_file
from app.sources.loaded_battery import LoadedBattery, team_battery
from app.telemetry import Event
from app.words import Message, Quantity, render
from firmware_protocol.memory_map import MAP_HASH

logger = logging.getLogger(__name__)

CLOCK_STEP_NS = 50_000_000  # the wall clock moved by more than this against the monotonic one: noted
_CONTENT = ("frames", "can_frames", "markers")


class Recorder:
    """Records one session at a time into FOLDER/<id>.sqlite. All methods may be called from any thread."""

    def __init__(
        self,
        folder: Path,
        clock: Clock,
        *,
        version: str,
        limits: DiskLimits | None = None,
        free_bytes: Callable[[Path], int] = free_bytes_of,
        next_name: Callable[[str], str] = lambda name: name,
        cell_file: str | None = None,
        battery: LoadedBattery | None = None,
        keeps_empty: bool = True,
    ) -> None:
        """Start the thread; without `keeps_empty` a session that nothing came into is deleted when it ends."""
        self._folder = folder
        self._keeps_empty = keeps_empty
        self._next_name = next_name  # name of the session that continues a split one
        self._version = version
        self._cell_file = cell_file  # what the sessions are estimated with
        self._battery = battery or team_battery()
        self._clock = clock
        self._limits = limits or DiskLimits()
        self._free_bytes = free_bytes
        self._queue = CommitQueue(clock, self._limits.queue_bytes)
        self._lock, self._waiting = self._queue.lock, self._queue.waiting
        self._wake = threading.Event()
        self._ending = False
        self._session: SessionInfo | None = None
        self._counts: Counter[str] = Counter()  # items of the session by table
        self._clock_offset_ns = 0
        self._config: bytes | None = None  # in force, of this session
        self._map_hash: str | None = None  # the master's memory map, None before its IDENT
        self._file_losses: dict[str, Message] = {}  # sessions whose file was taken away, by id
        self._free: int | None = None
        self._size = 0  # bytes of the session's file and log
        self._writer: SessionWriter | None = None  # the thread's
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    def start(self, name: str | None = None, metadata: Mapping[str, object] | None = None) -> SessionInfo:
        """Begin a session; everything handed over from now on belongs to it.

        Raises:
            NotNow: one is being recorded.
            RecordingFailed: the folder or the file cannot be created.
        """
        with self._lock:
            self._require_idle()
        path = self._new_file()
        try:
            with self._lock:
                self._require_idle()
                return self._begin(path, name, metadata or {})
        except NotNow:  # somebody else was faster
            path.unlink()
            raise

    def split(self, metadata: Mapping[str, object] | None = None) -> SessionInfo:
        """End the session and go on in a new one, losing no frame between them; without `metadata` it keeps the same.

        Raises:
            NotNow: nothing is being recorded.
            RecordingFailed: the new file cannot be created; the session goes on.
        """
        with self._lock:
            self._require_session()
        path = self._new_file()
        try:
            with self._lock:
                session = self._require_session()
                self._append_stop(self._clock.monotonic_ns(), self._clock.wall_ns())
                return self._go_on(path, session, session.metadata if metadata is None else metadata)
        except NotNow:  # it was stopped meanwhile
            path.unlink()
            raise

    def stop(self) -> None:
        """End the session; nothing without one. What it still holds in memory is written by the thread."""
        with self._lock:
            if self._session is not None:
                self._append_stop(self._clock.monotonic_ns(), self._clock.wall_ns())
                self._session = None
                self._wake.set()

    def frame(self, t_mono_ns: int, t_wall_ns: int, link: int, raw: bytes, ok: bool) -> None:
        """Record what stood between two delimiters, good or bad."""
        with self._lock:
            self._watch_clock(t_mono_ns, t_wall_ns)
            self._put("frames", (t_mono_ns, t_wall_ns, link, int(ok), raw))

    def can_frame(self, t_mono_ns: int, t_wall_ns: int, can_id: int, data: bytes) -> None:
        """Record a CAN frame; bit 31 of the id marks a 29-bit id."""
        with self._lock:
            self._watch_clock(t_mono_ns, t_wall_ns)
            self._put("can_frames", (t_mono_ns, t_wall_ns, can_id, data, 0))

    def estimates(self, t_mono_ns: int, uptime_ms: int, soc: NDArray[np.float64], sigma: NDArray[np.float64]) -> None:
        """Record the (n_cells,) estimated SOC and its standard deviation, fractions; not finite is missing."""
        n_cells = self._battery.battery.n_cells
        if soc.shape != (n_cells,) or sigma.shape != (n_cells,):
            raise SessionError(f"estimates of shape {soc.shape} and {sigma.shape}, not ({n_cells},)")
        with self._lock:
            self._put("estimates", (t_mono_ns, uptime_ms, soc.copy(), sigma.copy()))

    def event(self, t_mono_ns: int, event: Event) -> None:
        """Record that something happened."""
        with self._lock:
            self._put(*event_row(t_mono_ns, event, self._battery.battery.segments))

    def marker(self, t_mono_ns: int, t_wall_ns: int, text: str, *, kind: str = "note", who: str | None = None) -> None:
        """Record a point in time that somebody marked."""
        with self._lock:
            self._put("markers", (t_mono_ns, t_wall_ns, kind, text, who))

    def config(self, t_mono_ns: int, t_wall_ns: int, image: bytes, why: str) -> None:
        """Record the configuration in force from now on."""
        with self._lock:
            self._config = image
            self._put("configs", (t_mono_ns, t_wall_ns, why, image))

    def memory_map(self, map_hash: str) -> None:
        """Note which memory map the master has (hex): the session that is recorded is read by it, and those after."""
        with self._lock:
            self._map_hash, session = map_hash, self._session
            if session is not None and session.map_hash != map_hash:
                self._session = replace(session, map_hash=map_hash)
                self._waiting.append((MEMORY_MAP, (self._clock.monotonic_ns(), map_hash)))

    def clock(self, t_mono_ns: int, t_wall_ns: int, uptime_ms: int | None) -> None:
        """Record what three clocks showed at one instant. Steps of the wall clock are noted without this."""
        with self._lock:
            self._note_clock(t_mono_ns, t_wall_ns, uptime_ms)

    @property
    def status(self) -> RecorderStatus:
        """Return what is recorded, and how well."""
        with self._lock:
            session, free, size = self._session, self._free, self._size
            waiting = self._waiting
            queue = (waiting.items, waiting.bytes, waiting.lost)
            counts, losses = self._counts.copy(), self._file_losses.copy()
            error, stalled_ns = self._queue.trouble()
        warning = None
        if session is not None:
            session = up_to_now(session, counts, self._clock.monotonic_ns(), size)
            warning = losses.get(str(session.metadata.get("continues"))) or low_warning(session, free, self._limits)
        state = RecorderState.STALLED if error else RecorderState.RECORDING if session else RecorderState.IDLE
        delay_s = None if session is None else self._queue.delay.longest_s
        return RecorderStatus(state, session, *queue, free, warning, error, delay_s, stalled_ns)

    @property
    def is_alive(self) -> bool:
        """Return whether its thread runs."""
        return self._thread.is_alive()

    @property
    def commit_delay_s(self) -> float | None:
        """See `CommitQueue.delay_s`; None while idle, too."""
        return None if self._session is None else self._queue.delay_s

    def wait_for_commit(self, timeout_s: float) -> None:
        """See `CommitQueue.wait_for_commit`."""
        self._queue.wait_for_commit(timeout_s)

    def file_loss(self, session_id: str) -> Message | None:
        """Return what to say of a session whose file was lost while it was recorded."""
        with self._lock:
            return self._file_losses.get(session_id)

    def flush(self, timeout_s: float = 5.0) -> None:
        """Return once everything handed over so far is on the disk.

        Raises:
            RecordingFailed: it is not; it stays in memory and is tried again.
        """
        self._queue.flush(timeout_s, self._wake.set)

    def close(self, timeout_s: float = 5.0) -> None:
        """End the session, write what is left and end the thread. Nothing may be handed over afterwards."""
        self.stop()
        self._ending = True
        self._wake.set()
        self._thread.join(timeout_s)

    def _require_idle(self) -> None:
        if self._session is not None:
            raise NotNow(Message("is-being-recorded", session=self._session.id))

    def _require_session(self) -> SessionInfo:
        if self._session is None:
            raise NotNow(Message("nothing-recorded"))
        return self._session

    def _new_file(self, *, neighbour: Path | None = None) -> Path:
        """Create a session's file; the lock is not held, since the disk may take its time."""
        try:
            return new_file(self._folder, self._clock.wall_ns(), neighbour=neighbour)
        except OSError as error:
            raise RecordingFailed(Message("of-source", source=str(self._folder), reason=error.strerror)) from error

    def _begin(self, path: Path, name: str | None, metadata: Mapping[str, object]) -> SessionInfo:
        """Begin a session in a new file; the lock is held."""
        started_wall_ns, started_mono_ns = self._clock.wall_ns(), self._clock.monotonic_ns()
        self._session = SessionInfo(
            path.stem, path, name or path.stem, started_wall_ns, started_mono_ns,
            voltwall=self._version, map_hash=self._map_hash or MAP_HASH.hex(), metadata=dict(metadata),
        )  # fmt: skip
        self._waiting.lost = 0
        self._config = None
        self._file_losses.pop(path.stem, None)
        self._counts.clear()
        self._size = 0
        self._waiting.append((START, (self._session,)))
        self._note_clock(started_mono_ns, started_wall_ns, None)
        self._wake.set()
        return self._session

    def _go_on(self, path: Path, session: SessionInfo, metadata: Mapping[str, object]) -> SessionInfo:
        """Begin the session that follows another, with the configuration in force; the lock is held."""
        name, config = None if session.name == session.id else self._next_name(session.name), self._config
        begun = self._begin(path, name, {**metadata, "continues": session.id})
        if config is not None:
            self._config = config
            self._put("configs", (begun.started_mono_ns, begun.started_wall_ns, "as before", config))
        return begun

    def _put(self, table: str, row: Row) -> None:
        """Queue a row; the lock is held."""
        if self._session is not None:
            self._counts[table] += 1
            self._counts.subtract(self._waiting.offer((table, row)))

    def _append_stop(self, t_mono_ns: int, t_wall_ns: int) -> None:
        """Queue the session's end, and whether its file stays; the lock is held."""
        is_kept = self._keeps_empty or any(self._counts[table] for table in _CONTENT)
        self._waiting.append((STOP, (t_mono_ns, t_wall_ns, is_kept)))

    def _watch_clock(self, t_mono_ns: int, t_wall_ns: int) -> None:
        if abs(t_wall_ns - t_mono_ns - self._clock_offset_ns) > CLOCK_STEP_NS:
            self._note_clock(t_mono_ns, t_wall_ns, None)

    def _note_clock(self, t_mono_ns: int, t_wall_ns: int, uptime_ms: int | None) -> None:
        self._clock_offset_ns = t_wall_ns - t_mono_ns
        self._put("clock", (t_mono_ns, t_wall_ns, uptime_ms))

    def _run(self) -> None:
        while True:
            with self._lock:
                is_idle = self._session is None and not self._waiting.items
            self._wake.wait(None if is_idle and not self._ending else self._queue.pause_s)
            self._wake.clear()
            ending = self._ending
            self._work()
            if ending:
                if self._writer is not None:
                    logger.error("session left unclosed, %d items not written", self._waiting.items)
                    self._writer.abandon()
                return

    def _work(self) -> None:
        unreported = self._queue.begin()
        error: Message | None = None
        free = None
        try:
            self._watch_file()
            with suppress(FileNotFoundError):
                free = self._free_bytes(self._folder)
            if self._waiting.batch and free is not None and free < self._limits.stop_free_bytes:
                error = Message("disk-full", kept=Quantity(self._limits.stop_free_bytes >> 20, "MB"))
            else:
                self._write_batch(unreported)
                self._split_where_long()
        except (sqlite3.Error, OSError, SessionError) as failure:
            error = Message("disk-refuses", error=message_of(failure))
        with self._lock:
            self._free = free
            if self._writer is not None and self._session is not None and self._writer.path == self._session.path:
                self._size = self._writer.size_bytes
        if error and error != self._queue.error:
            logger.warning("recording stalled: %s", render(error))
        elif self._queue.error and not error:
            logger.info("recording continues, %d items were lost", unreported)
        self._queue.end(error)

    def _watch_file(self) -> None:
        """Go on in a new file where the session's was deleted or replaced; what waits goes into the new one.

        Raises:
            RecordingFailed: there can be none; it is tried again.
        """
        writer = self._writer
        if writer is None or writer.is_intact():
            return
        with self._lock:
            is_recorded = self._session is not None and self._session.path == writer.path
        path = self._new_file(neighbour=writer.path) if is_recorded else None
        with self._lock:
            session, lost = self._session, writer.path.stem
            self._waiting.take()
            if path is not None and session is not None and session.path == writer.path:
                following = self._begin_elsewhere(path, session)
                loss = Message("recording-file-gone", session=lost, following=following.id)
            else:  # up to the session's end there is nowhere to put what waits
                self._waiting.finish(self._waiting.n_of_session + 1)
                loss = Message("recording-file-gone-at-end", session=lost)
            self._file_losses[lost] = loss
        logger.error("%s", render(loss))
        self._writer = None
        writer.abandon()

    def _begin_elsewhere(self, path: Path, session: SessionInfo) -> SessionInfo:
        """Begin a session in place of one whose file is gone, with all that waits; the lock is held."""
        waiting, self._waiting.batch = self._waiting.batch, []
        following = self._go_on(path, session, session.metadata)
        self._waiting.take()
        self._waiting.batch += waiting
        self._counts.update(table for table, _ in waiting)
        return following

    def _write_batch(self, unreported: int) -> None:
        while rows := self._queue.next_rows():
            kind, row = rows[0]
            if kind == START:
                self._writer = SessionWriter(row[0], self._cell_file, self._battery, self._commit_waiting)
                self._queue.finish(rows)
                continue
            if self._writer is None:
                raise RecordingFailed("no session is open")
            if kind == STOP:
                *ended, is_kept = row
                if is_kept:
                    self._writer.close(*ended)
                else:
                    self._writer.discard()
                self._writer = None
                self._queue.finish(rows)
            else:
                loss = [loss_event(row[0], self._clock.wall_ns(), unreported)] if unreported else []
                self._writer.write([*rows, *loss])
                self._queue.finish(rows, unreported)
                unreported = 0
                self._writer.close_chunk_if_due(rows[-1][1][0])

    def _commit_waiting(self) -> None:
        """Commit what came while a chunk is packed, which takes longer than COMMIT_S on a busy machine."""
        if not self._queue.is_due or self._writer is None:
            return
        self._queue.begin()
        rows = self._queue.next_rows()
        if rows and rows[0][0] not in (START, STOP):
            self._writer.write(rows)
            self._queue.finish(rows)

    def _split_where_long(self) -> None:
        limit, writer = self._limits.session_bytes, self._writer
        if limit is not None and writer is not None and not self._waiting.batch and writer.size_bytes > limit:
            with suppress(NotNow):  # it was stopped meanwhile
                logger.info("%s has %d MB and continues as %s", writer.path.stem, limit >> 20, self.split().id)
