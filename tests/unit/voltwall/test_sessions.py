import importlib
import shutil
import sys
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

import voltwall
from tests.recorded.season import LAP_S, OCV_V, R_OHM, TIME_S


@pytest.fixture(scope="module")
def path(season):
    return min(season.glob("*.sqlite"))


@pytest.fixture
def session(path):
    with voltwall.open(path) as opened:
        yield opened


def test_a_session_says_what_it_is(session, path):
    assert session.id == path.stem
    assert session.start == datetime.fromtimestamp(1_790_000_000, UTC)
    assert session.duration_s == 0.0  # by the clock of the recorder, which stood still
    assert (session.n_cells, session.segments, session.name) == (96, (12,) * 8, "made")
    assert session.id in repr(session)


def test_signals_have_units(session):
    assert session.signals["v[36]"] == "V"
    assert session.signals["t[95]"] == "degC"
    assert {"i_fs", "estimate.soc[0]"} <= session.signals.keys()


def test_whole_fields_and_single_signals_are_columns_over_time(session):
    table = session.to_arrow("v", "i_fs", "estimate.soc[3]")
    assert table.column_names == ["time", *(f"v[{k}]" for k in range(96)), "i_fs", "estimate.soc[3]"]
    assert table.num_rows == len(TIME_S)
    assert str(table.schema.field("time").type) == "timestamp[us, tz=UTC]"
    assert session.table("v[0]").units == {"v[0]": "V"}
    current = np.array(table["i_fs"])
    assert np.array(table["v[40]"]) == pytest.approx(OCV_V[40] - current * R_OHM[40], abs=1e-4)


def test_a_range_is_in_seconds_or_by_the_clock(session):
    by_seconds = session.to_arrow("i_fs", start=10.0, end=20.0)
    begin = session.start + timedelta(seconds=10)
    by_clock = session.to_arrow("i_fs", start=begin, end=begin + timedelta(seconds=10))
    assert by_seconds.num_rows == 21
    assert by_seconds.equals(by_clock)


def test_pandas_gets_an_index_of_timestamps(session):
    pandas = pytest.importorskip("pandas", reason="pandas is not installed")
    frame = session.to_pandas("v[40]")
    assert isinstance(frame.index, pandas.DatetimeIndex)
    assert str(frame.index.tz) == "UTC"
    assert frame["v[40]"].min() == pytest.approx(3.4, abs=1e-4)


def test_polars_gets_the_same(session):
    polars = pytest.importorskip("polars", reason="polars is not installed")
    frame = session.to_polars("v[40]")
    assert frame.schema["time"] == polars.Datetime("us", "UTC")
    assert frame["v[40]"].min() == pytest.approx(3.4, abs=1e-4)


@pytest.mark.parametrize("package", ["pandas", "polars"])
def test_without_the_library_one_line_says_what_to_install(session, monkeypatch, package):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ImportError, match=f"to_{package} needs {package}: pip install {package}"):
        getattr(session, f"to_{package}")("i_fs")


def test_laps_events_and_findings_are_records(session):
    assert [lap.number for lap in session.laps] == [1, 2, 3]
    assert session.laps[0].duration_s == pytest.approx(LAP_S, abs=0.01)
    assert session.laps[1].weakest_cell == 40
    event = next(each for each in session.events if each.code == "finding-joint")
    assert (event.cell, event.severity, event.time - session.start) == (7, "warning", timedelta(seconds=70))
    assert all(0 <= found.cell < 96 and found.text for found in session.findings)


def test_a_filter_runs_over_the_session_again(session):
    found = session.estimate(cell="samsung-25r-10p", filter="coulomb")
    assert (found.filter, len(found.table)) == ("coulomb", len(TIME_S))
    soc = np.array(found.to_arrow()["soc[12]"])
    assert 0.0 <= soc.min() <= soc.max() <= 1.0
    assert found.summary["soc_last"][12] == pytest.approx(soc[-1], abs=1e-4)
    assert found.table.units["soc[12]"] == "1"


def test_what_is_wrong_is_named(session, tmp_path):
    with pytest.raises(voltwall.VoltwallError, match="voltage"):
        session.to_arrow("voltage")
    with pytest.raises(voltwall.VoltwallError, match="index"):
        session.to_arrow("v[96]")
    with pytest.raises(voltwall.VoltwallError):
        voltwall.open(tmp_path / "nothing.sqlite")
    with pytest.raises(voltwall.VoltwallError, match="nowhere"):
        voltwall.open("nowhere://x/y.sqlite")


def test_a_session_is_brought_from_any_url_and_the_copy_removed(path):
    fsspec = importlib.import_module("fsspec")
    with fsspec.open("memory://season/s.sqlite", "wb") as target, path.open("rb") as source:
        shutil.copyfileobj(source, target)
    opened = voltwall.open("memory://season/s.sqlite")
    copy = opened._temporary
    assert (opened.id, opened.n_cells) == ("s", 96)
    assert copy.is_dir()
    opened.close()
    assert not copy.exists()
