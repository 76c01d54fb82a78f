import builtins
import csv
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from pyarrow import csv as arrow_csv
from pyarrow import parquet

from app.errors import ConfigError
from app.sessions.errors import ExportUnavailable, UnknownSignal
from app.sessions.export.export import export
from app.sessions.export.formats import FORMATS
from app.sessions.reading.reader import SessionFile
from app.sessions.recording.recorder import Recorder

WALL_S = 1_790_000_000
MONO_NS = 5_000 * 10**9


@pytest.fixture
def session(recorder: Recorder, stream):
    """Two minutes with two chunks stored and the rest not; some frames are committed apart from their estimate."""
    info = recorder.start("friday")
    for i in range(1300):
        uptime_ms = stream.uptime_ms
        t_mono_ns, t_wall_ns, raw = stream.next()
        recorder.frame(t_mono_ns, t_wall_ns, 0, raw, True)
        if i % 300 == 1:
            recorder.flush()
        recorder.estimates(t_mono_ns + 3_000_000, uptime_ms, np.full(96, 0.5), np.full(96, np.nan))
    recorder.flush()
    with SessionFile(info.path) as session:
        yield session


def read_csv(path: Path) -> tuple[list[str], list[list[str]]]:
    with path.open(newline="") as file:
        header, *rows = list(csv.reader(file))
    return header, rows


def test_csv_has_a_row_per_instant_with_units_in_names(session: SessionFile, stream, tmp_path: Path) -> None:
    export(session, tmp_path / "a.csv", "csv", signals=["v[36]", "estimate.soc[0]", "estimate.soc_sigma[0]", "t[3]"])
    header, rows = read_csv(tmp_path / "a.csv")
    assert header == [
        "time_s",
        "elapsed_s",
        "uptime_s",
        "v[36] (V)",
        "estimate.soc[0]",
        "estimate.soc_sigma[0]",
        "t[3] (degC)",
        "age (s)",
        "time",
    ]
    assert len(rows) == 1300
    assert rows[7] == [
        f"{WALL_S}.700",
        "0.700",
        "1.700",
        f"{stream.voltages[7][36] * 1e-4:.4f}",
        "0.50000",
        "",
        "23",
        "0.000",
        "2026-09-21T14:13:20.700000Z",
    ]
    assert [row[3] for row in rows] == [f"{each[36] * 1e-4:.4f}" for each in stream.voltages]


def _by_pandas(path: Path) -> np.ndarray:
    pandas = pytest.importorskip("pandas")
    times = pandas.read_parquet(path) if path.suffix == ".parquet" else pandas.read_csv(path, parse_dates=["time"])
    assert str(times["time"].dt.tz) == "UTC"
    return times["time"].dt.tz_localize(None).to_numpy()


def _by_polars(path: Path) -> np.ndarray:
    polars = pytest.importorskip("polars")
    is_parquet = path.suffix == ".parquet"
    times = polars.read_parquet(path) if is_parquet else polars.read_csv(path, try_parse_dates=True)
    assert times["time"].dtype == polars.Datetime("us", "UTC")
    return times["time"].to_numpy()


def _by_pyarrow(path: Path) -> np.ndarray:
    times = parquet.read_table(path) if path.suffix == ".parquet" else arrow_csv.read_csv(path)
    assert times["time"].type.tz == "UTC"
    return times["time"].to_numpy()


def test_parquet_read_by_pyarrow_equals_the_csv(session: SessionFile, tmp_path: Path) -> None:
    signals = ["i_fs", "estimate.soc_sigma[0]", "v[0]"]
    export(session, tmp_path / "a.csv", "csv", signals=signals)
    export(session, tmp_path / "a.parquet", "parquet", signals=signals)
    header, rows = read_csv(tmp_path / "a.csv")
    table = parquet.read_table(tmp_path / "a.parquet")
    assert table.column_names == header
    assert table.schema.field("i_fs (A)").metadata == {b"unit": b"A"}
    assert table.schema.metadata[b"name"] == b"friday"
    *numbers, stamps = zip(header, zip(*rows, strict=True), strict=True)
    for name, column in numbers:
        expected = [float(text) if text else None for text in column]
        assert table[name].to_pylist() == pytest.approx(expected, abs=1e-3)
    assert table["time"].to_pylist() == [datetime.fromisoformat(text) for text in stamps[1]]


@pytest.mark.parametrize("read", [_by_pandas, _by_polars, _by_pyarrow])
@pytest.mark.parametrize("name", ["csv", "parquet"])
def test_the_time_is_a_utc_timestamp_to_the_tools_that_people_use(
    session: SessionFile, tmp_path: Path, name: str, read: Callable[[Path], np.ndarray]
) -> None:
    export(session, tmp_path / f"a.{name}", name, signals=["v[0]"])
    times_us = read(tmp_path / f"a.{name}").astype("datetime64[us]").astype(np.int64)
    assert times_us == pytest.approx(WALL_S * 10**6 + np.arange(1300) * 10**5, abs=1)


