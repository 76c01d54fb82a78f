"""Sessions of other teams' batteries by command: logs of a foxBMS of 216 cells and of an Orion of 72."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from app.analysis.black_box.from_session import black_boxes
from app.cli import main
from app.sessions.reading.reader import SessionFile
from tests.peer_batteries import cell_number
from tests.recorded.peer_sessions import write_log, write_profile

FOXBMS_S = 10


def imported(data: Path, *arguments: str) -> str:
    """Import and return the session's id."""
    before = set((data / "sessions").glob("*.sqlite"))
    assert main(["sessions", "import", *arguments, "--data", str(data), "--filter", "coulomb"]) == 0
    (new,) = set((data / "sessions").glob("*.sqlite")) - before
    return new.stem


@pytest.fixture(scope="module")
def foxbms(tmp_path_factory) -> tuple[Path, str]:
    """What a simulated foxBMS of 216 cells says while it drives, as a session: data folder and id."""
    folder = tmp_path_factory.mktemp("foxbms")
    log = folder / "foxbms.log"
    arguments = ["--battery", "foxbms-2", "--scenario", "clean-endurance", "--can", f"log:{log}", "--speed", "max"]
    assert main(["simulate", *arguments, "--duration", str(FOXBMS_S), "--seed", "1"]) == 0
    return folder, imported(
        folder, str(log), "--battery", "foxbms-2", "--name", "their run", "--start", "2026-07-14T10:00"
    )


