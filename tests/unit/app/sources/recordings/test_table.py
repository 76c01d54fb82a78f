"""Columns by name, number and pattern; files by their content, whatever they are called."""

import gzip

import numpy as np
import pytest

from app.errors import ImportFailed
from app.estimation.errors import DatasetError
from app.sources.recordings.table import Table, load_table, matching

TABLE = Table("x.csv", {"time": np.zeros(2), "V10": np.full(2, 10.0), "V2": np.full(2, 2.0), "7": np.full(2, 7.0)})


def written(tmp_path, content, name="x.csv"):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return load_table(path)


def test_a_column_is_found_by_its_name_before_its_number():
    assert TABLE.column("soc", "V2")[0] == 2.0
    assert TABLE.column("soc", "7")[0] == 7.0
    assert TABLE.column("soc", "2")[0] == 10.0, "the second column"


@pytest.mark.parametrize("name", ["0", "5", "v2", "", "-1"])
def test_a_column_that_is_not_there_is_refused_by_name(name):
    with pytest.raises(ImportFailed) as refused:
        TABLE.column("soc", name)
    assert f"soc = {name!r}: no such column; there are 'time', 'V10', 'V2', '7'" in str(refused.value)


def test_of_many_columns_a_dozen_are_named():
    wide = Table("x.csv", {f"c{i}": np.zeros(1) for i in range(30)})
    with pytest.raises(ImportFailed, match="'c11' and 18 more"):
        wide.column("soc", "none")


def test_a_pattern_takes_columns_in_the_order_of_their_numbers():
    np.testing.assert_array_equal(TABLE.matrix("voltages", "V{n}")[0], [2.0, 10.0])
    with pytest.raises(ImportFailed, match="no column fits"):
        TABLE.matrix("voltages", "Cell {n}")


@pytest.mark.parametrize(
    ("pattern", "names", "found"),
    [
        ("V{n}", ["V10", "V9", "V1", "VV2", "V3x", "xV4"], ["V1", "V9", "V10"]),
        ("P{p}C{n}", ["P2C1", "P1C2", "P1C10", "P10C1"], ["P1C2", "P1C10", "P2C1", "P10C1"]),
        ("C{n}P{p}", ["C1P2", "C2P1"], ["C2P1", "C1P2"]),
        ("Cell {n} (mV)", ["Cell 1 (mV)", "Cell 1 mV"], ["Cell 1 (mV)"]),
        ("V", ["V", "VV"], ["V"]),
        ("{n}{n}", ["12"], []),
        ("V{x}", ["V1", "V{x}"], ["V{x}"]),
        ("", ["", "a"], [""]),
    ],
)
def test_patterns(pattern, names, found):
    assert matching(pattern, names) == found


def test_a_csv_has_its_names_and_numbers(tmp_path):
    table = written(tmp_path, "time_s,current_a,voltage_v\n0,1.5,3.7\n1,,3.6\n")
    assert table.source == "x.csv"
    assert table.has_header
    assert list(table.columns) == ["time_s", "current_a", "voltage_v"]
    np.testing.assert_array_equal(table.columns["current_a"], [1.5, np.nan])


def test_a_packed_file_is_the_same_whatever_its_name(tmp_path):
    text = "time_s,current_a,voltage_v\n0,1.5,3.7\n1,2,3.6\n"
    plain, packed = written(tmp_path, text), written(tmp_path, gzip.compress(text.encode()), "x.dat")
    assert {name: list(v) for name, v in plain.columns.items()} == {name: list(v) for name, v in packed.columns.items()}


def test_without_names_columns_are_numbered_from_one(tmp_path):
    table = written(tmp_path, "0,1.5,3.7\n1,2,3.6\n2,2,3.5\n")
    assert not table.has_header
    assert list(table.columns) == ["1", "2", "3"]


def test_a_name_that_comes_twice_gets_its_place(tmp_path):
    table = written(tmp_path, "t,V,V\n0,3.7,3.8\n1,3.6,3.9\n")
    assert list(table.columns) == ["t", "V", "V #3"]
    np.testing.assert_array_equal(table.columns["V #3"], [3.8, 3.9])


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_delimiters_are_found(tmp_path, delimiter):
    text = "\n".join(delimiter.join(row) for row in (["t", "I", "V"], ["0", "1", "3.7"], ["1", "2", "3.6"]))
    assert list(written(tmp_path, text).columns) == ["t", "I", "V"]


def test_a_decimal_comma_is_understood_where_the_delimiter_is_another(tmp_path):
    table = written(tmp_path, "t;I;V\n0;1,5;3,7\n1;2,5;3,6\n")
    np.testing.assert_array_equal(table.columns["I"], [1.5, 2.5])


@pytest.mark.parametrize(
    "stamp", ["2026-05-01T12:00:{:02d}", "01.05.2026 12:00:{:02d}", "12:00:{:02d}", "0:00:{:02d}.5"]
)
def test_stamps_become_seconds(tmp_path, stamp):
    rows = "".join(f"{stamp.format(second)},1,3.7\n" for second in range(10, 16))
    table = written(tmp_path, "time,I,V\n" + rows)
    np.testing.assert_allclose(np.diff(table.columns["time"]), 1.0)


def test_rows_that_are_cut_are_counted(tmp_path):
    rows = "".join(f"{i},1,3.7\n" for i in range(20))
    table = written(tmp_path, "t,I,V\n" + rows + "20,1\n21,1,3.7\n")
    assert len(table.columns["t"]) == 21
    assert table.notes == ("1 rows are not 3 columns of numbers: read as missing or left out",)


@pytest.mark.parametrize(
    "content",
    [b"", b"hello", b"\x1f\x8b broken", b"PAR1 broken", b"a,b,c\n", b"a,b,c\nx,y,z\n", "ø".encode("latin-1") * 9],
)
def test_what_is_no_table_is_refused_by_the_files_name(tmp_path, content):
    with pytest.raises(DatasetError, match=r"x\.csv"):
        written(tmp_path, content)


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(DatasetError, match="cannot be read"):
        load_table(tmp_path / "none.csv")
