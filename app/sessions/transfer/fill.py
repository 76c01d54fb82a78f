"""Puts into a session what its link lost and another recorder of the same run, the one in the car, has.

Frames that both have, byte for byte, tell how far the two clocks are apart. What only the other one has goes in
between, marked by its link number; nothing of the session is changed or lost, and doing it again changes nothing.
"""

import shutil
import sqlite3
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from heapq import merge
from itertools import groupby, islice
from operator import attrgetter
from pathlib import Path
from statistics import median

from app.errors import AppError, NotNow
from app.sessions.catalogue import Catalogue
from app.sessions.errors import RecordingFailed, SessionError
from app.sessions.info import RecordedCanFrame, RecordedFrame, SessionInfo
from app.sessions.reading.reader import SessionFile
from app.sessions.reading.session_info import filled_spans
from app.sessions.recording.session_names import CLOCK_IS_SET_NS
from app.sessions.recording.session_writer import SessionWriter, TableRow, event_row
from app.sessions.storage.files import FETCHED, is_in_use, merge_log
from app.telemetry import Event
from app.words import Message, Quantity

FILLED_LINK = 1  # in `frames.link`: came from another recorder
SPAN_NS = 500_000_000  # from here on, missing frames in a row are a gap worth a line of its own
NEAR = 25  # common frames on each side of a gap tell what the clocks' difference is there
MARGIN_NS = 3600 * 10**9  # the clocks of two machines in a paddock are not further apart, once they were set
NEWEST = 10  # sessions looked at where a clock was never set
BATCH = 2000
PARTS = 1000  # steps of a filling's progress
READING = 0.1  # share of its time for reading both sessions
Progress = Callable[[int, int], None]  # parts done, parts in all


class NoOverlap(SessionError):
    """The two sessions are not of the same run."""


class CanOnlySession(SessionError):
    """A session has no frames with a number of their own; frames of a bus repeat, byte for byte."""


@dataclass(frozen=True, slots=True)
class Filled:
    """The frames put in; `spans` are the gaps of half a second and more, in seconds from the session's start."""

    frames: int = 0
    can_frames: int = 0
    estimates: int = 0
    spans: tuple[tuple[float, float], ...] = ()

    def message(self, source: str) -> Message:
        """Return the message about it."""
        time = Quantity(self.seconds, "s", 1)
        return Message("filled", frames=self.frames, time=time, n=len(self.spans), source=source)

    @property
    def seconds(self) -> float:
        """Length of these gaps."""
        return sum(end - start for start, end in self.spans)


@dataclass(frozen=True, slots=True)
class _Missing:
    """A frame that only the source has, on the session's clock."""

    frame: RecordedFrame
    source_ns: int
    after: int  # number of common frames before it


def fill_gaps(
    path: Path,
    other: Path,
    *,
    t_wall_ns: int,
    on_progress: Progress = lambda done, of: None,
    open_file: Callable[[Path], SessionFile] = SessionFile,
) -> Filled:
    """Fill the session at `path` from the one at `other` and return what was put in.

    Args:
        path: of the session.
        other: of the one that has more.
        t_wall_ns: when it is filled.
        on_progress: called with how far it is.
        open_file: opens each.

    Raises:
        NothingInCommon: not one frame is in both.
        CanOnlySession: one of them was not read over RS232: nothing tells which frame is which.
        NotNow: the session is being recorded or read.
        NotASession, SchemaTooNew: one of them cannot be read.
        RecordingFailed: the disk does not take the new file; the session stays as it is.
    """
    if is_in_use(path):
        raise NotNow(Message("session-in-use", session=path.stem))
    try:
        return _fill(path, other, t_wall_ns, on_progress, open_file)
    except (sqlite3.Error, OSError) as error:
        raise RecordingFailed(Message("not-written-anew", session=path.stem, error=str(error))) from error


def fill_from(catalogue: Catalogue, fetched: Path, *, t_wall_ns: int) -> list[Message]:
    """Fill every session recorded here during the fetched one's run; return what was done."""
    info = catalogue.read_info(fetched)
    done: list[Message] = []
    for session in _candidates(catalogue, info):
        try:
            filled = fill_gaps(session.path, fetched, t_wall_ns=t_wall_ns, open_file=catalogue.open_file)
        except NoOverlap:
            continue
        except AppError as error:
            done.append(Message("not-filled", session=session.id, error=error.message))
            continue
        if filled.frames:
            done.append(Message("of-source", source=session.id, reason=filled.message(fetched.stem)))
    return done


