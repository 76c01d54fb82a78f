"""Recordings with the faults that users of other tools reported, imported and exported by the commands they would type.

The inputs stand in tests/vectors/reports; each has the property of a public report and no line of its file.
"""

import csv
import itertools
from datetime import UTC, datetime
from pathlib import Path

import pytest

from app.cli import main

REPORTS = Path(__file__).parents[1] / "vectors" / "reports"
BATTERY = ["--battery", str(REPORTS / "mini.toml")]
LOG_STARTS = datetime(2026, 7, 14, 10, 30, 10, tzinfo=UTC).timestamp()


class Import:
    """What `voltwall sessions import` made, and what `voltwall export` writes of it."""

    def __init__(self, data: Path, capsys: pytest.CaptureFixture[str], name: str, *flags: str) -> None:
        self.code = main(["sessions", "import", str(REPORTS / name), "--data", str(data), *flags])
        self.out, self.notes = capsys.readouterr()
        self._data, self._capsys = data, capsys

    def rows(self) -> list[dict[str, float]]:
        [session] = (self._data / "sessions").glob("*.sqlite")
        out = self._data / "out.csv"
        assert main(["export", str(session), "--out", str(out), "--data", str(self._data)]) == 0
        self._capsys.readouterr()
        with out.open(newline="") as file:
            return [
                {name: float(value) if value else float("nan") for name, value in row.items() if name != "time"}
                for row in csv.DictReader(file)
            ]


