"""Fuzz targets for files from elsewhere: DBC, CAN logs, tables, battery profiles, sessions."""

import contextlib
import sqlite3
import struct
import tempfile
from functools import cache
from pathlib import Path

import numpy as np

from app.battery.library import profile_files
from app.configuration.saved_configuration import parse_profile as parse_config_profile
from app.errors import AppError, ConfigError, ImportFailed, LimitExceeded
from app.sessions.errors import SessionError
from app.sessions.reading.reader import SessionFile
from app.sources.dbc.assembly import Assembler
from app.sources.dbc.battery_decoder import BatteryDecoder
from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.decoder import decode_frames
from app.sources.dbc.frames import Frames, frames_of
from app.sources.loaded_battery import battery_from_files
from app.sources.recordings.battery_log import battery_log
from app.sources.recordings.csv_table import TableUnreadable
from app.sources.recordings.guess import guess
from app.sources.recordings.import_mapping import parse_mapping
from app.sources.recordings.kind import ENDINGS
from app.sources.recordings.table import load_table
from firmware_protocol.config_image import default_image
from firmware_protocol.dbc_import import from_dbc, into_tables
from firmware_protocol.errors import DecodeError
from firmware_protocol.memory_map import CONFIG_SIZE

BREAK = b"\n==\n"  # between the parts of an input
BUNDLED = "one-signal-a-cell"
FROZEN = Path(__file__).parents[1] / "unit/app/sessions/frozen"


@cache
def _folder() -> Path:
    kept = tempfile.TemporaryDirectory(prefix="voltwall-fuzz-")
    _folder.kept = kept  # type: ignore[attr-defined]
    return Path(kept.name)


def _frames(data: bytes) -> Frames:
    """Frames of length u8, id u32 and bytes, 10 ms from each other."""
    found, at = [], 0
    while at + 5 <= len(data) and len(found) < 200:
        length, can_id = struct.unpack_from("<BI", data, at)
        found.append((10_000_000 * len(found), can_id & 0x9FFFFFFF, data[at + 5 : at + 5 + min(length, 64)]))
        at += 5 + min(length, 64)
    return frames_of(found)


def dbc(data: bytes) -> None:
    """A DBC and frames: definitions that decode anything, or a refusal; into the CAN tables of a master or not."""
    text, _, frames = data.partition(BREAK)
    with contextlib.suppress(ImportFailed):
        definitions = parse_definitions(text, "x.dbc")
        for series in decode_frames(_frames(frames), definitions).values():
            assert len(series.t_ns) == len(series.values)
    with contextlib.suppress(DecodeError):
        image, _ = into_tables(default_image(), from_dbc(text.decode("utf-8", "replace")))
        assert len(image) == CONFIG_SIZE


@cache
def bundled(name: str = BUNDLED) -> dict[str, bytes]:
    """The files of a bundled battery, the profile first."""
    return profile_files(name)


def profile(data: bytes) -> None:
    """A battery profile and frames: a battery whose values are numbers in range, or a refusal by line and field."""
    text, _, frames = data.partition(BREAK)
    first, *others = bundled()
    files = {first: text} | {name: bundled()[name] for name in others}
    try:
        loaded = battery_from_files(files)
    except (ConfigError, ImportFailed):
        loaded = None
    if loaded is not None and loaded.dbc_mapping is not None:
        decoder = BatteryDecoder(loaded.battery, loaded.dbc_mapping, loaded.definitions)
        assembler = Assembler(loaded.battery, loaded.dbc_mapping)
        for measured in assembler.feed(decoder.decode(_frames(frames))):
            assert measured.voltage_v.shape == (loaded.battery.n_cells,)
            assert not np.isinf(measured.voltage_v).any()
    with contextlib.suppress(ConfigError):
        assert len(parse_config_profile(text).image) == CONFIG_SIZE
    with contextlib.suppress(ImportFailed):
        parse_mapping(text.decode("utf-8", "replace"))


