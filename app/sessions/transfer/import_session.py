"""Makes a session of another system's recording: estimated by our filter, read like any other session."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from app import __version__
from app.errors import ImportFailed
from app.estimation.cell_model.cell_file import format_cell, load_cell
from app.live.pipeline import Output, Pipeline
from app.sessions.info import SessionInfo
from app.sessions.recording.session_writer import SessionWriter, TableRow, event_row
from app.sessions.storage.files import new_file, remove
from app.sessions.transfer.table_battery import battery_of_table, frames_of_table
from app.sources.dbc.battery_decoder import BatteryDecoder
from app.sources.dbc.frames import TimedFrame, frames_of
from app.sources.items import CanItem
from app.sources.loaded_battery import LoadedBattery, team_battery
from app.sources.recordings import can_log
from app.sources.recordings.bad_rows import BadRows
from app.sources.recordings.battery_log import BatteryLog, battery_log
from app.sources.recordings.kind import is_can_log
from app.sources.recordings.profile import ImportProfile
from app.sources.recordings.table import read_table
from app.words import Message, naming_cells
from firmware_protocol.memory_map import MAP_HASH

START_MONO_NS = 10**9  # such a recording has no monotonic clock; its time axis begins here
BATCH = 2000  # frames
DECODED_AT_ONCE = 100_000
LATEST_UNIX_S = 4_102_444_800  # 2100
SINCE_1970_S = 9e8  # a log's time beyond it is no time since its begin
Progress = Callable[[int, int], None]  # frames done, frames in all
NewPipeline = Callable[[LoadedBattery], Pipeline]


@dataclass(frozen=True, slots=True)
class Imported:
    """What was made; rows of a table, frames of a log."""

    info: SessionInfo
    rows: int
    cells: int
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Recording:
    """What is written: frames in order, their times in ns since the first one."""

    battery: LoadedBattery
    frames: list[TimedFrame]
    rows: int
    cells: int
    started_unix_s: float | None
    notes: tuple[str, ...]


def import_file(
    path: Path,
    profile: ImportProfile,
    folder: Path,
    new_pipeline: NewPipeline,
    *,
    battery: LoadedBattery | None = None,
    dbc: Path | None = None,
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
        name: of the session; the file's where empty.
        started_unix_s: where the file does not say; else the time at which the file was changed, less its length.
        on_progress: called with how far it is.

    Raises:
        ImportFailed, ExtraMissing: the file, the profile and the DBC do not go together; nothing is left behind.
    """
    recording = _read(path, profile, battery, dbc)
    length_s = recording.frames[-1][0] / 1e9
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
        with naming_cells(recording.battery.battery.segments):
            ended = _write(info, recording, new_pipeline(recording.battery), on_progress)
    except BaseException:
        remove(target)
        raise
    return Imported(ended, recording.rows, recording.cells, recording.notes)


def _read(path: Path, profile: ImportProfile, battery: LoadedBattery | None, dbc: Path | None) -> _Recording:
    is_can, bad = is_can_log(path), BadRows()
    log: list[can_log.Frame] = sorted(can_log.read_frames(path, bad), key=lambda frame: frame[0]) if is_can else []
    first_s = log[0][0] if log else 0.0
    frames = [(round((at_s - first_s) * 1e9), can_id, data) for at_s, can_id, data in log]
    if is_can and dbc is None:
        if not frames:
            raise ImportFailed(path.name, Message("no-data-frame"))
        started_s = first_s if first_s > SINCE_1970_S else None
        of_frames = _of_frames(path.name, frames, battery or team_battery(), started_s)
        return replace(of_frames, notes=(*bad.notes(len(frames)), *of_frames.notes))
    if is_can and dbc is not None:
        table = can_log.read_signals(path, dbc).table(profile)
        profile = replace(profile, **can_log.column_profile(profile))  # type: ignore[arg-type]
    else:
        table = read_table(path)
    return _of_table(battery_log(table, profile), path.name, frames, first_s, battery)


