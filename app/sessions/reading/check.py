"""Is a session what was recorded? Its pages, its digests, every frame's checksum, every column against its frames."""

from collections.abc import Callable, Collection, Iterator
from typing import Any

import numpy as np

from app.sessions.errors import NotASession
from app.sessions.recording.session_writer import IDS_PER_CHUNK
from app.sessions.storage.chunks import Chunk, ChunkBuilder, SeriesKey
from app.sessions.storage.digests import COLUMNS, KEY, META, Digest, digested, meta_digest
from app.sessions.storage.queries import StoredSession
from app.sessions.storage.streams import stream_ranges, unpack_streams
from app.sources.data_file import parse_object
from app.words import render
from firmware_protocol.framing import Frame, decode_chunk
from firmware_protocol.older_maps import fields_of, is_known

_COUNTED = ("frames", "can_frames", "measurements", "events")  # tables that may be long


class _Read:
    """Counts the rows that were looked at: each for its digest, a frame for its checksum and for its columns, too."""

    def __init__(self, stored: StoredSession, on_read: Callable[[int, int], None] | None) -> None:
        self._on_read = on_read
        self._done, self._of = 0, 0
        if on_read is not None:
            self._of = sum(stored.last_id(table) for table in ("frames", "frames", *_COUNTED))

    def __call__(self, rows: int) -> None:
        self._done += rows
        if self._on_read is not None:
            self._on_read(min(self._done, self._of), self._of)


def find_problems(stored: StoredSession, on_read: Callable[[int, int], None] | None = None) -> list[str]:
    """Read every byte of a session and return what is wrong with it; an empty list is a sound file.

    Args:
        stored: the session.
        on_read: called with how many of its rows are read, and of how many.
    """
    problems: list[str] = []
    try:
        problems += stored.check_pages()
        with stored.consistent(), stored.sound():
            read = _Read(stored, on_read)
            problems += _rows_missing(stored)
            problems += _digests(stored, read)
            problems += _frames(stored, read)
            problems += _columns(stored, read)
    except NotASession as error:
        problems.append(render(error.reason))
    return problems


def _rows_missing(stored: StoredSession) -> Iterator[str]:
    for table in ("frames", "can_frames", "measurements"):
        missing = stored.last_id(table) - stored.rows(f"SELECT count(*) FROM {table}")[0][0]
        if missing:
            yield f"{table}: {missing} rows are missing"


def _digests(stored: StoredSession, read: _Read) -> Iterator[str]:
    """Sessions of before 2026-11 have no digests."""
    meta = dict(stored.rows("SELECT key, value FROM meta"))
    if KEY not in meta:
        return
    for table, (last_id, digest) in parse_object(meta[KEY]).items():
        if table == META:
            is_sound = [last_id, digest] == list(meta_digest(meta))
        else:
            here = Digest()
            for rows in _all_rows(stored, table, last_id):
                here.add_all(digested(table, rows))
                read(len(rows) if table in _COUNTED else 0)
            is_sound = here.value == (last_id, digest)
        if not is_sound:
            yield f"{table}: not as it was recorded"


def _all_rows(stored: StoredSession, table: str, last_id: int) -> Iterator[list[tuple[Any, ...]]]:
    after = -1
    query = f"SELECT {COLUMNS[table]} FROM {table} WHERE id > ? AND id <= ? ORDER BY id LIMIT 500"
    while rows := stored.rows(query, (after, last_id)):
        yield rows
        after = rows[-1][0]


def _frames(stored: StoredSession, read: _Read) -> Iterator[str]:
    """Frames that were intact when they came are so still, and those that were not, too."""
    wrong: list[int] = []
    for number, raw, ok in _all_frames(stored, 0, 1 << 62):
        if isinstance(decode_chunk(raw), Frame) != bool(ok):
            wrong.append(number)
        read(1)
    if wrong:
        yield f"frames: the checksum of {len(wrong)} is not as it was, the first is number {wrong[0]}"


def _all_frames(stored: StoredSession, first: int, last: int) -> Iterator[tuple[int, bytes, int]]:
    query = "SELECT id, raw, ok FROM frames WHERE id >= ? AND id <= ? ORDER BY id LIMIT 500"
    while rows := stored.rows(query, (first, last)):
        yield from rows
        first = rows[-1][0] + 1


def _columns(stored: StoredSession, read: _Read) -> Iterator[str]:
    """Every column can be unpacked; the master's columns hold what its frames hold."""
    ((map_hash,),) = stored.rows("SELECT value FROM meta WHERE key = 'map_hash'")
    is_known_map = is_known(map_hash)
    series = {row[0]: SeriesKey(*row[1:]) for row in stored.rows("SELECT * FROM series")}
    builder = ChunkBuilder(decodes_can=False, map_hash=map_hash)
    wrong: set[str] = set()
    for number, first, last, boots in stored.rows("SELECT id, first_frame, last_frame, boots FROM chunks ORDER BY id"):
        expected = None
        read(last + 1 - first)
        if is_known_map:
            rows = stored.rows(
                "SELECT t_mono_ns, raw FROM frames WHERE id >= ? AND id <= ? AND ok ORDER BY id", (first, last)
            )
            builder.add(rows)
            expected = builder.build()
            builder.clear()
            of_frames, _ = builder.master_clock
            if of_frames != boots:
                yield f"chunks: number {number} counts {boots} starts of the master, its frames {of_frames}"
        wrong |= set(_differences(stored, number, series, expected, fields_of(map_hash)))
    if wrong:
        yield f"columns: {', '.join(sorted(wrong))} not as the frames say"


def _differences(
    stored: StoredSession,
    chunk_id: int,
    series: dict[int, SeriesKey],
    expected: Chunk | None,
    fields: Collection[str],
) -> Iterator[str]:
    """Names of the fields of a chunk that cannot be read, or that tell something else than its frames."""
    base = chunk_id * IDS_PER_CHUNK
    tracks: dict[int, tuple[Any, Any]] = {}
    with_track = "SELECT id, samples, times_us, instants FROM tracks WHERE id >= ? AND id < ?"
    for number, n, times, instants in stored.rows(with_track, (base, base + IDS_PER_CHUNK)):
        tracks[number] = tuple(unpack_streams([packed], "<i8", n)[:, 0] for packed in (times, instants))  # type: ignore[assignment]
    left = set() if expected is None else set(expected.columns)
    with_columns = "SELECT id, track, ends, data FROM columns WHERE id >= ? AND id < ?"
    for number, track, ends, data in stored.rows(with_columns, (base, base + IDS_PER_CHUNK)):
        key = series[number - base]
        ranges = stream_ranges(ends, np.arange(key.elements))
        times_us, instants = tracks[track]
        values = unpack_streams([data[low:high] for low, high in ranges], key.dtype, len(times_us))
        if ranges[-1][1] != len(data):
            yield key.field
        if expected is None or key.field.startswith("estimate.") or key.field not in fields:
            continue  # a field of our own map was recorded until the master named its map
        by_line = instants >= 0
        left.discard(key)
        if key not in expected.columns:
            if by_line.any():
                yield key.field
            continue
        number_of_track, recorded = expected.columns[key]
        of_frames = expected.tracks[number_of_track]
        same = (
            np.array_equal(times_us[by_line], of_frames.times_us)
            and np.array_equal(instants[by_line], of_frames.instants)
            and np.array_equal(values[by_line], recorded)
        )
        if not same:
            yield key.field
    yield from (key.field for key in left)
