import csv
import json
from dataclasses import replace

import numpy as np
import pytest

from app.cli import main
from app.commands.cell_table import write_table
from app.estimation.cell_model.cell_file import format_cell, load_cell
from app.estimation.cell_model.circuit import CellLimits
from app.estimation.errors import DatasetError
from app.sources.recordings.dataset import load_recording
from tests.open_loop import simulate

CELL = "samsung-25r-10p"


def run(*words):
    return main(["estimate", *map(str, words)])


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    rng = np.random.default_rng(5)
    time_s = np.arange(3000) * 0.5
    current_a = np.repeat(rng.choice([0.0, 20.0, 60.0, 120.0, -20.0], size=300), 10)
    current_a[:20] = 0.0
    temperature = np.full(time_s.size, 25.0)
    soc, voltage_v = simulate(load_cell(CELL), time_s, current_a, temperature, 0.9)
    path = tmp_path_factory.mktemp("drive") / "drive.csv.gz"
    write_table(path, {"time_s": time_s, "current_a": current_a, "voltage_v": voltage_v, "soc": soc})
    return path


def test_json_has_the_published_keys_and_a_good_score(drive, capsys):
    assert run(drive, "--cell", CELL, "--initial-soc", "0.9", "--json") == 0
    report = json.loads(capsys.readouterr().out)
    assert {"soc_rmse", "soc_max_error_after_60s", "settle_5_s", "settle_2_s", "inside_3_sigma"} <= set(report)
    assert report["soc_rmse"] < 0.005
    assert report["settle_5_s"] == 0.0


def test_wrong_start_is_corrected_by_the_filter_and_never_by_the_counter(drive, capsys):
    assert run(drive, "--cell", CELL, "--initial-soc", "40%", "--json") == 0
    assert json.loads(capsys.readouterr().out)["settle_5_s"] < 60.0
    assert run(drive, "--cell", CELL, "--initial-soc", "40%", "--filter", "coulomb", "--json") == 0
    report = json.loads(capsys.readouterr().out)
    assert report["settle_5_s"] is None
    assert report["soc_rmse"] > 0.4


@pytest.mark.parametrize("name", ["out.csv", "out.csv.gz", "out.parquet"])
def test_estimates_are_written_in_the_form_the_name_says(drive, tmp_path, name):
    if name.endswith("parquet"):
        pytest.importorskip("pyarrow")
    assert run(drive, "--cell", CELL, "--initial-soc", "0.9", "--out", tmp_path / name) == 0
    written = load_recording(tmp_path / name)
    assert len(written.time_s) == 3000
    assert abs(written.soc[-1] - load_recording(drive).soc[-1]) < 0.02


