import json

import numpy as np
import pytest

from app.cli import main
from app.commands.cell_table import write_table
from app.estimation.cell_model.cell_file import load_cell
from tests.open_loop import simulate

CELL = load_cell("samsung-25r-10p")


def run(*words):
    return main(["identify", *map(str, words)])


def write(path, steps, soc_start, step_s):
    current = np.concatenate([np.full(round(s / step_s), c * CELL.capacity_ah) for c, s in steps])
    time_s = step_s * np.arange(current.size)
    soc, voltage = simulate(CELL, time_s, current, np.full(current.size, 25.0), soc_start)
    write_table(path, {"time_s": time_s, "current_a": current, "voltage_v": voltage, "soc": soc})
    return path


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cell")
    hours = 19.9
    slow_steps = [(0, 600), (0.05, 3600 * hours), (0, 3600), (-0.05, 3600 * hours)]
    slow = write(folder / "slow.csv.gz", slow_steps, 0.999, 60.0)
    step = [(4, 10), (0, 120), (1, 350), (0, 900)]
    return slow, write(folder / "pulses.csv", [(0, 30), *step * 8], 0.99, 1.0)


def test_cell_file_is_written_and_explains_the_data(files, tmp_path, capsys):
    out = tmp_path / "cell.toml"
    assert run("--ocv", files[0], "--pulses", files[1], "--rc", 2, "--out", out, "--json") == 0
    report = json.loads(capsys.readouterr().out)
    assert load_cell(out).capacity_ah == pytest.approx(CELL.capacity_ah, rel=0.01)
    assert report["parts"][0]["voltage_rms_v"] < 0.005
    assert any("--drive" in warning for warning in report["warnings"])


def test_report_for_people_names_resistances_and_files(files, tmp_path, capsys):
    assert run("--ocv", files[0], "--pulses", files[1], "--out", tmp_path / "cell.toml") == 0
    text = capsys.readouterr().out
    assert "ohmic resistance" in text
    assert "+-" in text
    assert "would help most" in text
    assert text.startswith("warning: "), "what to beware of comes first"
    assert "pulses.csv" in text


def test_plot_is_a_picture(files, tmp_path):
    pytest.importorskip("matplotlib")
    picture = tmp_path / "a.png"
    assert run("--ocv", files[0], "--pulses", files[1], "--out", tmp_path / "cell.toml", "--plot", picture) == 0
    assert picture.read_bytes()[:4] == b"\x89PNG"


def test_absent_file_is_named_and_nothing_is_written(files, tmp_path, capsys):
    out = tmp_path / "cell.toml"
    assert run("--ocv", "none.csv", "--pulses", files[1], "--out", out) == 2
    assert "none.csv" in capsys.readouterr().err
    assert not out.exists()