def test_a_foxbms_log_of_216_cells_is_reported_exported_and_in_its_season(foxbms, capsys, tmp_path) -> None:
    capsys.readouterr()
    data, session_id = foxbms
    at = ["--data", str(data)]
    with SessionFile(data / "sessions" / f"{session_id}.sqlite") as session:
        assert session.battery.segments == (18,) * 12
        assert session.info.duration_s == pytest.approx(FOXBMS_S, abs=2)
        assert session.info.name == "their run"

    assert main(["sessions", "report", session_id, "--json", *at]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["segments"] == [18] * 12
    assert len(report["voltage_min_v"]) == len(report["resistance_ohm"]) == 216
    assert all(3.0 < volts < 4.3 for volts in report["voltage_min_v"])
    assert report["figures"]["energy_out_wh"] > FOXBMS_S

    out = tmp_path / "run.csv"
    assert main(["export", session_id, "--out", str(out), *at]) == 0
    with out.open() as file:
        rows = list(csv.DictReader(file))
    assert {"v[215] (V)", "t[215] (degC)", "sensor[179] (degC)", "i_fs (A)", "estimate.soc[215]"} <= rows[0].keys()
    assert len(rows) == pytest.approx(10 * FOXBMS_S, rel=0.06)  # one a period of the profile
    whole = rows[len(rows) // 2]
    assert all(3.0 < float(whole[f"v[{cell}] (V)"]) < 4.3 for cell in range(216))

    capsys.readouterr()
    assert main(["season", "report", "--battery", "foxbms-2", "--json", *at]) == 0
    season = json.loads(capsys.readouterr().out)
    assert [each["id"] for each in season["sessions"]] == [session_id]
    assert len(season["cars"][0]["overview"]["cells"]) == 216
    assert main(["season", "report", "--json", *at]) == 0  # the team's own battery
    assert json.loads(capsys.readouterr().out)["sessions"] == []


@pytest.mark.parametrize("ending", ["parquet", "mcap", "mf4", "ld", "log", "asc", "blf"])
def test_it_is_exported_in_every_format(foxbms, ending, tmp_path) -> None:
    data, session_id = foxbms
    out = tmp_path / f"run.{ending}"
    arguments = ["--from", "+4", "--to", "+6", "--data", str(data)]
    assert main(["export", session_id, "--out", str(out), *arguments]) == 0
    assert out.stat().st_size > 1000


def test_it_replays_by_its_own_battery(foxbms, capsysbinary) -> None:
    data, session_id = foxbms
    assert main(["replay", session_id, "--json", "--filter", "coulomb", "--data", str(data)]) == 0
    lines = capsysbinary.readouterr().out.splitlines()
    assert len(lines) > 5 * FOXBMS_S
    last = json.loads(lines[-1])
    assert len(last["cells"]["voltage_v"]) == 216
    assert all(3.0 < volts < 4.3 for volts in last["cells"]["voltage_v"])


def test_expectations_name_cells_of_its_segments(foxbms, capsys, tmp_path) -> None:
    data, session_id = foxbms
    expected = tmp_path / "expected.toml"
    expected.write_text('[[value]]\nname = "voltage_v[12/18]"\nmin = 3.0\nmax = 4.3\nfrom_s = 5\n')
    arguments = [session_id, "--assert", str(expected), "--filter", "coulomb", "--data", str(data)]
    assert main(["replay", *arguments]) == 0
    expected.write_text('[[value]]\nname = "voltage_v[12/19]"\nmin = 3.0\n')
    assert main(["replay", *arguments]) == 2
    assert "1/1 to 12/18" in capsys.readouterr().err


def test_an_orion_log_of_72_cells_is_compared_with_another(tmp_path, capsys) -> None:
    peer = cell_number()
    profile = write_profile(peer, tmp_path, sensors='cells = "spread"')
    profile.write_text(profile.read_text().replace("segments = [72]", "segments = [12, 12, 12, 12, 12, 12]"))
    data = tmp_path / "data"
    ids = []
    for k in range(2):
        log = write_log(peer, tmp_path / f"orion{k}.log", 12.0, start_s=1_780_000_000 + 3600 * k)
        ids.append(imported(data, str(log), "--battery", str(profile)))
    with SessionFile(data / "sessions" / f"{ids[0]}.sqlite") as session:
        assert session.battery.segments == (12,) * 6
        block = list(session.fields(["v", "t", "i_fs"]))[-1]
        assert np.isfinite(block["v"].values[-1]).all()
        assert block["t"].values.shape[1] == 72
        assert all(box.segments == [12] * 6 for box in black_boxes(session))
    at = ["--data", str(data)]
    capsys.readouterr()
    assert main(["sessions", "compare", ids[0], "--with", ids[1], "--json", *at]) == 0
    compared = json.loads(capsys.readouterr().out)
    known = {name: value for name, value in compared["a"].items() if value is not None}
    assert len(known) > 5
    assert known == pytest.approx({name: compared["b"][name] for name in known}, rel=0.05)
    assert main(["sessions", "report", ids[0], *at]) == 0
    assert main(["season", "swap", "6/12", "--battery", str(profile), *at]) == 0
    assert "swap 1: 6/12 of " in capsys.readouterr().out
    assert main(["season", "swap", "7/1", "--battery", str(profile), *at]) == 2
    assert "1/1 to 6/12" in capsys.readouterr().err


def test_sessions_of_unlike_batteries_are_compared_without_their_cells(foxbms, tmp_path, capsys) -> None:
    data, session_id = foxbms
    peer = cell_number()
    log = write_log(peer, tmp_path / "orion.log", 10.0)
    other = imported(data, str(log), "--battery", str(write_profile(peer, tmp_path)))
    assert main(["sessions", "compare", session_id, "--with", other, "--data", str(data)]) == 0
    assert "Different batteries: foxBMS 2, 216 cells and 3: cell number." in capsys.readouterr().out


def test_mean_currents_of_a_table_are_set_by_a_flag_or_a_saved_profile(tmp_path, capsys) -> None:
    table = tmp_path / "theirs.csv"
    table.write_text("t,I,U1,U2\n" + "\n".join(f"{k},12,3.7,3.71" for k in range(50)))
    noted = "means over each row"
    imported(tmp_path, str(table))
    assert noted not in capsys.readouterr().err
    imported(tmp_path, str(table), "--current-means", "yes", "--save-profile", "means")
    assert noted in capsys.readouterr().err
    imported(tmp_path, str(table), "--profile", "means")
    assert noted in capsys.readouterr().err
    imported(tmp_path, str(table), "--profile", "means", "--current-means", "no")
    assert noted not in capsys.readouterr().err
    assert main(["sessions", "import", str(table), "--set", "current_means=maybe", "--data", str(tmp_path)]) != 0
    assert "current_means = 'maybe': use one of" in capsys.readouterr().err