def can_log(data: bytes) -> None:
    """A CAN log of any program: frames with times and at most 64 bytes, or a refusal."""
    from app.sources.dbc.frames import load_log

    endings = tuple(each for each in ENDINGS if each != ".mf4")  # asammdf's own, in a worker with limits
    path = _folder() / f"x{endings[data[0] % len(endings) if data else 0]}"
    path.write_bytes(data[1:])
    with contextlib.suppress(ImportFailed):
        frames = load_log(path)
        assert (np.diff(frames.t_ns) >= 0).all()
        assert (frames.length <= 64).all()


def csv(data: bytes) -> None:
    """A table of any rig, plain or gzip: columns of one length, and a recording in order, or a refusal."""
    path = _folder() / "x.csv"
    path.write_bytes(data)
    with contextlib.suppress(ImportFailed, LimitExceeded, TableUnreadable):
        table = load_table(path)
        assert len({len(column) for column in table.columns.values()}) == 1
        log = battery_log(table, guess(table))
        assert (np.diff(log.time_s) >= 0).all()
        assert np.isfinite(log.time_s).all()
        assert not np.isinf(log.voltages_v).any()
        assert len(log.time_s) == len(log.current_a) == len(log.voltages_v)


@cache
def frozen() -> tuple[bytes, tuple[tuple[str, str], ...]]:
    """A session as bytes, and its columns."""
    path = max(FROZEN.glob("session_*.sqlite"))
    with contextlib.closing(sqlite3.connect(f"{path.as_uri()}?mode=ro&immutable=1", uri=True)) as connection:
        tables = [name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        columns = [
            (table, column)
            for table in sorted(tables)
            if not table.startswith("sqlite_")
            for _, column, *_ in connection.execute(f"PRAGMA table_info({table})")
        ]
    return path.read_bytes(), tuple(columns)


def _value(kind: int, data: bytes) -> object:
    if kind % 5 == 0:
        return int.from_bytes(data[:8].ljust(8, b"\0"), "little", signed=True)
    if kind % 5 == 1:
        return struct.unpack("<d", data[:8].ljust(8, b"\0"))[0]
    if kind % 5 == 2:
        return data.decode("utf-8", "replace")
    return data if kind % 5 == 3 else None


def session(data: bytes) -> None:
    """Changes of a session: kind u8, place u32, length u8 and bytes, through SQL or in its pages."""
    content, columns = frozen()
    path = _folder() / "x.sqlite"
    path.write_bytes(content)
    changes, at = [], 0
    while at + 6 <= len(data) and len(changes) < 12:
        kind, place, length = struct.unpack_from("<BIB", data, at)
        changes.append((kind, place, data[at + 6 : at + 6 + length]))
        at += 6 + length
    with contextlib.closing(sqlite3.connect(path, isolation_level=None)) as connection:
        connection.execute("PRAGMA synchronous = OFF")
        for kind, place, value in changes:
            if kind & 1:
                table, column = columns[place % len(columns)]
                row = f"(SELECT rowid FROM {table} LIMIT 1 OFFSET {(place >> 8) % 50})"
                with contextlib.suppress(sqlite3.Error):
                    connection.execute(
                        f"UPDATE {table} SET {column} = ? WHERE rowid = {row}", (_value(kind >> 1, value),)
                    )
    raw = bytearray(path.read_bytes())
    for kind, place, value in changes:
        if not kind & 1:
            start = place % len(raw)
            raw[start : start + len(value)] = value
            if kind & 0x80:
                del raw[max(512, start) :]
    path.write_bytes(raw)
    read_session(path)


def read_session(path: Path) -> None:
    """Read all that a session file holds, or be told why not."""
    with contextlib.suppress(SessionError), SessionFile(path) as found:
        looks = (
            lambda: found.info,
            lambda: list(found.frames()),
            lambda: list(found.can_frames()),
            lambda: list(found.estimates()),
            found.configs,
            found.markers,
            found.events,
            lambda: found.series(["v[36]", "i_fs"]),
            found.problems,
        )
        for look in looks:
            with contextlib.suppress(AppError):
                look()
