"""`voltwall sessions` and `voltwall export` on a folder with a session that was cut off and one that was closed."""

import csv
import json
import re
import shutil
from pathlib import Path

import pytest

from app.cli import main
from app.sessions.recording.recorder import Recorder
from firmware_protocol.framing import encode_frame
from firmware_protocol.messages import Data, Window
from tests.fake_clock import FunctionClock

WALL_NS = 1_790_000_000 * 10**9


@pytest.fixture
def data(tmp_path: Path) -> Path:
    data = tmp_path / "data"
    recorder = Recorder(data / "sessions", FunctionClock(lambda: 0, lambda: WALL_NS), version="1.0")
    for name in ("cut", "closed"):
        info = recorder.start(name, {"driver": name})
        for i in range(50):
            t_ns = i * 100_000_000
            body = Data((Window(1896, (37000 + i).to_bytes(2, "little") * 96),)).to_body()
            recorder.frame(t_ns, WALL_NS + t_ns, 0, encode_frame(1, i, i * 100, body)[1:-1], True)
        recorder.marker(2_500_000_000, WALL_NS, "driver change", who="anna")
        recorder.flush()
        if name == "cut":
            copy = tmp_path / "copy.sqlite"
            shutil.copy(info.path, copy)
            shutil.copy(f"{info.path}-wal", f"{copy}-wal")
            recorder.stop()
            recorder.flush()
            info.path.unlink()
            copy.rename(info.path)
            Path(f"{copy}-wal").rename(f"{info.path}-wal")
    recorder.close()
    return data


CUT, CLOSED = "20260921T141320Z", "20260921T141320Z-2"