def is_own(info: SessionInfo) -> bool:
    """Return whether a session was recorded here, not brought from another service."""
    return not info.path.with_name(info.path.name + FETCHED).exists()


def _candidates(catalogue: Catalogue, fetched: SessionInfo) -> list[SessionInfo]:
    """Sessions recorded here that can be of the same run; by time, unless one of the clocks was never set."""
    own = [info for info in catalogue.list() if is_own(info)]
    if fetched.started_wall_ns < CLOCK_IS_SET_NS:
        return own[:NEWEST]
    start_ns, end_ns = fetched.started_wall_ns - MARGIN_NS, (fetched.ended_wall_ns or 0) + MARGIN_NS
    return [
        info
        for i, info in enumerate(own)
        if (info.started_wall_ns < end_ns and (info.ended_wall_ns or 0) > start_ns)
        or (info.started_wall_ns < CLOCK_IS_SET_NS and i < NEWEST)
    ]


def _fill(
    path: Path, other: Path, t_wall_ns: int, on_progress: Progress, open_file: Callable[[Path], SessionFile]
) -> Filled:
    with (
        tempfile.TemporaryDirectory(dir=path.parent, prefix=".filling-") as folder,
        open_file(path) as session,
        open_file(other) as source,
    ):
        missing = _missing(session, source, on_progress)
        if not missing:
            return Filled()
        spans = _spans(missing)
        items = [
            *_frames(missing),
            *(cans := _can_frames(session, source, missing, spans)),
            *(estimates := _estimates(source, missing)),
        ]
        start_ns = session.info.started_mono_ns
        in_s = tuple(((first - start_ns) / 1e9, (last - start_ns) / 1e9) for first, last in spans)
        result = Filled(len(missing), len(cans), len(estimates), in_s)
        copy = Path(folder) / path.name
        copy.touch()
        _write(session, copy, items, result, f"the session {other.stem}", t_wall_ns, on_progress)
        shutil.copymode(path, copy)
        session.close()
        for suffix in ("-wal", "-shm"):
            path.with_name(path.name + suffix).unlink(missing_ok=True)
        copy.replace(path)
    return result


def _missing(session: SessionFile, source: SessionFile, on_progress: Progress) -> list[_Missing]:
    """Intact frames of the source that the session lacks, between its start and its end, in order."""
    info = session.info
    for file in (session, source):
        if file.info.frames == 0 and file.info.can_frames:
            raise CanOnlySession(Message("can-only-session", session=file.path.stem))
    n_here, of = info.frames, info.frames + source.info.frames
    of_session = _with_progress(session.frames(), 0, of, on_progress)
    here = {hash(frame.raw): frame.t_mono_ns for frame in of_session if frame.ok}
    of_source = _with_progress(source.frames(), n_here, of, on_progress)
    frames = [(frame.t_mono_ns, here.get(hash(frame.raw)), frame.raw) for frame in of_source if frame.ok]
    common = [(there_ns, here_ns) for there_ns, here_ns, _ in frames if here_ns is not None]
    if not common:
        raise NoOverlap(Message("nothing-in-common", session=session.path.stem, other=source.path.stem))
    missing: list[_Missing] = []
    passed = 0  # common frames so far
    for there_ns, here_ns, raw in frames:
        if here_ns is not None:
            passed += 1
            continue
        near = common[max(0, passed - NEAR) : passed + NEAR]
        t_ns = there_ns + round(median(mine - theirs for theirs, mine in near))
        if passed and passed < len(common):
            t_ns = min(max(t_ns, common[passed - 1][1] + 1), common[passed][1] - 1)
        elif not info.started_mono_ns <= t_ns <= (info.ended_mono_ns or 0):
            continue
        t_wall_ns = t_ns + info.started_wall_ns - info.started_mono_ns
        missing.append(_Missing(RecordedFrame(t_ns, t_wall_ns, FILLED_LINK, raw, True), there_ns, passed))
    return missing


def _with_progress(
    frames: Iterable[RecordedFrame], before: int, of: int, on_progress: Progress
) -> Iterator[RecordedFrame]:
    """The frames, with progress."""
    for k, frame in enumerate(frames, before):
        if k % BATCH == 0:
            on_progress(round(READING * PARTS * k / max(of, k, 1)), PARTS)
        yield frame


