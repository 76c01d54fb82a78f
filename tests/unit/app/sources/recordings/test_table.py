"""Columns by name, number and pattern; files by their content, whatever they are called."""

import gzip
from datetime import UTC, datetime

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from app.errors import ImportFailed, LimitExceeded
from app.estimation.errors import DatasetError
from app.sources.recordings import table as table_module
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
    assert f"soc = {name!r}: no such column; available: 'time', 'V10', 'V2', '7'" in str(refused.value)
    with pytest.raises(ImportFailed, match="'c11' and 18 more"):
        Table("x.csv", {f"c{i}": np.zeros(1) for i in range(30)}).column("soc", "none")


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
    tables = [written(tmp_path, text), written(tmp_path, gzip.compress(text.encode()), "x.dat")]
    tables.append(parquet(tmp_path, {name: list(values) for name, values in tables[0].columns.items()}))
    tables.append(written(tmp_path, gzip.compress((tmp_path / "x.parquet").read_bytes())))
    first, *others = ({name: list(values) for name, values in table.columns.items()} for table in tables)
    assert others == [first] * 3


def test_without_names_columns_are_numbered_from_one(tmp_path):
    table = written(tmp_path, "0,1.5,3.7\n1,2,3.6\n2,2,3.5\n")
    assert not table.has_header
    assert list(table.columns) == ["1", "2", "3"]


def test_a_name_that_comes_twice_gets_its_place(tmp_path):
    table = written(tmp_path, "t,V,V\n0,3.7,3.8\n1,3.6,3.9\n")
    assert list(table.columns) == ["t", "V", "V #3"]
    np.testing.assert_array_equal(table.columns["V #3"], [3.8, 3.9])


@pytest.mark.parametrize(
    ("content", "why"),
    [
        *((content, "") for content in (b"", b"hello", b"a,b,c\n", b"a,b,c\nx,y,z\n", "ø".encode("latin-1") * 9)),
        *(
            (content, "cannot be read")
            for content in (
                b"\x1f\x8b broken",
                b"\x1f\x8b",
                gzip.compress(b"a,b\n1,2\n", mtime=0)[:-4],
                b"\x1f\x8b\x08" + b"\xff" * 40,
            )
        ),
        *(
            (content, "not a readable Parquet file")
            for content in (b"PAR1 broken", b"PAR1", b"PAR1" + bytes(100) + b"PAR1", b"PAR1" + bytes(100))
        ),
    ],
)
def test_what_is_no_table_or_cut_is_refused_by_the_files_name(tmp_path, content, why):
    with pytest.raises(DatasetError, match=rf"x\.csv.*{why}"):
        written(tmp_path, content)


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(DatasetError, match="cannot be read"):
        load_table(tmp_path / "none.csv")


def parquet(tmp_path, columns, names=None):
    path = tmp_path / "x.parquet"
    given = columns if names is None else pa.Table.from_arrays(columns, names=names)
    pq.write_table(given if names else pa.table(given), path)
    return load_table(path)


def test_a_parquet_file_is_known_by_its_content(tmp_path):
    table = parquet(tmp_path, {"Zeit [s]": [0.5, 1.5], "V1": [3.7, 3.8]})
    assert (tmp_path / "x.parquet").rename(tmp_path / "x.csv")
    assert list(load_table(tmp_path / "x.csv").columns) == list(table.columns) == ["Zeit [s]", "V1"]
    np.testing.assert_array_equal(table.column("voltage", "V1"), [3.7, 3.8])


@pytest.mark.parametrize("kind", [pa.float64(), pa.float32(), pa.int64(), pa.bool_(), pa.string(), pa.timestamp("ms")])
def test_what_is_missing_in_a_parquet_file_is_nan_and_never_zero(tmp_path, kind):
    column = parquet(
        tmp_path, {"a": pa.array(["1", None]).cast(pa.int64() if kind != pa.string() else kind).cast(kind)}
    )
    first, second = column.columns["a"]
    assert np.isfinite(first)
    assert np.isnan(second)


@pytest.mark.parametrize("number", [2**53 + 1, 1_780_000_000_123_456_789, -(2**62) - 1])
def test_whole_numbers_that_are_longer_than_a_double_are_rounded_not_lost(tmp_path, number):
    table = parquet(tmp_path, {"t_ns": pa.array([number, number + 10**9], pa.int64())})
    np.testing.assert_allclose(table.columns["t_ns"], [number, number + 10**9], rtol=1e-15)


def test_stamps_of_any_resolution_and_zone_are_seconds_since_1970(tmp_path):
    at = datetime(2026, 5, 1, 12, 0, 0, 250_000, tzinfo=UTC)
    kinds = {
        unit: pa.array([at]).cast(pa.timestamp("us", tz="UTC")).cast(pa.timestamp(unit, tz=zone))
        for unit, zone in (("ms", "Europe/Oslo"), ("us", "UTC"), ("ns", "America/New_York"))
    }
    columns = parquet(tmp_path, kinds).columns
    assert [column[0] for column in columns.values()] == [pytest.approx(at.timestamp(), abs=1e-6)] * 3
    lengths = parquet(tmp_path, {"t": pa.array([1_500_000_001, 2_000_000_002]).cast(pa.duration("ns"))}).columns["t"]
    assert lengths == pytest.approx([1.5, 2.0], abs=2e-6)


def test_words_and_lists_in_a_parquet_file_are_columns_without_numbers(tmp_path):
    columns = parquet(tmp_path, {"word": ["idle", "2"], "list": [[1.0], [2.0]], "none": pa.nulls(2)}).columns
    assert all(np.isnan(column).all() for column in columns.values())


def test_two_columns_of_one_name_get_their_places_in_a_parquet_file_too(tmp_path):
    table = parquet(tmp_path, [pa.array([1.0]), pa.array([2.0])], ["a", "a"])
    assert {name: column[0] for name, column in table.columns.items()} == {"a": 1.0, "a #2": 2.0}


def test_a_file_that_unpacks_out_of_all_proportion_is_refused_with_the_limit(tmp_path, monkeypatch):
    monkeypatch.setattr(table_module, "_ALWAYS_BYTES", 1 << 20)
    with pytest.raises(LimitExceeded, match="1 MB"):
        written(tmp_path, gzip.compress(b"1,2\n" * (3 << 18)))


def test_a_parquet_file_of_too_many_values_is_refused_before_it_is_read(tmp_path, monkeypatch):
    monkeypatch.setattr(table_module, "PARQUET_VALUES", 5)
    with pytest.raises(LimitExceeded):
        parquet(tmp_path, {"a": [1.0, 2.0, 3.0], "b": [1.0, 2.0, 3.0]})