def test_list_says_what_was_closed_and_what_was_cut_off(data: Path, capsys) -> None:
    assert main(["sessions", "list", "--data", str(data), "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)
    assert [(each["id"], each["state"], each["frames"]) for each in listed] == [
        (CLOSED, "closed", 50),
        (CUT, "cut off", 50),
    ]
    assert main(["sessions", "--data", str(data)]) == 0
    assert re.search(r"cut off +cut", capsys.readouterr().out)


def test_show_and_markers_of_one_session(data: Path, capsys) -> None:
    assert main(["sessions", "show", CUT, "--data", str(data)]) == 0
    shown = capsys.readouterr().out
    assert "state: cut off" in shown
    assert "metadata: {'driver': 'cut'}" in shown
    assert main(["sessions", "markers", str(data / "sessions" / f"{CLOSED}.sqlite")]) == 0
    assert "2.5 s  2026-09-21 14:13:20Z  note: driver change (anna)" in capsys.readouterr().out


def test_check_finds_a_damaged_file(data: Path, capsys) -> None:
    assert main(["sessions", "check", "--data", str(data)]) == 0
    assert capsys.readouterr().out.count("sound") == 2
    path = data / "sessions" / f"{CLOSED}.sqlite"
    content = bytearray(path.read_bytes())
    content[8192:12288] = b"\xaa" * 4096
    path.write_bytes(content)
    assert main(["sessions", "check", "--data", str(data)]) == 1
    assert "sound" in capsys.readouterr().out


def test_delete_wants_to_be_meant(data: Path, capsys) -> None:
    assert main(["sessions", "delete", CUT, "--data", str(data)]) == 2
    assert "--yes" in capsys.readouterr().err
    assert main(["sessions", "delete", CUT, "--data", str(data), "--yes"]) == 0
    assert main(["sessions", "show", CUT, "--data", str(data)]) == 2
    assert [path.stem for path in (data / "sessions").glob("*.sqlite*")] == [CLOSED]


def test_prune_deletes_only_when_it_is_meant(data: Path, capsys) -> None:
    assert main(["sessions", "prune", "--data", str(data)]) == 2
    assert main(["sessions", "prune", "--keep-gb", "0", "--data", str(data)]) == 0
    assert capsys.readouterr().out.count("kept without --yes") == 2
    as_json = ["sessions", "prune", "--keep-gb", "0", "--data", str(data), "--json"]
    for more, is_deleted in (([], False), (["--yes"], True)):
        assert main([*as_json, *more]) == 0
        found = json.loads(capsys.readouterr().out)
        assert {(each["id"], each["deleted"]) for each in found} == {(CUT, is_deleted), (CLOSED, is_deleted)}
        assert all(each["bytes"] > 0 for each in found)
    assert list((data / "sessions").glob("*.sqlite*")) == []


def test_columns_are_told_as_json(tmp_path: Path, capsys) -> None:
    path = tmp_path / "run.csv"
    path.write_text("Time (s),Pack Current (A),Cell 1 (V),spare\n0,1.5,3.7,\n1,2.5,3.6,\n", encoding="utf-8")
    assert main(["sessions", "columns", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["columns"][1] == {"name": "Pack Current (A)", "lowest": 1.5, "highest": 2.5}
    assert told["columns"][3] == {"name": "spare", "lowest": None, "highest": None}
    assert (told["profile"]["time"], told["profile"]["current"]) == ("Time (s)", "Pack Current (A)")


def test_export_writes_the_range_asked_for(data: Path, tmp_path: Path, capsys) -> None:
    out = tmp_path / "out.csv"
    command = ["export", CLOSED, "--data", str(data), "--out", str(out), "--signal", "v[95]"]
    for t_from, t_to, more in (("+1", "+2", []), ("2026-09-21T14:13:21Z", "2026-09-21T14:13:22", ["--force"])):
        assert main([*command, "--from", t_from, "--to", t_to, *more]) == 0
        with out.open(newline="") as file:
            rows = list(csv.DictReader(file))
        assert [row["v[95] (V)"] for row in rows] == [f"3.70{i}" for i in range(10, 21)]


def test_export_for_motec_says_where_there_is_no_lap(data: Path, tmp_path: Path, capsys) -> None:
    assert main(["export", CLOSED, "--data", str(data), "--out", str(tmp_path / "out.ld"), "--signal", "v[95]"]) == 0
    assert "out.ldx: not written: no saved, marked or detected lap" in capsys.readouterr().out
    assert not (tmp_path / "out.ldx").exists()


def test_export_to_standard_output_is_the_file_and_nothing_else(data: Path, tmp_path: Path, capfdbinary) -> None:
    command = ["export", CLOSED, "--data", str(data), "--signal", "v[95]", "--format", "csv"]
    assert main([*command, "--out", str(tmp_path / "out.csv")]) == 0
    capfdbinary.readouterr()
    assert main([*command, "--out", "-"]) == 0
    assert capfdbinary.readouterr().out == (tmp_path / "out.csv").read_bytes()


def test_export_overwrites_only_when_it_is_meant_and_only_by_a_whole_file(data: Path, tmp_path: Path, capsys) -> None:
    out = tmp_path / "out.csv"
    out.write_text("of yesterday")
    command = ["export", CLOSED, "--data", str(data), "--out", str(out)]
    assert main(command) == 2
    assert "--force" in capsys.readouterr().err
    assert main([*command, "--force", "--format", "candump", "--from", "+9000"]) == 2
    assert [path.name for path in tmp_path.glob("*out*")] == ["out.csv"]
    assert out.read_text() == "of yesterday"
    assert main([*command, "--force"]) == 0
    assert out.read_text().startswith("time_s")


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (["--signal", "v[96]"], "beyond 95"),
        (["--from", "yesterday"], "ISO 8601"),
        (["--out", "x.xlsx"], "--format"),
        (["--out", "/nowhere/at/all.csv"], "No such file"),
    ],
)
def test_a_mistake_is_one_line(data: Path, tmp_path: Path, capsys, options: list[str], complaint: str) -> None:
    command = ["export", CLOSED, "--data", str(data), "--out", str(tmp_path / "x.csv"), *options]
    assert main(command) == 2
    error = capsys.readouterr().err
    assert complaint in error
    assert error.count("\n") == 1


def test_every_action_has_a_help_of_its_own(capsys) -> None:
    for action, said in (("laps", "--laps-from"), ("import", "--profile"), ("fetch", "URL")):
        with pytest.raises(SystemExit, match="0"):
            main(["sessions", action, "--help"])
        shown = capsys.readouterr().out
        assert said in shown
        assert "--older-than" not in shown
