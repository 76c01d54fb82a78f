"""Makes a session of another system's recording: estimated by our filter, read like any other session."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from heapq import merge
from itertools import islice
from operator import itemgetter
from pathlib import Path

from app import __version__
from app.errors import ImportFailed
from app.estimation.cell_model.cell_file import format_cell, load_cell
from app.live.pipeline import Output, Pipeline
from app.sessions.info import SessionInfo
from app.sessions.recording.session_writer import SessionWriter, TableRow, event_row
from app.sessions.storage.files import new_file, remove
from app.sessions.transfer.frame_spool import FrameSpool
from app.sessions.transfer.table_battery import battery_of_table, frames_a_row, frames_of_table
from app.sources.dbc.battery_decoder import BatteryDecoder
from app.sources.dbc.frames import TimedFrame, frames_of
from app.sources.items import CanItem
from app.sources.loaded_battery import LoadedBattery, team_battery
from app.sources.recordings import can_log
from app.sources.recordings.bad_rows import BadRows
from app.sources.recordings.battery_log import BatteryLog, battery_log
from app.sources.recordings.kind import is_can_log
from app.sources.recordings.profile import ImportProfile
from app.sources.recordings.table import Table, read_table
from app.words import Message
from firmware_protocol.memory_map import MAP_HASH

START_MONO_NS = 10**9  # such a recording has no monotonic clock; its time axis begins here
BATCH = 2000  # frames
DECODED_AT_ONCE = 20_000
PARTS = 1000  # of an import, as its progress counts
READING = 0.1  # of the time of an import is the reading of a log
READING_TABLE = 0.02  # and that of a table
DECODING = 0.2  # is over when a log's frames are decoded by a DBC, too
LATEST_UNIX_S = 4_102_444_800  # 2100
SINCE_1970_S = 9e8  # a log's time beyond it is no time since its begin
Progress = Callable[[int, int], None]  # parts done, parts in all
NewPipeline = Callable[[LoadedBattery], Pipeline]


@dataclass(frozen=True, slots=True)
class Imported:
    """What was made; rows of a table, frames of a log."""

    info: SessionInfo
    rows: int
    cells: int
    notes: tuple[Message, ...]


@dataclass(frozen=True, slots=True)
class _Recording:
    """What is written: frames in order, their times in ns since the first one; they are read once."""

    battery: LoadedBattery
    frames: Iterable[TimedFrame]
    n_frames: int
    length_ns: int
    rows: int
    cells: int
    started_unix_s: float | None
    notes: tuple[Message, ...]
    begun: float = READING  # the share of the import's time that it took


def import_file(
    path: Path,
    profile: ImportProfile,
    folder: Path,
    new_pipeline: NewPipeline,
    *,
    battery: LoadedBattery | None = None,
    dbc: Path | None = None,
    table: Table | None = None,
    name: str = "",
    started_unix_s: float | None = None,
    on_progress: Progress = lambda done, of: None,
) -> Imported:
    """Read a recording, run the filter over it and write it as a session into `folder`.

    Args:
        path: a table or a CAN log, known by its content (`app.sources.recordings.kind`).
        profile: which columns, or signals of `dbc`, are what.
        folder: of the sessions.
        new_pipeline: makes a fresh chain with the filter and the cell to use.
        battery: who sent the frames of a CAN log, or whose shape a table has; None: the team's own, or one segment.
        dbc: of the CAN log's bus; then its signals are taken as a table by `profile`.
        table: what is in the file, where that is known; else it is read.
        name: of the session; the file's where empty.
        started_unix_s: where the file does not say; else the time at which the file was changed, less its length.
        on_progress: called with how far it is.

    Raises:
        ImportFailed, ExtraMissing: the file, the profile and the DBC do not go together; nothing is left behind.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with FrameSpool(folder) as spool:
        recording = _read(path, profile, battery, dbc, table, spool, on_progress)
        length_s = recording.length_ns / 1e9
        start_s = started_unix_s if started_unix_s is not None else recording.started_unix_s
        start_s = path.stat().st_mtime - length_s if start_s is None else start_s
        if not 0 <= start_s < LATEST_UNIX_S:
            raise ImportFailed(path.name, Message("begins-impossibly", start=f"{start_s:.0f}"))
        wall_ns = round(start_s * 1e9)
        target = new_file(folder, wall_ns)
        info = SessionInfo(
            id=target.stem,
            path=target,
            name=name or path.name,
            started_wall_ns=wall_ns,
            started_mono_ns=START_MONO_NS,
            voltwall=__version__,
            map_hash=MAP_HASH.hex(),
            metadata={"imported_from": path.name},
        )
        try:
            ended = _write(info, recording, new_pipeline(recording.battery), on_progress)
        except BaseException:
            remove(target)
            raise
    return Imported(ended, recording.rows, recording.cells, recording.notes)