def test_plot_is_a_picture(drive, tmp_path):
    pytest.importorskip("matplotlib")
    assert run(drive, "--cell", CELL, "--initial-soc", "0.9", "--plot", tmp_path / "a.png") == 0
    assert (tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"


def test_file_without_soc_is_estimated_and_not_scored(drive, tmp_path, capsys):
    recording = load_recording(drive)
    path = tmp_path / "plain.csv"
    write_table(path, {name: getattr(recording, name) for name in ("time_s", "current_a", "voltage_v")})
    assert run(path, "--cell", CELL, "--json") == 0
    report = json.loads(capsys.readouterr().out)
    assert report["soc_rmse"] is None
    assert report["soc_last"] == pytest.approx(recording.soc[-1], abs=0.03)


@pytest.mark.parametrize(
    ("words", "problem"),
    [(["none.csv", "--cell", CELL], "none.csv"), (["{drive}", "--cell", "no-such-cell"], "no-such")],
)
def test_what_cannot_be_used_is_named(drive, capsys, words, problem):
    assert run(*[word.format(drive=drive) for word in words]) == 2
    assert problem in capsys.readouterr().err


@pytest.mark.parametrize("text", ["95", "-0.1", "full"])
def test_initial_soc_that_is_no_fraction_is_refused(text):
    with pytest.raises(SystemExit):
        run("drive.csv", "--cell", CELL, f"--initial-soc={text}")


def test_unknown_ending_is_refused(tmp_path):
    with pytest.raises(DatasetError, match="parquet"):
        write_table(tmp_path / "a.xlsx", {"soc": np.zeros(2)})


@pytest.mark.parametrize(
    ("gap_s", "after_a", "hidden"),
    [(1000.0, 2.5, "+0.694 Ah"), (1000.0, 1.0, "+0.278 Ah"), (1000.0, -2.5, "+0 Ah"), (86400.0, 2.5, "+0 Ah")],
)
def test_charge_that_a_gap_hides_is_named_and_never_made_up(tmp_path, capsys, gap_s, after_a, hidden):
    time_s = np.concatenate((np.arange(100.0), 99.0 + gap_s + np.arange(100.0)))
    path, out = tmp_path / "gap.csv", tmp_path / "out.csv"
    write_table(path, {"time_s": time_s, "current_a": np.repeat([2.5, after_a], 100), "voltage_v": np.full(200, 3.7)})
    assert run(path, "--cell", CELL, "--json", "--filter", "coulomb", "--initial-soc", "0.6", "--out", out) == 0
    report = json.loads(capsys.readouterr().out)
    told = [note for note in report["notes"] if "not measured" in note]
    assert hidden in told[0]
    soc = load_recording(out).soc
    moved_ah = (soc[99] - soc[100]) * load_cell(CELL).capacity_ah
    expected_ah = float(hidden.split()[0])
    assert moved_ah == pytest.approx(expected_ah + after_a / 3600.0, abs=2e-3)


def test_whiteness_and_the_offset_of_the_sensor_are_in_the_report(drive, capsys):
    assert run(drive, "--cell", CELL, "--initial-soc", "0.9", "--json") == 0
    report = json.loads(capsys.readouterr().out)
    assert 0.0 <= report["innovation_white_share"] <= 1.0
    assert report["nis"] > 0.0
    assert report["innovation_correlation_s"] > 0.0
    assert report["current_offset_observed"] is False
    assert report["current_offset_sigma_a"] > 0.1
    assert run(drive, "--cell", CELL, "--filter", "coulomb", "--initial-soc", "0.9", "--json") == 0
    assert json.loads(capsys.readouterr().out)["current_offset_a"] is None


def test_a_first_row_without_voltage_does_not_hide_the_next(drive, tmp_path, capsys):
    recording = load_recording(drive)
    voltage = recording.voltage_v.copy()
    voltage[:3] = np.nan
    path = tmp_path / "late.csv"
    write_table(path, {"time_s": recording.time_s, "current_a": recording.current_a, "voltage_v": voltage})
    assert run(path, "--cell", CELL, "--json") == 0
    assert abs(json.loads(capsys.readouterr().out)["soc_first"] - 0.9) < 0.02


def test_what_lies_outside_the_cell_file_is_said(drive, tmp_path, capsys):
    cell = tmp_path / "weak.toml"
    text = format_cell(replace(load_cell(CELL), fit_current_max_a=50.0))
    cell.write_text(text)
    assert run(drive, "--cell", cell, "--json") == 0
    notes = json.loads(capsys.readouterr().out)["notes"]
    assert "no temperature: 25 degC taken" in notes
    assert "warning: up to 120 A, the cell file is fitted to 50 A at most" in notes
    recording = load_recording(drive)
    path = tmp_path / "cold.csv"
    columns = {name: getattr(recording, name) for name in ("time_s", "current_a", "voltage_v")}
    write_table(path, columns | {"temperature_c": np.full(len(recording.time_s), -39.0)})
    assert run(path, "--cell", CELL, "--json") == 0
    assert any("-39 to -39 degC" in note for note in json.loads(capsys.readouterr().out)["notes"])


@pytest.mark.parametrize(
    ("option", "name", "problem"),
    [
        ("--out", "out.txt", ".parquet"),
        ("--out", "none/out.csv", "folder"),
        ("--plot", "a.doc", ".png"),
        ("--plot", "none/a.png", "folder"),
    ],
)
def test_a_result_that_could_not_be_written_is_refused_before_the_work(tmp_path, capsys, option, name, problem):
    if option == "--plot":
        pytest.importorskip("matplotlib")
    assert run(tmp_path / "absent.csv", "--cell", CELL, option, tmp_path / name) == 2
    said = capsys.readouterr().err
    assert problem in said
    assert "absent" not in said


def test_power_is_told_along_the_recording_with_its_band_and_condition(drive, tmp_path, capsys):
    out = tmp_path / "power.csv"
    assert run(drive, "--cell", CELL, "--power", "--json", "--out", out) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["power_coverage"] == 0.9
    assert [(each["direction"], each["horizon_s"]) for each in report["power"]] == [
        (direction, horizon) for direction in ("discharge", "charge") for horizon in (1.0, 10.0, 30.0)
    ]
    with out.open() as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        low, middle, high = (float(row[f"power_discharge_10s_{name}w"]) for name in ("low_", "", "high_"))
        assert 0 <= low <= middle <= high
        assert float(row["power_discharge_30s_w"]) <= float(row["power_discharge_1s_w"])
    assert float(rows[-1]["power_discharge_10s_w"]) == pytest.approx(report["power"][1]["last_w"], rel=1e-6)


def test_power_beyond_the_measured_currents_is_marked(drive, tmp_path, capsys):
    cell = tmp_path / "small.toml"
    cell.write_text(
        format_cell(replace(load_cell(CELL), fit_current_max_a=20.0, limits=CellLimits())), encoding="utf-8"
    )
    assert run(drive, "--cell", cell, "--power") == 0
    said = capsys.readouterr().out
    assert "extrapolated 100 % of the time" in said
    assert "beyond the currents (up to 20 A, less for longer)" in said
    assert "has no current limits" in said
    assert run(drive, "--cell", CELL) == 0
    assert "state of power" not in capsys.readouterr().out
