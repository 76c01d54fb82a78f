import csv
from io import StringIO

import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.commands import season
from app.season.store import Answer
from app.sessions.export.csv_file import csv_row

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

    season._print_answer(Args, Answer(pa.table({"=name": ["=1+1", "plain"], "current_a": [-3.2, None]})))
    assert capsys.readouterr().out == "'=name,current_a\n'=1+1,-3.2\nplain,\n"
