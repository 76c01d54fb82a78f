import csv
from io import StringIO

import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.commands.season import query
from app.commands.season.match import match_cells, read_cells
from app.season.store import Answer
from app.sessions.export.csv_row import csv_row

FORMULAS = [
    "=1+1",
    "+cmd|'/C calc'!A0",
    "-2+3+cmd|' /C calc'!A0",
    "@SUM(A1)",
    "\t=1",
    "\r=1",
    "\n=1",
    "--3",
    "-",
    "-3.2 A",
]


@pytest.mark.parametrize("text", FORMULAS)
def test_a_text_that_a_spreadsheet_would_run_stays_text(text):
    assert next(csv.reader(StringIO(csv_row([text, 1]), newline="")))[0] == f"'{text}"


@pytest.mark.parametrize("number", [-3.2, -3, "-3.2", "+5", "-1e-9", "-.5", 0, True])
def test_numbers_stay_numbers(number):
    assert csv_row([number]) == f"{number}\n"


@given(st.lists(st.text() | st.integers() | st.none(), min_size=2))
def test_what_is_written_is_read_again_and_begins_no_formula(cells):
    texts = ["" if each is None else str(each) for each in cells]
    (found,) = csv.reader(StringIO(csv_row(cells), newline=""))
    assert [each if each == text else each.removeprefix("'") for each, text in zip(found, texts, strict=True)] == texts


def test_a_name_of_a_session_in_the_answer_of_a_season_is_no_formula(capsys):
    class Args:
        csv, json = True, False

    query._print(Args, Answer(pa.table({"=name": ["=1+1", "plain"], "current_a": [-3.2, None]})))
    assert capsys.readouterr().out == "'=name,current_a\n'=1+1,-3.2\nplain,\n"


def test_names_of_matched_cells_are_no_formulas(tmp_path, capsys):
    table = tmp_path / "cells.csv"
    rows = "".join(f"=cell{i},{3 + i / 10},{0.02 + i / 1000}\n" for i in range(4))
    table.write_text("cell,capacity_ah,resistance_ohm\n" + rows)

    class Args:
        out, parallel, json = tmp_path / "out.csv", 2, True

    Args.table = table
    assert read_cells(table)[0][0] == "=cell0"
    match_cells(Args)
    lines = Args.out.read_text().splitlines()
    assert lines[0] == "cell,group"
    assert len(lines) == 5
    assert all(line.startswith("'=cell") for line in lines[1:])
