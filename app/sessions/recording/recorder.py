"""The recorder: callers hand over what was received and go on at once; one thread brings it to the disk.

Items wait in memory for at most `COMMIT_S`, then go into one transaction that is forced to the disk. Where the disk
does not take them they stay in memory, up to a limit, and are tried again; what is lost beyond it is counted and
written down as an event as soon as the disk takes anything.
"""

import logging
import sqlite3
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.clock import Clock
from app.errors import NotNow, message_of
from app.sessions.errors import RecordingFailed, SessionError
from app.sessions.info import RecorderState, RecorderStatus, SessionInfo
from app.sessions.recording.commit_delay import CommitDelay, oldest_frame_ns
from app.sessions.recording.disk import DiskLimits, loss_event, low_warning, up_to_now
from app.sessions.recording.disk import free_bytes as free_bytes_of
from app.sessions.recording.session_writer import MEMORY_MAP, Row, SessionWriter, event_row
from app.sessions.recording.waiting_rows import START, STOP, WaitingRows
from app.sessions.storage.files import new_file, size_on_disk
from app.sources.loaded_battery import LoadedBattery, team_battery
from app.telemetry import Event
from app.words import Message, Quantity, render
from firmware_protocol.memory_map import MAP_HASH

logger = logging.getLogger(__name__)

