"""Sessions as released versions wrote them, one file a schema version. New ones are added, none is ever edited."""

import shutil
from pathlib import Path

import pytest

from app.sessions.reading.reader import SessionFile
from app.sessions.storage.database import SESSION
from firmware_protocol.framing import Frame, decode_chunk

FROZEN = Path(__file__).parent / "frozen"
WALL_S = 1_790_000_000


def test_there_is_a_file_for_every_schema_version() -> None:
    assert sorted(path.name for path in FROZEN.iterdir()) == [f"session_{i + 1}.sqlite" for i in range(SESSION.version)]


@pytest.mark.parametrize("version", range(1, SESSION.version + 1))
def test_a_session_of_an_old_version_says_what_it_always_said(version: int, tmp_path: Path) -> None:
    """90 s at 1 Hz, of which 70 are in a chunk, made by the stream of this folder's conftest."""
    path = tmp_path / "old.sqlite"
    shutil.copy(FROZEN / f"session_{version}.sqlite", path)
    for _ in range(2):
        with SessionFile(path) as session:
            info = session.info
            assert (info.name, info.frames, info.can_frames, info.is_closed) == ("frozen", 90, 1, True)
            assert (info.duration_s, info.metadata, info.voltwall) == (90.0, {"driver": "Anna"}, "0.1.0")
            series = session.series(["v[36]", "i_fs", "estimate.soc[0]"])
            assert series["v[36]"].time_s == pytest.approx([WALL_S + i for i in range(90)])
            assert series["v[36]"].minimum == pytest.approx([3.636 + (i * 7 + 36) % 50 * 1e-4 for i in range(90)])
            assert series["i_fs"].maximum[:11] == pytest.approx([50 + i / 100 for i in range(10)] + [-50])
            assert series["estimate.soc[0]"].minimum == pytest.approx(
                [0.9 - (i + 1) * 1e-4 for i in range(90)], abs=2e-5
            )
            assert [marker.text for marker in session.markers()] == ["first lap"]
            assert [(event["code"], event["cell"]) for event in session.events()] == [("v_min", 36)]
            assert [config.image for config in session.configs()] == [bytes(range(210)) * 2]
            assert all(isinstance(decode_chunk(frame.raw), Frame) for frame in session.frames())
            assert session.problems() == []


def test_reading_a_session_of_the_last_version_changes_nothing_in_it(tmp_path: Path) -> None:
    path = tmp_path / "old.sqlite"
    shutil.copy(FROZEN / "session_2.sqlite", path)
    with SessionFile(path) as session:
        assert session.events()
    assert path.read_bytes() == (FROZEN / "session_2.sqlite").read_bytes()
    assert [each.name for each in tmp_path.iterdir()] == ["old.sqlite"]
