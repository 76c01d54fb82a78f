import shutil
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from app.cli import main
from app.season.lake import build
from app.season.lake.build import build_lake, session_files
from app.season.lake.place import LakeFolder
from app.season.lake.schema import LAKE_VERSION, TABLES
from app.sessions.reading.reader import SessionFile
from tests.recorded.season import TIME_S


@pytest.fixture
def copies(season, lake, tmp_path) -> tuple[Path, Path]:
    """Copies of the two sessions, and of their lake, which is up to date."""
    shutil.copytree(season, tmp_path / "sessions", dirs_exist_ok=True)
    shutil.copytree(lake, tmp_path / "lake")
    return tmp_path / "sessions", tmp_path / "lake"


def folders(lake: Path) -> list[str]:
    return sorted(str(path.parent.relative_to(lake)) for path in lake.rglob("sessions.parquet"))


def test_a_session_has_a_folder_by_car_season_and_id(lake, season):
    first, second = (path.stem for path in sorted(season.glob("*.sqlite")))
    assert folders(lake) == [
        f"car=built-in-master-96-cells/season=2026/session={first}",
        f"car=e-26-simulated/season=autumn/session={second}",
    ]


@pytest.mark.parametrize("table", TABLES)
def test_columns_carry_type_unit_and_meaning(lake, table):
    path = next(lake.rglob(f"{table}.parquet"))
    schema = pq.read_schema(path)
    assert schema.names == [column.name for column in TABLES[table]]
    for column in TABLES[table]:
        metadata = schema.field(column.name).metadata
        assert metadata[b"unit"].decode() == column.unit
        assert metadata[b"meaning"].decode() == column.meaning
    assert pq.read_metadata(path).metadata[b"voltwall_lake"] == str(LAKE_VERSION).encode()


def test_samples_hold_every_signal_in_its_unit_and_in_order(lake, season):
    path = next(lake.rglob("car=built-in*/**/samples.parquet"))
    table = pq.read_table(path, partitioning=None)
    times = table["time"].to_pylist()
    assert len(times) == len(TIME_S)
    assert times == sorted(times)
    assert table.schema.field("v[36]").metadata[b"unit"] == b"V"
    with SessionFile(season / f"{table['session'][0]}.sqlite") as session:
        series = session.series(["v[36]"], points=1000)["v[36]"]
    assert table["v[36]"].to_pylist() == pytest.approx(series.minimum.tolist(), rel=1e-6)
    assert {"estimate.soc[95]", "i_fs", "v_min", "age"} <= set(table.column_names)


def test_what_is_up_to_date_is_left_and_what_has_changed_is_made_again(copies):
    sessions, lake = copies
    paths = session_files([sessions])
    assert build_lake(LakeFolder(lake), paths).current == [path.stem for path in paths]
    paths[0].touch()
    assert build_lake(LakeFolder(lake), paths).made == [paths[0].stem]
    assert len(build_lake(LakeFolder(lake), paths, again=True).made) == 2


def test_a_newer_program_makes_again_what_is_older(copies, monkeypatch):
    sessions, lake = copies
    paths = session_files([sessions])
    monkeypatch.setattr(build, "LAKE_VERSION", LAKE_VERSION + 1)
    assert len(build_lake(LakeFolder(lake), paths).made) == 2


def test_a_damaged_session_is_named_and_left_out(copies, capsys):
    sessions, lake = copies
    broken = sessions / "broken.sqlite"
    broken.write_bytes(b"no session")
    assert main(["season", "build", str(sessions), "--lake", str(lake)]) == 1
    said = capsys.readouterr()
    assert "broken is left out" in said.err
    assert "2 up to date" in said.out
    assert len(folders(lake)) == 2


def test_a_session_that_takes_too_much_memory_is_left_out_alone(copies, monkeypatch):
    sessions, lake = copies
    first, second = session_files([sessions])

    def facts_of(session, **named):
        if session.path == first:
            raise MemoryError
        return whole(session, **named)

    whole = build.facts_of
    monkeypatch.setattr(build, "facts_of", facts_of)
    built = build_lake(LakeFolder(lake), [first, second], again=True)
    assert (built.made, built.failed) == ([second.stem], [(first.stem, "MemoryError")])


def test_an_unclosed_session_waits(make_session, tmp_path):
    path = make_session([0.0, 0.1], [0.0, 0.0], closed=False)
    built = build_lake(LakeFolder(tmp_path / "lake"), [path])
    assert built.not_closed == [path.stem]
    assert folders(tmp_path / "lake") == []


def test_a_disk_that_fails_in_the_middle_leaves_the_old_files(copies, monkeypatch):
    sessions, lake = copies
    paths = session_files([sessions])
    before = {path: path.read_bytes() for path in lake.rglob("*") if path.is_file()}

    def fail(path: Path, *_: object) -> None:
        path.write_bytes(b"half of")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(build, "write_samples", fail)
    with pytest.raises(OSError, match="No space"):
        build_lake(LakeFolder(lake), paths, again=True)
    assert {path: path.read_bytes() for path in lake.rglob("*") if path.is_file()} == before


KILLED = """
import os, sys
from pathlib import Path
from app.season.lake import build, place
count = 0
def replace(self, target, original=Path.replace):
    global count
    count += 1
    if count == int(sys.argv[3]):
        os._exit(9)
    return original(self, target)
Path.replace = replace
build.build_lake(place.LakeFolder(sys.argv[2]), build.session_files([Path(sys.argv[1])]))
"""


def test_after_a_kill_every_file_is_whole_and_the_next_build_mends_the_session(copies):
    sessions, lake = copies
    paths = session_files([sessions])
    paths[0].touch()
    arguments = [str(sessions), str(lake), "3"]  # three of five files
    killed = subprocess.run([sys.executable, "-c", KILLED, *arguments], check=False, cwd=Path.cwd())
    assert killed.returncode == 9
    assert [pq.read_table(path, partitioning=None).num_rows > 0 for path in lake.rglob("*.parquet")] == [True] * 10
    assert paths[0].stem in build_lake(LakeFolder(lake), paths).made
    assert [path.name for path in lake.rglob(".*") if path.is_file()] == [".lock"]


def test_a_lake_lies_wherever_fsspec_reaches(season):
    place = LakeFolder("memory://season/lake")
    build_lake(place, session_files([season]))
    assert len(place.find("car=*/season=*/session=*/*.parquet")) == 10
    assert len(build_lake(place, session_files([season])).current) == 2