COMMIT_S = 0.3  # the time that the last commits took included; at most 0.5 s of a session are not on the disk
CLOCK_STEP_NS = 50_000_000  # the wall clock moved by more than this against the monotonic one: noted
DUE_S = 0.15  # what waits longer is committed next
PAUSE_S = 0.05  # between two commits at least
STUCK_S = 10.0  # a disk that has taken nothing for so long, and not said why
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
        self._next_name = next_name  # of the session that goes on where one is split
        self._version = version
        self._cell_file = cell_file  # what the sessions are estimated with
        self._battery = battery or team_battery()
        self._clock = clock
        self._limits = limits or DiskLimits()
        self._free_bytes = free_bytes
        self._lock = threading.Lock()
        self._progress = threading.Condition(self._lock)
        self._wake = threading.Event()
        self._ending = False
        self._session: SessionInfo | None = None
        self._waiting = WaitingRows(self._limits.queue_bytes)
        self._counts: Counter[str] = Counter()  # items of the session by table
        self._clock_offset_ns = 0
        self._config: bytes | None = None  # in force, of this session
        self._map_hash: str | None = None  # of the master's memory map, once it told it
        self._file_losses: dict[str, Message] = {}  # sessions whose file was taken away, by id
        self._error: Message | None = None
        self._free: int | None = None
        self._committed_s = time.monotonic()  # when the thread last did
        self._commit_began_s = self._committed_s
        self._delay = CommitDelay()
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
            if self._session is not None:
                raise NotNow(Message("is-being-recorded", session=self._session.id))
            return self._begin(name, metadata or {})

    def split(self, metadata: Mapping[str, object] | None = None) -> SessionInfo:
        """End the session and go on in a new one, losing no frame between them; without `metadata` it keeps the same.

        Raises:
            NotNow: nothing is being recorded.
            RecordingFailed: the new file cannot be created; the session goes on.
        """
        with self._lock:
            if (session := self._session) is None:
                raise NotNow(Message("nothing-recorded"))
            return self._go_on(session, session.metadata if metadata is None else metadata)

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
            self._put("can_frames", (t_mono_ns, t_wall_ns, can_id, data))

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
            self._put(*event_row(t_mono_ns, event))

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
        """What is being recorded, and how well."""
        with self._lock:
            session, error, free = self._session, self._error, self._free
            waiting = self._waiting
            queue = (waiting.items, waiting.bytes, waiting.lost)
            counts, losses = self._counts.copy(), self._file_losses.copy()
            waited_s = time.monotonic() - waiting.since_s if waiting.items else 0.0
        if error is None and waited_s > STUCK_S:
            error = Message("disk-silent", time=Quantity(waited_s, "s", 0))
        warning = None
        if session is not None:
            session = up_to_now(session, counts, self._clock.monotonic_ns())
            warning = losses.get(str(session.metadata.get("continues"))) or low_warning(session, free, self._limits)
        state = RecorderState.STALLED if error else RecorderState.RECORDING if session else RecorderState.IDLE
        delay_s = None if session is None else self._delay.longest_s
        return RecorderStatus(state, session, *queue, free, warning, error, delay_s)

    @property
    def commit_delay_s(self) -> float | None:
        """How long the newest frames took from their arrival to the disk, or wait already; None while idle."""
        with self._lock:
            if self._session is None:
                return None
            waiting = oldest_frame_ns(self._waiting.oldest)
        return self._delay.now_s(waiting, self._clock.monotonic_ns())

    def wait_for_commit(self, timeout_s: float) -> None:
        """Return when a commit that runs or is due has ended, at once where none is, or after so long."""
        with self._progress:
            waiting = oldest_frame_ns(self._waiting.oldest)
            if waiting is not None and self._clock.monotonic_ns() - waiting > DUE_S * 1e9:
                self._progress.wait(timeout_s)

    def file_loss(self, session_id: str) -> Message | None:
        """Return what to say of a session whose file was deleted or replaced while it was recorded."""
        with self._lock:
            return self._file_losses.get(session_id)

    def flush(self, timeout_s: float = 5.0) -> None:
        """Return once everything handed over so far is on the disk.

        Raises:
            RecordingFailed: it is not; it stays in memory and is tried again.
        """
        deadline = time.monotonic() + timeout_s
        with self._progress:
            goal = self._waiting.taken
            while self._waiting.done < goal:
                self._wake.set()
                remaining = deadline - time.monotonic()
                if remaining <= 0 or not self._progress.wait(remaining):
                    raise RecordingFailed(self._error or Message("not-written-within", time=Quantity(timeout_s, "s")))
                if self._error and self._waiting.done < goal:
                    raise RecordingFailed(self._error)

    def close(self, timeout_s: float = 5.0) -> None:
        """End the session, write what is left and end the thread. Nothing may be handed over afterwards."""
        self.stop()
        self._ending = True
        self._wake.set()
        self._thread.join(timeout_s)

    def _begin(self, name: str | None, metadata: Mapping[str, object], *, beside: Path | None = None) -> SessionInfo:
        """End what is being recorded, or was in the file `beside`, and begin anew; the lock is held."""
        started_wall_ns, started_mono_ns = self._clock.wall_ns(), self._clock.monotonic_ns()
        try:
            path = new_file(self._folder, started_wall_ns, beside=beside)
        except OSError as error:
            raise RecordingFailed(Message("of-source", source=str(self._folder), reason=error.strerror)) from error
        if self._session is not None and beside is None:
            self._append_stop(started_mono_ns, started_wall_ns)
        self._session = SessionInfo(
            path.stem, path, name or path.stem, started_wall_ns, started_mono_ns,
            voltwall=self._version, map_hash=self._map_hash or MAP_HASH.hex(), metadata=dict(metadata),
        )  # fmt: skip
        self._waiting.lost = 0
        self._config = None
        self._file_losses.pop(path.stem, None)
        self._counts.clear()
        self._waiting.append((START, (self._session,)))
        self._note_clock(started_mono_ns, started_wall_ns, None)
        self._wake.set()
        return self._session

    def _go_on(self, session: SessionInfo, metadata: Mapping[str, object], beside: Path | None = None) -> SessionInfo:
        """Begin the session that follows another, with the configuration in force; the lock is held."""
        name, config = None if session.name == session.id else self._next_name(session.name), self._config
        begun = self._begin(name, {**metadata, "continues": session.id}, beside=beside)
        if config is not None:
            self._config = config
            self._put("configs", (begun.started_mono_ns, begun.started_wall_ns, "as before", config))
        return begun

    def _put(self, table: str, row: Row) -> None:
        """Queue a row; the lock is held."""
        if self._session is not None and self._waiting.offer((table, row)):
            self._counts[table] += 1

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
            # What came during the last commit has waited that long already, and the next one takes as long again
            since_s = time.monotonic() - self._committed_s + 2 * self._delay.commit_s
            self._wake.wait(None if is_idle and not self._ending else max(PAUSE_S, COMMIT_S - since_s))
            self._wake.clear()
            ending = self._ending
            self._work()
            if ending:
                if self._writer is not None:
                    logger.error("session left unclosed, %d items not written", self._waiting.items)
                    self._writer.abandon()
                return

    def _work(self) -> None:
        self._commit_began_s = time.monotonic()
        with self._lock:
            self._waiting.take()
            unreported = self._waiting.unreported
        error: Message | None = None
        free = None
        try:
            self._watch_file()
            free = self._free_bytes(self._folder) if self._folder.exists() else None
            if self._waiting.batch and free is not None and free < self._limits.stop_free_bytes:
                error = Message("disk-full", kept=Quantity(self._limits.stop_free_bytes >> 20, "MB"))
            else:
                self._write_batch(unreported)
                self._split_where_long()
        except (sqlite3.Error, OSError, SessionError) as failure:
            error = Message("disk-refuses", error=message_of(failure))
        if error and error != self._error:
            logger.warning("recording stalled: %s", render(error))
        elif self._error and not error:
            logger.info("recording goes on, %d items were lost", unreported)
        with self._progress:
            self._error, self._free = error, free
            self._progress.notify_all()

    def _watch_file(self) -> None:
        """Go on in a new file where the session's was deleted or replaced; what waits goes into the new one.

        Raises:
            RecordingFailed: there can be none; it is tried again.
        """
        writer = self._writer
        if writer is None or writer.is_in_place():
            return
        with self._lock:
            session, lost = self._session, writer.path.stem
            self._waiting.take()
            if session is not None and session.path == writer.path:
                loss = Message("recording-file-gone", session=lost, following=self._begin_elsewhere(session).id)
            else:  # up to the session's end there is nowhere to put what waits
                self._waiting.finish(self._waiting.n_of_session + 1)
                loss = Message("recording-file-gone-at-end", session=lost)
            self._file_losses[lost] = loss
        logger.error("%s", render(loss))
        self._writer = None
        writer.abandon()

    def _begin_elsewhere(self, session: SessionInfo) -> SessionInfo:
        """Begin a session in place of one whose file is gone, with all that waits; the lock is held."""
        waiting, self._waiting.batch = self._waiting.batch, []
        following = self._go_on(session, session.metadata, session.path)
        self._waiting.take()
        self._waiting.batch += waiting
        self._counts.update(table for table, _ in waiting)
        return following

    def _write_batch(self, unreported: int) -> None:
        while self._waiting.batch:
            kind, row = self._waiting.batch[0]
            if kind == START:
                self._writer = SessionWriter(row[0], self._cell_file, self._battery, self._commit_waiting)
                self._finish(1)
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
                self._finish(1)
            else:
                n = self._waiting.n_of_session
                items = self._waiting.batch[:n]
                if unreported:
                    items = [*items, loss_event(row[0], self._clock.wall_ns(), unreported)]
                self._writer.write(items)
                self._finish(n, unreported)
                unreported = 0
                self._writer.close_chunk_if_due(items[-1][1][0])

    def _commit_waiting(self) -> None:
        """Commit what came while a chunk is packed, which takes longer than COMMIT_S on a busy machine."""
        if time.monotonic() - self._committed_s < COMMIT_S:
            return
        self._commit_began_s = time.monotonic()
        with self._lock:
            self._waiting.take()
        n = self._waiting.n_of_session
        if n and self._writer is not None:
            self._writer.write(self._waiting.batch[:n])
            self._finish(n)

    def _split_where_long(self) -> None:
        limit = self._limits.session_bytes
        with self._lock:
            session = self._session
        if limit is not None and session is not None and not self._waiting.batch and size_on_disk(session.path) > limit:
            logger.info("session %s is %d MB long and goes on as %s", session.id, limit >> 20, self.split().id)

    def _finish(self, n: int, reported: int = 0) -> None:
        self._committed_s = time.monotonic()
        oldest_ns = oldest_frame_ns(self._waiting.batch[:n])
        self._delay.committed(oldest_ns, self._clock.monotonic_ns(), self._committed_s - self._commit_began_s)
        with self._lock:
            self._waiting.finish(n, reported)
