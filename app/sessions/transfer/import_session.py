"""Makes a session of another system's recording: estimated by our filter, read like any other session."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from app import __version__
from app.errors import ImportFailed
from app.estimation.arrays import FloatArray
from app.live.pipeline import Pipeline
from app.sessions.info import SessionInfo
from app.sessions.recording.session_writer import SessionWriter, TableRow, event_row
from app.sessions.storage.chunks import FOREIGN_CAN
from app.sessions.storage.files import new_file
from app.sources.items import SerialItem
from app.sources.recordings import can_log
from app.sources.recordings.battery_log import BatteryLog, battery_log
from app.sources.recordings.csv_table import TableUnreadable
from app.sources.recordings.profile import ImportProfile
from app.sources.recordings.table import Table, load_table
from app.words import Message
from firmware_protocol.framing import decode_chunk, encode_frame
from firmware_protocol.memory_map import FIELDS, MAP_HASH, MASTER_SIZE, T_MISSING, V_MISSING
from firmware_protocol.messages import Data, MessageType, Window

IMPORTED_LINK = 2  # in `frames.link`: made out of another system's recording
START_MONO_NS = 10**9  # such a recording has no monotonic clock; its time axis begins here
BATCH = 500
LATEST_UNIX_S = 4_102_444_800  # 2100
_V, _T, _I = (FIELDS[name] for name in ("v", "t", "i_fs"))
_CURRENT = (_I.offset, _I.size)
_VOLTAGES = (_V.offset, _V.size)
_VOLTAGE_TOTALS = (FIELDS["v_min"].offset, FIELDS["t"].offset - FIELDS["v_min"].offset)
_TEMPERATURES = (_T.offset, FIELDS["t_max_id"].end - _T.offset)
_SOC = (FIELDS["soc"].offset, FIELDS["soc"].size)
Progress = Callable[[int, int], None]  # rows done, rows in all


@dataclass(frozen=True, slots=True)
class Imported:
    """What was made."""

    info: SessionInfo
    rows: int
    cells: int
    notes: tuple[str, ...]


def read_table(path: Path) -> Table:
    """Return a CSV or Parquet file's table.

    Raises:
        ImportFailed: there is no table in it.
    """
    try:
        return load_table(path)
    except TableUnreadable as error:
        reason = Message("of-source", source=error.source, reason=error.reason)
        raise ImportFailed(path.name, reason) from error


def import_file(
    path: Path,
    profile: ImportProfile,
    folder: Path,
    new_pipeline: Callable[[], Pipeline],
    *,
    dbc: Path | None = None,
    name: str = "",
    started_unix_s: float | None = None,
    on_progress: Progress = lambda done, of: None,
) -> Imported:
    """Read a recording, run the filter over it and write it as a session into `folder`.

    Args:
        path: CSV or Parquet, plain or gzip; candump (.log), .asc or .blf. A CAN log without `dbc` is taken as of our
            own master: its frames are kept, and mean what the default CAN tables say.
        profile: which columns, or signals, are what.
        folder: of the sessions.
        new_pipeline: makes a fresh chain with the filter and the cell to use.
        dbc: of the CAN log's bus.
        name: of the session; the file's where empty.
        started_unix_s: where the file does not say; else the time at which the file was changed, less its length.
        on_progress: called with how far it is.

    Raises:
        ImportFailed, ExtraMissing: the file, the profile and the DBC do not go together; nothing is left behind.
    """
    is_can = path.name.lower().endswith(can_log.ENDINGS)
    frames: list[can_log.Frame] = list(can_log.read_frames(path)) if is_can else []
    log: BatteryLog | None = None
    if dbc is not None and is_can:
        table = can_log.signal_table(path, dbc, profile)
        log = battery_log(table, replace(profile, **can_log.column_profile(profile)))  # type: ignore[arg-type]
    elif not is_can:
        log = battery_log(read_table(path), profile)
    elif not frames:
        raise ImportFailed(path.name, Message("no-data-frame"))
    start_s = _start(path, log, frames, started_unix_s)
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
        metadata={"imported_from": path.name} | ({FOREIGN_CAN: True} if dbc is not None else {}),
    )
    try:
        done = _write(info, log, frames, new_pipeline(), on_progress)
    except BaseException:
        for beside in ("", "-wal", "-shm"):
            target.with_name(target.name + beside).unlink(missing_ok=True)
        raise
    return done


def _start(path: Path, log: BatteryLog | None, frames: list[can_log.Frame], given: float | None) -> float:
    if given is not None:
        return given
    if log is not None and log.started_unix_s is not None:
        return log.started_unix_s
    if log is None and frames[0][0] > 9e8:
        return frames[0][0]
    length_s = float(log.time_s[-1]) if log is not None else frames[-1][0] - frames[0][0]
    return path.stat().st_mtime - length_s


def _write(
    info: SessionInfo,
    log: BatteryLog | None,
    frames: list[can_log.Frame],
    pipeline: Pipeline,
    on_progress: Progress,
) -> Imported:
    writer = SessionWriter(info)
    try:
        at_ns = 0
        first_s = frames[0][0] if frames else 0.0
        for start in range(0, len(frames), BATCH):
            batch: list[TableRow] = []
            for at_s, can_id, data in frames[start : start + BATCH]:
                at_ns = max(at_ns, round((at_s - first_s) * 1e9))
                batch.append(("can_frames", (START_MONO_NS + at_ns, info.started_wall_ns + at_ns, can_id, data)))
            writer.write(batch)
            if log is None:
                writer.close_chunk_if_due(START_MONO_NS + at_ns)
                on_progress(min(start + BATCH, len(frames)), len(frames))
        end_ns = at_ns
        if log is not None:
            for done, batch in _batches(info, log, pipeline):
                writer.write(batch)
                writer.close_chunk_if_due(batch[-1][1][0])
                on_progress(done, len(log.time_s))
            end_ns = max(end_ns, round(float(log.time_s[-1]) * 1e9))
        writer.close(START_MONO_NS + end_ns, info.started_wall_ns + end_ns)
    finally:
        writer.abandon()
    ended = replace(info, ended_mono_ns=START_MONO_NS + end_ns, ended_wall_ns=info.started_wall_ns + end_ns)
    if log is None:
        return Imported(ended, len(frames), 0, ("CAN frames as of our own master: no DBC was named",))
    return Imported(ended, len(log.time_s), log.n_cells, log.notes)


def _batches(info: SessionInfo, log: BatteryLog, pipeline: Pipeline) -> Iterator[tuple[int, list[TableRow]]]:
    """Yield (rows done, items): a frame a row, and what the pipeline made of it."""
    batch: list[TableRow] = []
    for row, time_s in enumerate(log.time_s.tolist()):
        t_ns = round(time_s * 1e9)
        mono_ns, wall_ns = START_MONO_NS + t_ns, info.started_wall_ns + t_ns
        raw = encode_frame(MessageType.DATA, row & 0xFF, round(time_s * 1000) & 0xFFFFFFFF, _body(log, row))[1:-1]
        batch.append(("frames", (mono_ns, wall_ns, IMPORTED_LINK, 1, raw)))
        output = pipeline.feed(SerialItem(mono_ns, wall_ns, decode_chunk(raw)))
        pipeline.predict()
        if output.estimates is not None:
            estimates = output.estimates
            batch.append(("estimates", (mono_ns, output.uptime_ms, estimates.soc, estimates.soc_sigma)))
        batch += [event_row(mono_ns, event) for event in output.events]
        if len(batch) >= BATCH or row == len(log.time_s) - 1:
            yield row + 1, batch
            batch = []


def _body(log: BatteryLog, row: int) -> bytes:
    """A telemetry frame's body with what was measured, and no window of what was not."""
    image = bytearray(MASTER_SIZE)
    spans = []
    current_a = log.current_a[row]
    if np.isfinite(current_a):
        _I.pack_into(image, (int(np.clip(np.round(current_a / _I.scale), -(1 << 31), (1 << 31) - 1)),))
        spans.append(_CURRENT)
    voltages_v = log.voltages_v[row]
    known = np.isfinite(voltages_v)
    if known.any():
        counts = np.where(known, np.round(np.where(known, voltages_v, 0.0) / _V.scale), V_MISSING).astype(int)
        _V.pack_into(image, tuple(counts.tolist()))
        _totals(image, "v", np.where(known, counts, np.nan))
        total = int(min(0xFFFF, round(float(np.nansum(voltages_v)) / FIELDS["v_tot"].scale)))
        FIELDS["v_tot"].pack_into(image, (total,))
        spans += [_VOLTAGES, _VOLTAGE_TOTALS]
    degc = log.temperatures_degc[row]
    warm = np.isfinite(degc)
    if warm.any():
        rounded = np.where(warm, np.clip(np.round(np.where(warm, degc, 0.0)), -127, 127), T_MISSING).astype(int)
        _T.pack_into(image, tuple(rounded.tolist()))
        _totals(image, "t", np.where(warm, rounded, np.nan))
        spans.append(_TEMPERATURES)
    if log.soc is not None and np.isfinite(log.soc[row]):
        FIELDS["soc"].pack_into(image, (int(np.clip(round(float(log.soc[row]) / FIELDS["soc"].scale), 0, 10_000)),))
        spans.append(_SOC)
    return Data(tuple(Window(offset, bytes(image[offset : offset + length])) for offset, length in spans)).to_body()


def _totals(image: bytearray, prefix: str, counts: FloatArray) -> None:
    low, high = int(np.nanargmin(counts)), int(np.nanargmax(counts))
    values = {
        "min": int(counts[low]), "max": int(counts[high]), "avg": round(float(np.nanmean(counts))),
        "min_id": low, "max_id": high,
    }  # fmt: skip
    for name, value in values.items():
        FIELDS[f"{prefix}_{name}"].pack_into(image, (value,))