@pytest.fixture
def imported(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("TZ", "UTC")
    return lambda name, *flags: Import(tmp_path / "data", capsys, name, *flags)


def steps_s(rows):
    return [round(b["elapsed_s"] - a["elapsed_s"], 3) for a, b in itertools.pairwise(rows)]


def test_every_row_of_an_irregular_table_is_kept_with_its_pulse(imported):
    rows = imported("short-pulse.csv").rows()
    with (REPORTS / "short-pulse.csv").open(newline="") as file:
        theirs = list(csv.DictReader(file))
    assert [row["i_fs (A)"] for row in rows] == [abs(float(row["Current (A)"])) for row in theirs]
    assert [row["v[0] (V)"] for row in rows] == [float(row["Voltage (V)"]) for row in theirs]
    times_s = [float(row["Test Time (s)"]) for row in theirs]
    assert [row["elapsed_s"] for row in rows] == [at_s - times_s[0] for at_s in times_s]


@pytest.mark.parametrize(
    ("name", "begins"),
    [
        ("header-date.csv", datetime(2025, 3, 14, 8, 30, tzinfo=UTC)),  # by `Started:` above the table
        ("short-pulse.csv", datetime(2025, 3, 14, 8, 30, 30, tzinfo=UTC)),  # by a column of dates
        ("trailing.csv", datetime(2026, 7, 14, 10, 0, tzinfo=UTC)),  # by a column of days and one of times of day
        ("leafspy-sign.csv", datetime(2026, 7, 14, 10, 30, tzinfo=UTC)),
    ],
)
def test_a_session_begins_when_the_file_says(imported, name, begins):
    assert imported(name).rows()[0]["time_s"] == begins.timestamp()


def test_a_session_without_a_date_is_named_and_stays_out_of_the_season(imported, tmp_path, capsys):
    found = imported("restart.csv")
    assert "the file has no date" in found.notes
    lake = ["--lake", str(tmp_path / "lake")]
    assert main(["season", "build", str(tmp_path / "data"), *lake]) == 1
    assert "imported without a date: import it again with --start TIME" in "".join(capsys.readouterr())


def test_a_session_with_a_date_that_was_given_is_of_the_season(imported, tmp_path, capsys):
    found = imported("restart.csv", "--start", "2026-07-14T10:00")
    assert "no date" not in found.notes
    assert main(["season", "build", str(tmp_path / "data"), "--lake", str(tmp_path / "lake")]) == 0


def test_a_table_that_begins_in_1970_is_dated_by_the_clock_that_was_set(imported):
    found = imported("rtc-1970.csv")
    rows = found.rows()
    assert len(rows) == 200
    assert set(steps_s(rows)) == {1.0}
    assert rows[-1]["time_s"] == 1784025000.0 + 199
    assert "row 61: the clock is set while logging" in found.notes


def test_a_clock_that_starts_again_gives_two_parts_in_their_order(imported):
    found = imported("restart.csv")
    rows = found.rows()
    assert len(rows) == 300
    assert set(steps_s(rows)) == {1.0}
    assert "row 152: the clock goes back by 149 s" in found.notes


def test_a_time_of_day_passes_midnight(imported):
    rows = imported("clock-midnight.csv").rows()
    assert (len(rows), rows[-1]["elapsed_s"]) == (200, 199.0)
    assert rows[-1]["i_fs (A)"] == 18.871


def test_a_time_without_a_unit_is_asked_for_and_the_answer_is_taken(imported):
    found = imported("time-ms.csv")
    assert found.code != 0
    assert "Time has no unit: choose it with `--set time_unit=s`, or ms" in found.notes
    assert imported("time-ms.csv", "--set", "time_unit=ms").rows()[-1]["elapsed_s"] == 538.0


def test_sparse_rows_hold_their_values_until_the_next_and_stay_apart_in_the_file(imported):
    rows = imported("sparse.csv", "--set", "time_unit=ms").rows()
    assert len(rows) == 600
    assert rows[1]["v[0] (V)"] == 3.95
    assert rows[3]["v[0] (V)"] != rows[3]["v[0] (V)"], "only what a row holds is a sample of it"


def test_an_overflow_is_no_current(imported):
    found = imported("int32.csv")
    rows = found.rows()
    assert len(rows) == 200
    assert all(abs(row["i_fs (A)"]) < 100 for row in rows if row["i_fs (A)"] == row["i_fs (A)"])
    assert "2 currents are an integer's overflow" in found.notes


def test_a_sign_that_marks_a_shunt_is_no_voltage(imported):
    rows = imported("leafspy-sign.csv").rows()
    with (REPORTS / "leafspy-sign.csv").open(newline="") as file:
        pack_v = [float(row["Pack Volts"]) for row in csv.DictReader(file)]
    cells = [sum(row[f"v[{k}] (V)"] for k in range(4)) for row in rows]
    assert cells == pytest.approx(pack_v, abs=0.006)


def test_delimiters_behind_the_last_column_are_no_columns(imported):
    rows = imported("trailing.csv").rows()
    assert len(rows) == 120
    assert [rows[0][f"v[{k}] (V)"] for k in range(4)] == [3.95, 3.949, 3.947, 3.946]


def test_a_clock_put_back_names_the_line_and_the_parts_follow_each_other(imported):
    found = imported("stepback.log", *BATTERY)
    rows = found.rows()
    assert "line 201: the clock goes back by 9.902 s" in found.notes
    assert rows[0]["time_s"] == pytest.approx(LOG_STARTS, abs=0.2)
    assert rows[-1]["elapsed_s"] == pytest.approx(19.8, abs=0.3)


def test_a_log_that_begins_in_1970_is_dated_by_the_clock_that_was_set(imported):
    found = imported("rtc-1970.log", *BATTERY)
    assert "line 41: the clock is set while logging" in found.notes
    assert found.rows()[-1]["elapsed_s"] == pytest.approx(3.9, abs=0.3)


def test_stamps_that_are_differences_are_added_up(imported):
    found = imported("candump-td.txt", *BATTERY)
    assert "candump -td" in found.notes
    assert found.rows()[-1]["elapsed_s"] == pytest.approx(10.0, abs=0.3)


def test_a_byte_order_mark_is_no_part_of_a_log(imported):
    assert "100 frames of 4 cells" in imported("savvy-bom.csv", *BATTERY).out


def test_of_a_log_that_ends_in_nul_bytes_the_good_part_is_kept_and_named(imported):
    found = imported("nul-tail.log", *BATTERY)
    assert "199 frames of 4 cells" in found.out
    assert "NUL bytes: power failed while logging" in found.notes


def test_error_and_remote_frames_are_never_data(imported):
    found = imported("error-rtr.log", *BATTERY)
    assert "306 frames of 4 cells" in found.out


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("candump-notime.txt", "output of candump without time stamps"),
        ("size0.blf", "an object of size 0"),
        ("foreign.trc", "cannot be read"),
    ],
)
def test_what_cannot_be_read_is_refused_in_one_line(imported, name, reason):
    found = imported(name, *BATTERY)
    assert found.code != 0
    assert reason in found.notes
    assert found.notes.count("\n") == 1


def test_the_date_of_an_export_is_not_that_of_the_measurement(tmp_path, capsys):
    table = tmp_path / "exported.csv"
    table.write_text("Export date: 2026-11-01 10:00:00\nTime (s),Current (A),Cell 1 (V)\n0,1,3.7\n1,1,3.7\n")
    assert main(["sessions", "import", str(table), "--data", str(tmp_path)]) == 0
    assert "the file has no date" in capsys.readouterr().err