def test_no_two_rows_have_the_same_time_stamp(recorder: Recorder, stream, tmp_path: Path, monkeypatch) -> None:
    info = recorder.start()
    for i in range(200):  # what waited arrives ten at a time
        arrived_ns = MONO_NS + i // 10 * 10**9
        recorder.frame(arrived_ns, arrived_ns - MONO_NS + WALL_S * 10**9, 0, stream.next()[2], True)
    recorder.flush()
    stamps = []
    for piece_s in (240.0, 0.7):
        monkeypatch.setattr("app.sessions.export.table.PIECE_S", piece_s)
        with SessionFile(info.path) as session:
            export(session, tmp_path / "a.csv", "csv", signals=["v[0]"])
        stamps.append([row[-1] for row in read_csv(tmp_path / "a.csv")[1]])
    assert stamps[0] == stamps[1]
    assert len(stamps[0]) == len(set(stamps[0])) == 200
    assert stamps[0] == sorted(stamps[0])


def test_a_range_is_cut_exactly(session: SessionFile, tmp_path: Path) -> None:
    export(session, tmp_path / "a.csv", "csv", signals=["v[0]"], t_from_s=WALL_S + 59.9, t_to_s=WALL_S + 60.1)
    assert [row[1] for row in read_csv(tmp_path / "a.csv")[1]] == ["59.900", "60.000", "60.100"]


def test_without_signals_the_fast_ones_and_the_estimates_are_written(session: SessionFile, tmp_path: Path) -> None:
    export(session, tmp_path / "a.csv", "csv", t_to_s=WALL_S + 1)
    header, _ = read_csv(tmp_path / "a.csv")
    assert {"i_fs (A)", "v[95] (V)", "t[0] (degC)", "estimate.soc[95]", "soc"} <= set(header)
    assert len(header) == len(set(header)) == 3 + 11 + 4 * 96 + 2


def test_blocks_join_without_seam(session: SessionFile, tmp_path: Path, monkeypatch) -> None:
    signals = ["v[0]", "estimate.soc[0]"]
    export(session, tmp_path / "whole.csv", "csv", signals=signals)
    monkeypatch.setattr("app.sessions.export.table.PIECE_S", 0.3015)
    export(session, tmp_path / "parts.csv", "csv", signals=signals)
    assert (tmp_path / "parts.csv").read_bytes() == (tmp_path / "whole.csv").read_bytes()


def test_an_unknown_signal_leaves_no_file(session: SessionFile, tmp_path: Path) -> None:
    with pytest.raises(UnknownSignal):
        export(session, tmp_path / "a.csv", "csv", signals=["nonsense"])
    with pytest.raises(ConfigError, match="format"):
        export(session, tmp_path / "a.csv", "xls")
    assert not (tmp_path / "a.csv").exists()


def test_a_missing_package_is_one_line_with_the_command(session: SessionFile, tmp_path: Path, monkeypatch) -> None:
    real_import = builtins.__import__

    def without_pyarrow(name: str, *args: object) -> object:
        if name.startswith("pyarrow"):
            raise ImportError(name)
        return real_import(name, *args)

    monkeypatch.setattr(builtins, "__import__", without_pyarrow)
    with pytest.raises(ExportUnavailable, match=r"pip install 'voltwall\[parquet\]'"):
        export(session, tmp_path / "a.parquet", "parquet", signals=["v[0]"])


def test_an_empty_session_gives_the_header_alone(recorder: Recorder, tmp_path: Path) -> None:
    info = recorder.start()
    recorder.flush()
    with SessionFile(info.path) as session:
        export(session, tmp_path / "a.csv", "csv", signals=["v[0]"])
    assert (tmp_path / "a.csv").read_text() == "time_s,elapsed_s,uptime_s,v[0] (V),age (s),time\n"


def test_what_waited_on_its_way_is_old_and_a_range_knows_it_too(recorder: Recorder, stream, tmp_path: Path) -> None:
    info = recorder.start()
    for i in range(300):
        uptime_ms = stream.uptime_ms
        t_mono_ns, t_wall_ns, raw = stream.next()
        delay_ns = 2_500_000_000 if i >= 150 else 0
        recorder.frame(t_mono_ns + delay_ns, t_wall_ns + delay_ns, 0, raw, True)
        if i % 100 == 0:
            recorder.clock(t_mono_ns + delay_ns, t_wall_ns + delay_ns, uptime_ms)
    recorder.flush()
    with SessionFile(info.path) as session:
        for t_from_s in (None, WALL_S + 20):
            export(session, tmp_path / "a.csv", "csv", signals=["v[0]"], t_from_s=t_from_s)
            header, rows = read_csv(tmp_path / "a.csv")
            ages_s = [float(row[header.index("age (s)")]) for row in rows]
            assert ages_s[-1] == pytest.approx(2.5, abs=0.02)
            assert ages_s[0] == pytest.approx(0.0 if t_from_s is None else 2.5, abs=0.02)


@pytest.mark.parametrize("name", ["csv", "parquet", "mf4", "mcap", "ld", "motec"])
def test_an_export_tells_how_far_it_is(name: str, session: SessionFile, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("app.sessions.export.table.PIECE_S", 20.0)
    monkeypatch.setattr("app.sessions.export.export.ROW_GROUP_S", 20.0)
    told: list[tuple[int, int]] = []
    path = tmp_path / f"a{FORMATS[name].suffix}"
    export(session, path, name, signals=["v[36]"], on_progress=lambda done, of: told.append((done, of)))
    assert len(told) > 1
    assert told == sorted(told)
    assert len({of for _, of in told}) == 1
    assert told[-1][0] == told[-1][1]