def _spans(missing: list[_Missing]) -> list[tuple[int, int]]:
    """First and last time of each long run of missing frames."""
    runs = [[row.frame.t_mono_ns for row in run] for _, run in groupby(missing, key=attrgetter("after"))]
    return [(times[0], times[-1]) for times in runs if times[-1] - times[0] >= SPAN_NS]


def _frames(missing: list[_Missing]) -> list[TableRow]:
    return [_frame_row(row.frame) for row in missing]


def _frame_row(frame: RecordedFrame) -> TableRow:
    return "frames", (frame.t_mono_ns, frame.t_wall_ns, frame.link, int(frame.ok), frame.raw)


def _can_row(frame: RecordedCanFrame) -> TableRow:
    return "can_frames", (frame.t_mono_ns, frame.t_wall_ns, frame.can_id, frame.data, frame.bus)


def _can_frames(
    session: SessionFile, source: SessionFile, missing: list[_Missing], spans: list[tuple[int, int]]
) -> list[TableRow]:
    """The source's CAN frames within gaps in which the session has none: their bytes do not distinguish them."""
    rows: list[TableRow] = []
    shift = {row.frame.t_mono_ns: row.frame.t_mono_ns - row.source_ns for row in missing}
    for first_ns, last_ns in spans:
        if any(session.can_frames(session.unix_s(first_ns), session.unix_s(last_ns), all_buses=True)):
            continue
        offset_ns = shift[first_ns]
        range_s = (source.unix_s(first_ns - offset_ns), source.unix_s(last_ns - offset_ns))
        for frame in source.can_frames(*range_s, all_buses=True):
            t_ns = frame.t_mono_ns + offset_ns
            t_wall_ns = t_ns + session.info.started_wall_ns - session.info.started_mono_ns
            rows.append(_can_row(replace(frame, t_mono_ns=t_ns, t_wall_ns=t_wall_ns)))
    return rows


def _estimates(source: SessionFile, missing: list[_Missing]) -> list[TableRow]:
    """What the source's recorder estimated from the missing frames."""
    time_here = {row.source_ns // 1000: row.frame.t_mono_ns for row in missing}
    return [
        ("estimates", (time_here[t_ns // 1000], *row)) for t_ns, *row in source.estimates() if t_ns // 1000 in time_here
    ]


def _write(
    session: SessionFile,
    copy: Path,
    new: list[TableRow],
    filled: Filled,
    source_name: str,
    t_wall_ns: int,
    on_progress: Progress,
) -> None:
    """Write the session once more, with the new items in their places."""
    info = session.info
    start_ns, end_ns = info.started_mono_ns, info.ended_mono_ns or info.started_mono_ns
    length_ns, begun = max(end_ns - start_ns, 1), READING * PARTS
    spans = [*filled_spans(info), *filled.spans]
    filled_info = replace(info, path=copy, metadata={**info.metadata, "filled": sorted(map(list, spans))})
    writer = SessionWriter(filled_info, session.cell_file, session.loaded_battery)
    try:
        old: tuple[Iterator[TableRow], ...] = (
            (("configs", (c.t_mono_ns, c.t_wall_ns, c.why, c.image)) for c in session.configs_as_recorded()),
            map(_frame_row, session.frames()),
            map(_can_row, session.can_frames(all_buses=True)),
            (("estimates", row) for row in session.estimates()),
        )
        new.sort(key=_time_of)
        items = merge(*old, new, key=_time_of)
        while batch := list(islice(items, BATCH)):
            writer.write(batch)
            writer.close_chunk_if_due(batch[-1][1][0])
            written_ns = min(batch[-1][1][0] - start_ns, length_ns)
            on_progress(round(begun + (PARTS - begun) * written_ns / length_ns), PARTS)
        writer.copy_other_tables(session.path)
        event = Event(t_wall_ns, "info", "gaps-filled", filled.message(source_name), value=filled.seconds, unit="s")
        writer.write([event_row(end_ns, event)])
        if info.is_closed:
            writer.close(end_ns, info.ended_wall_ns or end_ns)
    finally:
        writer.abandon()
    merge_log(copy)


def _time_of(item: TableRow) -> int:
    return int(item[1][0])
