"""Sessions that are damaged afterwards, byte by byte, or that somebody made to do harm."""

import random
import shutil
import sqlite3

import numpy as np
import pytest

from app.sessions.catalogue import Catalogue
from app.sessions.errors import SessionError
from app.sessions.info import SessionInfo
from app.sessions.reading.reader import SessionFile
from app.sessions.recording.session_writer import SessionWriter, event_row
from app.sessions.storage import database
from app.sessions.storage.streams import MOST_SAMPLES, pack_block, unpack_streams
from app.sessions.transfer.repair import repair
from app.telemetry import Event
from app.words import Message
from firmware_protocol.memory_map import MAP_HASH
from tests.campaign import campaign, of_size, report_figure
from tests.unit.app.sessions.conftest import MONO_NS, WALL_NS, Stream

COPIES = of_size(25, 100, 300, 1000)
FRAMES = 300
ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i FROM n) SELECT count(*) FROM n"
RECEIVED = ("frames", "can_frames", "events", "markers", "configs", "clock")
TABLES = (*RECEIVED, "tracks", "columns", "chunks", "series", "meta")


def write(path):
    path.touch()
    info = SessionInfo(path.stem, path, "a run", WALL_NS, MONO_NS, voltwall="test", map_hash=MAP_HASH.hex())
    writer = SessionWriter(info)
    stream = Stream()
    for number in range(FRAMES):
        t_ns, wall_ns, raw = stream.next()
        writer.write([("frames", (t_ns, wall_ns, 0, 1, raw)), ("can_frames", (t_ns, wall_ns, 0x123, bytes(8), 0))])
        if number % 100 == 50:
            writer.write([event_row(t_ns, Event(wall_ns, "info", "test", Message("file-empty"), value=5, limit=5.5))])
            writer.write([("markers", (t_ns, wall_ns, "note", "a pebble", None))])
    writer.close(t_ns, wall_ns)
    return path


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    return write(tmp_path_factory.mktemp("sound") / "20260101T000000Z.sqlite")


def content(path):
    """Every row of every table, None where that cannot be read."""
    with sqlite3.connect(path) as connection:
        try:
            rows = [connection.execute(f"SELECT * FROM {table} ORDER BY 1").fetchall() for table in TABLES]
        except (sqlite3.Error, UnicodeDecodeError):
            rows = None
    connection.close()
    return rows


def problems(path):
    try:
        with SessionFile(path) as session:
            return session.problems()
    except SessionError as error:
        return [error]


def damaged(path, source, seed):
    """A copy of which a few bytes are others."""
    chance = random.Random(seed)
    body = bytearray(source.read_bytes())
    for _ in range(chance.choice((1, 1, 2, 8))):
        body[chance.randrange(100, len(body))] ^= 1 << chance.randrange(8)
    path.write_bytes(body)
    return path


@campaign(60, 300, 1200)
def test_no_damaged_copy_is_called_sound_although_its_content_differs(sound, tmp_path):
    assert problems(sound) == []
    as_recorded = content(sound)
    called_sound = [
        seed
        for seed in range(COPIES)
        if not problems(path := damaged(tmp_path / "copy.sqlite", sound, seed)) and content(path) != as_recorded
    ]
    assert called_sound == []
    report_figure(
        f"{COPIES} damaged copies of a session: {len(called_sound)} called sound although their content differs"
    )


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ("UPDATE frames SET raw = zeroblob(50) WHERE id = 7", "the checksum of 1 is not as it was"),
        ("UPDATE frames SET t_mono_ns = t_mono_ns + 5000000 WHERE id = 8", "columns:"),
        ("UPDATE chunks SET boots = 3", "starts of the master"),
    ],
)
def test_without_digests_frames_and_columns_prove_each_other(sound, tmp_path, change, told):
    path = shutil.copy(sound, tmp_path / sound.name)
    with sqlite3.connect(path) as connection:
        connection.execute("DELETE FROM meta WHERE key = 'digests'")
        connection.execute(change)
    connection.close()
    assert told in "; ".join(problems(path))


def test_a_repaired_copy_is_sound_and_holds_all_the_rest(sound, tmp_path):
    path = shutil.copy(sound, tmp_path / sound.name)
    with sqlite3.connect(path) as connection:
        connection.execute("UPDATE frames SET raw = zeroblob(50) WHERE id = 7")
        connection.execute("DELETE FROM frames WHERE id = 20")
    connection.close()
    lost = repair(path, tmp_path / "mended.sqlite")
    assert +lost == {"frames": 1, "frames now marked as damaged": 1}
    with SessionFile(tmp_path / "mended.sqlite") as session:
        assert session.problems() == []
        assert session.info.frames == FRAMES - 1
        assert session.bad_frames() == 1
        assert len(session.events()) == 3
        assert [marker.text for marker in session.markers()] == ["a pebble"] * 3


def test_what_lies_on_damaged_pages_is_lost_and_the_rest_is_not(sound, tmp_path):
    body = bytearray(sound.read_bytes())
    page = int.from_bytes(body[16:18], "big")
    raw = sqlite3.connect(sound).execute("SELECT raw FROM frames WHERE id = 150").fetchone()[0]
    start = body.index(raw) // page * page
    body[start : start + page] = bytes(page)
    path = tmp_path / "holed.sqlite"
    path.write_bytes(body)
    assert problems(path)
    lost = repair(path, tmp_path / "mended.sqlite")
    assert 0 < lost["frames"] < 30
    with SessionFile(tmp_path / "mended.sqlite") as session:
        assert session.problems() == []
        assert session.info.frames == FRAMES - lost["frames"]


@pytest.mark.parametrize(
    "trap",
    [
        f"DROP TABLE markers; CREATE VIEW markers AS {ENDLESS}",
        "CREATE TRIGGER trap AFTER INSERT ON notes BEGIN DELETE FROM frames; END",
        "DROP TABLE markers; CREATE TABLE markers (id INTEGER PRIMARY KEY, text AS (hex(zeroblob(1000000))))",
    ],
    ids=["an endless view", "a trigger", "a column that is computed"],
)
def test_a_session_that_runs_something_is_none(sound, tmp_path, trap):
    path = shutil.copy(sound, tmp_path / sound.name)
    with sqlite3.connect(path) as connection:
        connection.executescript(trap)
    connection.close()
    found, refused = Catalogue(tmp_path).survey()
    assert found == []
    assert "not a session" in str(refused[0])


def test_a_query_that_does_not_end_is_ended(sound, monkeypatch):
    monkeypatch.setattr(database, "QUERY_S", 0.1)
    with SessionFile(sound) as session, pytest.raises(SessionError, match="interrupted"):
        session._stored.rows(ENDLESS)


def test_a_column_is_unpacked_no_further_than_its_samples():
    bomb = pack_block(nearly_zeros())[1]
    with pytest.raises(ValueError, match="other than 200 bytes"):
        unpack_streams([bomb], "<u2", 100)
    with pytest.raises(ValueError, match=str(MOST_SAMPLES)):
        unpack_streams([bomb], "<u2", 1 << 40)


def nearly_zeros():
    values = np.zeros((1_000_000, 1), "<u2")
    values[0] = 1
    return values
