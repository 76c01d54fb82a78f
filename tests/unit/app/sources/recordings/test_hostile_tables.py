"""Tables that are built to break a reader: a table, or one error that names row and limit, and soon."""

import time

import pytest

from app.errors import ImportFailed
from app.sources.recordings.csv_table import MOST_COLUMNS
from app.sources.recordings.import_mapping import ImportMapping
from app.sources.recordings.kind import kind_of
from app.sources.recordings.table import column_number, load_table, read_table

AT_ONCE_S = 5.0  # on a busy machine; the worst took minutes
NAMES = "time_s,current_a,voltage_v\n"
ROWS = "".join(f"{k / 10},{k % 7}.5,3.{700 + k % 50}\n" for k in range(300))
WIDE = "1," * 100_000 + "1\n"


def table_of(tmp_path, text):
    path = tmp_path / "a.csv"
    path.write_text(text)
    began = time.monotonic()
    try:
        return read_table(path)
    finally:
        assert time.monotonic() - began < AT_ONCE_S


@pytest.mark.parametrize(
    ("text", "named"),
    [
        (f'{NAMES}{ROWS}99,"{"x" * 200_000}, y",3.7\n', r"row 302: .*131072"),
        (f'"{"x" * 200_000},y",current_a,voltage_v\n{ROWS}', r"row 1: .*131072"),
        (WIDE.replace("1,", "c,") + WIDE, f"row 1: 100001 columns, maximum {MOST_COLUMNS}"),
        (f"a\n{WIDE.replace(',', ';')}", f"row 2: 100001 columns, maximum {MOST_COLUMNS}"),
        ("," * 1_000_000 + "\n", f"row 1: 1000001 columns, maximum {MOST_COLUMNS}"),
    ],
)
def test_what_is_beyond_a_limit_is_named_with_its_row(tmp_path, text, named):
    with pytest.raises(ImportFailed, match=named):
        table_of(tmp_path, text)


@pytest.mark.parametrize(
    "above",
    [
        "Nb header lines : " + "9" * 60_000 + "\n",
        "\n" * 500_000,
        " " * 100_000 + "\n",
        "1)" * 30_000 + "\n",
        '"' * 100_001,
    ],
)
def test_what_stands_above_a_table_does_not_stop_it_from_being_read(tmp_path, above):
    assert len(next(iter(table_of(tmp_path, f"{above}\n{NAMES}{ROWS}").columns.values()))) >= 300


def test_a_row_of_many_columns_in_a_table_adds_none(tmp_path):
    table = table_of(tmp_path, f"{NAMES}{ROWS}{WIDE}{ROWS}")
    assert list(table.columns) == ["time_s", "current_a", "voltage_v"]


@pytest.mark.parametrize(
    "time_text",
    ["9223372036854775807", "-9223372036854775808", "1e308", "9" * 60_000, "292277026596-01-01T00:00:00",
     "0001-01-01 00:00:00", "9999-12-31T23:59:59-23:59", "9" * 5000 + "d 00:00:00", "²", "٣:٣٣:٣٣"],
)  # fmt: skip
def test_a_time_beyond_every_calendar_is_a_number_or_missing(tmp_path, time_text):
    assert table_of(tmp_path, NAMES + f"{time_text},1,3.7\n" * 50 + ROWS).columns


@pytest.mark.parametrize("text", ["²", "٣", "0", "4", "9" * 60_000, "-1", "+1", "", "1_0"])
def test_what_is_no_number_of_a_column_names_none(tmp_path, text):
    assert column_number(text, 3) is None
    assert [column_number(str(k), 12) for k in (1, 9, 12)] == [1, 9, 12]
    path = tmp_path / "a.csv"
    path.write_text(NAMES + ROWS)
    with pytest.raises(ImportFailed):
        load_table(path).column("current", text)


def test_a_column_whose_number_has_thousands_of_digits_fits_no_pattern(tmp_path):
    table = table_of(tmp_path, NAMES.replace("voltage_v", "Cell 1").replace("current_a", "Cell " + "9" * 5000) + ROWS)
    assert table.matrix("voltages", "Cell {n}").shape[1] == 1


@pytest.mark.parametrize("cells", ["9" * 60_000, "1-99999", "²", "1-2-3"])
def test_cells_that_are_no_numbers_are_refused(cells):
    with pytest.raises(ImportFailed, match="cells"):
        ImportMapping(cells=cells)


def test_blank_lines_take_no_time_to_be_no_log(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("\n" * 500_000)
    began = time.monotonic()
    assert kind_of(path) == "table"
    assert time.monotonic() - began < AT_ONCE_S
