"""`voltwall season report` on the command line: sessions of one day say where a cell is, and no month."""

import json

import numpy as np

from app.cli import main
from app.estimation.cell_model.cell_file import format_cell, load_cell
from app.season.lake.build import build_lake, session_files
from app.season.lake.place import LakeFolder
from tests.recorded.arrays import START_S, SessionMaker

CELL = load_cell("samsung-25r-10p")
TIME_S = np.arange(0.0, 60.0, 0.25)
CURRENT_A = np.where((TIME_S > 11) & (TIME_S < 55), 60 + 50 * np.sin(TIME_S), 0.0)
WEAK_OHM = np.where(np.arange(96) == 30, 0.003, 0.002)
NO_MONTH = "too few days to tell what a month changes"


def test_sessions_of_one_day_tell_no_month_on_the_command_line_and_in_print(tmp_path, capsys):
    make = SessionMaker(tmp_path / "sessions")
    for hour in range(5):
        volts = CELL.ocv.voltage(0.8) - CURRENT_A[:, None] * WEAK_OHM * (1 + 0.02 * hour)
        make(TIME_S, CURRENT_A, volts, 25, start_s=START_S + 3600 * hour, cell_file=format_cell(CELL))
    build_lake(LakeFolder(tmp_path / "lake"), session_files([tmp_path / "sessions"]))
    asked = ["season", "report", "--data", str(tmp_path)]
    assert main(asked) == 0
    said = capsys.readouterr().out
    resistance = next(line for line in said.splitlines() if line.startswith("  resistance "))
    assert NO_MONTH in resistance
    assert resistance.endswith("5 sessions")
    assert main([*asked, "--json"]) == 0
    (car,) = json.loads(capsys.readouterr().out)["cars"]
    assert car["overview"]["groups"][0]["resistance"]["is_reportable"] is False