def _read(
    path: Path,
    profile: ImportProfile,
    battery: LoadedBattery | None,
    dbc: Path | None,
    table: Table | None,
    spool: FrameSpool,
    on_progress: Progress,
) -> _Recording:
    bad = BadRows()
    if not is_can_log(path):
        if table is None:
            table = read_table(path, between(on_progress, 0.0, READING_TABLE))
        of_file = _of_table(battery_log(table, profile), path.name, spool, battery)
        return replace(of_file, begun=READING_TABLE)
    size = max(path.stat().st_size, 1)
    reading, decoding = between(on_progress, 0.0, READING), between(on_progress, READING, DECODING)
    frames = can_log.read_frames(path, bad, lambda at: reading(at, size))
    if dbc is None:
        of_frames = _of_frames(path.name, frames, battery or team_battery(), spool)
        return replace(of_frames, notes=(*bad.notes(len(spool)), *of_frames.notes))
    for frame in frames:
        spool.add(frame)
    signals = can_log.read_signals(path, dbc, on_read=lambda at: decoding(at, size)).table(profile)
    profile = replace(profile, **can_log.column_profile(profile))  # type: ignore[arg-type]
    of_table = _of_table(battery_log(signals, profile), path.name, spool, battery)
    return replace(of_table, begun=DECODING)


def between(on_progress: Progress, start: float, end: float) -> Progress:
    """Return what tells the progress of a step as that of the import; it takes from start to end of it, 0..1."""
    return lambda done, of: on_progress(round(PARTS * (start + (end - start) * done / max(of, 1))), PARTS)


def _of_table(log: BatteryLog, source: str, spool: FrameSpool, like: LoadedBattery | None) -> _Recording:
    """A table's rows as frames, among those of the log that it was made of."""
    later_ns, started_s = 0, log.started_unix_s
    if spool:
        later_ns = round((log.started_unix_s - spool.first_s) * 1e9) if log.started_unix_s else 0
        started_s = spool.first_s if spool.first_s > SINCE_1970_S else log.started_unix_s
    rows = ((t_ns + later_ns, can_id, data) for row in frames_of_table(log) for t_ns, can_id, data in row)
    length_ns = max(round(float(log.time_s[-1]) * 1e9) + later_ns, _length_ns(spool))
    n_frames = len(spool) + len(log.time_s) * frames_a_row(log)
    return _Recording(
        battery_of_table(log, source, like),
        merge(_timed(spool), rows, key=itemgetter(0)),
        n_frames,
        length_ns,
        len(log.time_s),
        log.n_cells,
        started_s,
        log.notes,
    )


def _timed(spool: FrameSpool) -> Iterator[TimedFrame]:
    """The frames by the time since the first one."""
    first_s = spool.first_s
    return ((round((at_s - first_s) * 1e9), can_id, data) for at_s, can_id, data in spool)


def _length_ns(spool: FrameSpool) -> int:
    return round((spool.last_s - spool.first_s) * 1e9) if spool else 0


