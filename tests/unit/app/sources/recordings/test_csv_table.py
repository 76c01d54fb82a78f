from contextlib import suppress

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from app.estimation.errors import DatasetError
from app.sources.recordings.csv_table import read_csv
from app.words import Message, render


def read(text: str) -> tuple[list[str] | None, np.ndarray, list[str]]:
    notes: list[Message] = []
    header, columns, _ = read_csv("x.csv", text.encode(), notes)
    return header, np.column_stack(columns), [render(note) for note in notes]


@pytest.mark.parametrize("delimiter", [",", ";", "\t", " "])
def test_any_delimiter_is_found(delimiter: str) -> None:
    header, values, notes = read("\n".join(delimiter.join(row) for row in ("ab", "12", "34")))
    assert (header, values.tolist(), notes) == (["a", "b"], [[1, 2], [3, 4]], [])


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("t I  U\n0  0 4.1\n1  2 4.0\n", [[0, 0, 4.1], [1, 2, 4.0]]),  # apart by spaces
        ("t,I\n0,1,\n1,2,\n", [[0, 1], [1, 2]]),  # a delimiter after the last column
        ("t,I,soc\n0,1,\n1,2,\n", [[0, 1, np.nan], [1, 2, np.nan]]),  # an empty last column
        ("t,I\r\n0,1\r\n\r\n1,2\r\n", [[0, 1], [1, 2]]),
        ("t,I\r0,1\r\r1,2\r", [[0, 1], [1, 2]]),
        ('"t","I"\n"0","1.5"\n"1","2.5"\n', [[0, 1.5], [1, 2.5]]),
    ],
)
def test_columns_are_what_stands_between_delimiters(text: str, values: list[list[float]]) -> None:
    header, found, notes = read(text)
    np.testing.assert_array_equal(found, values)
    assert (header and header[:2], notes) == (["t", "I"], [])


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


def test_a_column_of_words_is_missing_throughout() -> None:
    _, values, _ = read("t,state,I\n" + "".join(f"{k},run,{k}\n" for k in range(8)))
    assert np.isnan(values[:, 1]).all()
    assert values[:, 2].tolist() == list(range(8))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "empty"),
        ("hello\nworld\n", "no row"),
        ("a,b\nc,d\n", "no row of numbers"),
        ("1\n2\n", "no row"),
        ("a,b,c\n1,2,3\n" + "4,5\n" * 8, "rows do not (have|consist of) 3"),
        ("a,b\nno numbers, here\n", "line 2 is 'no numbers, here'"),
    ],
)
def test_what_is_no_table_says_why(text: str, reason: str) -> None:
    with pytest.raises(DatasetError, match=reason):
        read(text)


@pytest.mark.parametrize(
    ("first", "second", "apart_s"),
    [
        ("01.05.2026 12:00:00", "02.05.2026 12:00:00", 86400),  # day first
        ("05/01/2026 12:00:00", "05/02/2026 12:00:00", 86400),  # month first
        ("13/01/2026 12:00:00", "14/01/2026 12:00:00", 86400),  # there is no month 13
        ("2026/05/01 12:00:00", "2026/05/01 12:01:00", 60),
        ("2026-05-01T12:00:00+00:00", "2026-05-01T14:00:00+02:00", 0),
        ("1d 23:59:59.5", "2d 00:00:00", 0.5),
        ("12:00", "12:01", 60),
        ("00:00:10", "00:01:00.5", 50.5),
        ("11/07/2019 23:59:00", "12/07/2019 00:01:00", 120),  # the shorter way: July
        ("12/07/2019 23:59:00", "13/07/2019 00:01:00", 120),
        ("07/12/2019 23:59:00", "07/13/2019 00:01:00", 120),
        ("07/11/2019 23:59:00", "07/12/2019 00:01:00", 120),
        ("12/31/2018 23:59:00", "01/01/2019 00:01:00", 120),
        ("31.05.2026 23:59:59", "01.06.2026 00:00:00.5", 1.5),
        ("31/05/2026 23:59:59", "31/05/2026 23:59:00", -59),
    ],
)
def test_every_way_to_write_a_moment_is_seconds(first: str, second: str, apart_s: float) -> None:
    _, values, _ = read(f"t,I\n{first},1\n{second},2\n")
    assert np.diff(values[:, 0]) == pytest.approx([apart_s])


def test_a_broken_row_is_missing_and_told() -> None:
    rows = "".join(f"{k},{k},{k}\n" for k in range(20))
    _, values, notes = read(f"a,b,c\n{rows}20,OVERLOAD,20\n21,21\n22,22,22\n")
    assert values[-2:, 0].tolist() == [20, 22]
    assert np.isnan(values[-2, 1])
    (note,) = notes
    assert note.startswith("warning: 2 rows do not consist of 3")  # more than one in twenty
    assert note.endswith("line 22: 'OVERLOAD' is not a number; line 23: 2 columns instead of 3")


def test_a_broken_first_row_does_not_hide_the_names() -> None:
    rows = "".join(f"{k},{'err' if k == 0 else 2},4.0\n" for k in range(10))
    header, values, notes = read(f"Zeit,Strom,Spannung\n{rows}")
    assert (header, values[:, 0].tolist()) == (["Zeit", "Strom", "Spannung"], list(range(10)))
    assert np.isnan(values[0, 1])
    assert any("1 rows" in note for note in notes)


def test_remarks_above_the_table_are_left_out_and_told() -> None:
    header, values, notes = read("Cycler 7\nCell: A12\n\nt,I\n0,1\n1,2\n")
    assert (header, values.tolist()) == (["t", "I"], [[0, 1], [1, 2]])
    assert any("2 lines above" in note for note in notes)


@given(st.lists(st.lists(st.floats(-1e9, 1e9), min_size=3, max_size=3), min_size=2, max_size=12))
def test_what_was_written_is_read_to_the_last_digit(rows: list[list[float]]) -> None:
    text = "\n".join(["a;b;c", *(";".join(map(repr, row)) for row in rows)])
    assert read(text)[1].tolist() == rows


@example(b"\xff\xfe")
@example(b"\xfe\xff\0")
@given(st.binary(max_size=200))
def test_any_bytes_are_a_table_or_say_why_not(content: bytes) -> None:
    with suppress(DatasetError):
        _, columns, _ = read_csv("x.csv", content, [])
        assert len({len(column) for column in columns}) == 1