def _of_table(
    log: BatteryLog, source: str, others: list[TimedFrame], first_s: float, like: LoadedBattery | None
) -> _Recording:
    """A table's rows as frames, among those of the log that it was made of."""
    frames = [frame for row in frames_of_table(log) for frame in row]
    if others:
        later_ns = round(((log.started_unix_s or 0.0) - first_s) * 1e9) if log.started_unix_s else 0
        made = [(t_ns + later_ns, can_id, data) for t_ns, can_id, data in frames]
        frames = sorted([*others, *made], key=lambda frame: frame[0])
    started_s = first_s if others and first_s > SINCE_1970_S else log.started_unix_s
    battery = battery_of_table(log, source, like)
    return _Recording(battery, frames, len(log.time_s), log.n_cells, started_s, log.notes)


def _of_frames(
    source: str, frames: list[TimedFrame], battery: LoadedBattery, started_unix_s: float | None
) -> _Recording:
    speaks = battery.speaks_dbc
    if speaks is None:
        note = "CAN frames as of our own master: no battery and no DBC was named"
        return _Recording(battery, frames, len(frames), 0, started_unix_s, (note,))
    decoder = BatteryDecoder(battery.battery, speaks, battery.definitions)
    heard: set[int] = set()
    for start in range(0, len(frames), DECODED_AT_ONCE):
        values = decoder.decode(frames_of(frames[start : start + DECODED_AT_ONCE])).get("voltage")
        heard |= set() if values is None else set(values.index.tolist())
    if not heard:
        raise ImportFailed(source, Message("no-voltage-of-battery", name=battery.battery.name))
    n_cells, notes = battery.battery.n_cells, []
    if len(heard) < n_cells:
        notes.append(f"{n_cells - len(heard)} of {n_cells} cells were never heard")
    if decoder.bad_checksums:
        notes.append(f"{decoder.bad_checksums} frames with a wrong checksum tell nothing")
    return _Recording(battery, frames, len(frames), len(heard), started_unix_s, tuple(notes))


def _write(info: SessionInfo, recording: _Recording, pipeline: Pipeline, on_progress: Progress) -> SessionInfo:
    writer = SessionWriter(info, format_cell(load_cell(pipeline.cell_name)), recording.battery)
    total = len(recording.frames)
    try:
        done = 0
        while done < total:
            end = min(done + BATCH, total)
            while end < total and recording.frames[end][0] == recording.frames[end - 1][0]:
                end += 1  # a chunk does not part the frames of one instant
            part = recording.frames[done:end]
            writer.write([row for frame in part for row in _rows(info, frame, pipeline)])
            writer.close_chunk_if_due(START_MONO_NS + part[-1][0])
            done = end
            on_progress(done, total)
        end_ns = recording.frames[-1][0]
        last = pipeline.tick(START_MONO_NS + end_ns, info.started_wall_ns + end_ns)  # no frame ends the last period
        writer.write(list(_rows_of(last, START_MONO_NS + end_ns)))
        writer.close(START_MONO_NS + end_ns, info.started_wall_ns + end_ns)
    finally:
        writer.abandon()
    return replace(info, ended_mono_ns=START_MONO_NS + end_ns, ended_wall_ns=info.started_wall_ns + end_ns)


def _rows(info: SessionInfo, frame: TimedFrame, pipeline: Pipeline) -> Iterator[TableRow]:
    """A frame, and what the pipeline made of it."""
    t_ns, can_id, data = frame
    mono_ns, wall_ns = START_MONO_NS + t_ns, info.started_wall_ns + t_ns
    yield "can_frames", (mono_ns, wall_ns, can_id, data)
    output = pipeline.feed(CanItem(mono_ns, wall_ns, can_id, data))
    pipeline.predict()
    yield from _rows_of(output, mono_ns)


def _rows_of(output: Output, mono_ns: int) -> Iterator[TableRow]:
    if output.estimates is not None:
        estimates = output.estimates
        yield "estimates", (output.t_mono_ns, output.uptime_ms, estimates.soc, estimates.soc_sigma)
    for event in output.events:
        yield event_row(mono_ns, event)
