import numpy as np
import pytest

from app.estimation.errors import DatasetError
from app.sources.recordings.csv_table import read_csv


def read(text: str) -> tuple[list[str] | None, np.ndarray, list[str]]:
    notes: list[str] = []
    header, columns = read_csv("x.csv", text.encode(), notes)
    return header, np.column_stack(columns), notes


@pytest.mark.parametrize("delimiter", [",", ";", "\t", " "])
def test_any_delimiter_is_found(delimiter: str) -> None:
    header, values, notes = read("\n".join(delimiter.join(row) for row in ("ab", "12", "34")))
    assert (header, values.tolist(), notes) == (["a", "b"], [[1, 2], [3, 4]], [])


def test_decimal_commas_need_semicolons_between_columns() -> None:
    _, values, notes = read("a;b\n1,5;2\n3,25;4\n")
    assert values.tolist() == [[1.5, 2], [3.25, 4]]
    assert notes == ["decimal commas read as points"]


@pytest.mark.parametrize("missing", ["", "nan", "NA", "n/a", "null", "None", "-", "--"])
def test_what_says_missing_is_missing(missing: str) -> None:
    _, values, notes = read(f"a,b,c\n1,2,3\n4,{missing},6\n")
    np.testing.assert_array_equal(values, [[1, 2, 3], [4, np.nan, 6]])
    assert len(notes) <= 1


@pytest.mark.parametrize(
    ("units", "header"),
    [
        ("s,mA", ["t [s]", "I [mA]"]),
        ("[s],(A)", ["t [s]", "I [A]"]),
        (",A", ["t", "I [A]"]),
        ("one,two", ["one", "two"]),
    ],
)
def test_a_row_of_units_below_the_names_is_joined_to_them(units: str, header: list[str]) -> None:
    assert read(f"t,I\n{units}\n0,1\n1,2\n")[0] == header


def test_quoted_names_and_numbers_are_read() -> None:
    header, values, _ = read('"t","I"\n"0","1"\n"1","2"\n')
    assert (header, values.tolist()) == (["t", "I"], [[0, 1], [1, 2]])


def test_clocks_and_dates_are_seconds() -> None:
    _, values, _ = read("t,x\n00:00:10,1\n00:01:00.5,2\n1d 00:00:00,3\n")
    assert values[:, 0].tolist() == [10, 60.5, 86400]
    _, values, _ = read("t,x\n2026-05-01 12:00:00,1\n2026-05-01 12:00:01.5,2\n")
    assert np.diff(values[:, 0]) == pytest.approx([1.5])


def test_a_column_of_words_is_missing_throughout() -> None:
    _, values, _ = read("t,state,I\n" + "".join(f"{k},run,{k}\n" for k in range(8)))
    assert np.isnan(values[:, 1]).all()
    assert values[:, 2].tolist() == list(range(8))


def test_rows_that_are_mostly_broken_are_no_table() -> None:
    with pytest.raises(DatasetError, match="rows are not 3 columns"):
        read("a,b,c\n1,2,3\n" + "4,5\n" * 8)


@pytest.mark.parametrize(("text", "reason"), [("", "empty"), ("a,b\nc,d\n", "no row of numbers"), ("1\n2\n", "no row")])
def test_what_is_no_table_says_why(text: str, reason: str) -> None:
    with pytest.raises(DatasetError, match=reason):
        read(text)