def _of_frames(source: str, frames: Iterator[can_log.Frame], battery: LoadedBattery, spool: FrameSpool) -> _Recording:
    """The frames of a battery; into the spool."""
    speaks = battery.speaks_dbc
    decoder = None if speaks is None else BatteryDecoder(battery.battery, speaks, battery.definitions)
    heard: set[int] = set()
    while part := list(islice(frames, DECODED_AT_ONCE)):
        for frame in part:
            spool.add(frame)
        if decoder is not None:
            values = decoder.decode(frames_of([(0, can_id, data) for _, can_id, data in part])).get("voltage")
            heard |= set() if values is None else set(values.index.tolist())
    if not spool:
        raise ImportFailed(source, Message("no-data-frame"))
    notes: list[Message] = []
    if decoder is None:
        notes.append(Message("own-master"))
    else:
        if not heard:
            raise ImportFailed(source, Message("no-voltage-of-battery", name=battery.battery.name))
        n_cells = battery.battery.n_cells
        if len(heard) < n_cells:
            notes.append(Message("cells-not-heard", silent=n_cells - len(heard), cells=n_cells))
        if decoder.bad_checksums:
            notes.append(Message("wrong-checksums", frames=decoder.bad_checksums))
    started_s = spool.first_s if spool.first_s > SINCE_1970_S else None
    length_ns, n_frames = _length_ns(spool), len(spool)
    return _Recording(battery, _timed(spool), n_frames, length_ns, n_frames, len(heard), started_s, tuple(notes))


def _write(info: SessionInfo, recording: _Recording, pipeline: Pipeline, on_progress: Progress) -> SessionInfo:
    writer = SessionWriter(info, format_cell(load_cell(pipeline.cell_name)), recording.battery)
    writing = between(on_progress, recording.begun, 1.0)
    segments = recording.battery.battery.segments
    try:
        done = 0
        for part in _parts(recording.frames):
            writer.write(_rows(info, part, pipeline, segments))
            writer.close_chunk_if_due(START_MONO_NS + part[-1][0])
            done += len(part)
            writing(done, recording.n_frames)
        end_ns = recording.length_ns
        last = pipeline.tick(START_MONO_NS + end_ns, info.started_wall_ns + end_ns)  # no frame ends the last period
        writer.write(list(_rows_of(last, START_MONO_NS + end_ns, segments)))
        writer.close(START_MONO_NS + end_ns, info.started_wall_ns + end_ns)
    finally:
        writer.abandon()
    return replace(info, ended_mono_ns=START_MONO_NS + end_ns, ended_wall_ns=info.started_wall_ns + end_ns)


def _parts(frames: Iterable[TimedFrame]) -> Iterator[list[TimedFrame]]:
    """Some frames at a time: those of one instant together, for a chunk does not part them."""
    part: list[TimedFrame] = []
    for frame in frames:
        if len(part) >= BATCH and frame[0] != part[-1][0]:
            yield part
            part = []
        part.append(frame)
    if part:
        yield part


def _rows(
    info: SessionInfo, frames: Iterable[TimedFrame], pipeline: Pipeline, segments: Sequence[int]
) -> list[TableRow]:
    """Frames, and what the pipeline made of them."""
    rows: list[TableRow] = []
    wall_of_mono_ns = info.started_wall_ns - START_MONO_NS
    for t_ns, can_id, data in frames:
        mono_ns = START_MONO_NS + t_ns
        wall_ns = mono_ns + wall_of_mono_ns
        rows.append(("can_frames", (mono_ns, wall_ns, can_id, data)))
        output = pipeline.feed(CanItem(mono_ns, wall_ns, can_id, data))
        if output.is_nothing:
            continue
        pipeline.predict()
        rows += _rows_of(output, mono_ns, segments)
    return rows


def _rows_of(output: Output, mono_ns: int, segments: Sequence[int]) -> Iterator[TableRow]:
    if output.estimates is not None:
        estimates = output.estimates
        yield "estimates", (output.t_mono_ns, output.uptime_ms, estimates.soc, estimates.soc_sigma)
    for event in output.events:
        yield event_row(mono_ns, event, segments)
