"""Other teams' recordings: tables and CAN logs as they come out of other systems, as sessions of ours."""

from dataclasses import replace
from pathlib import Path

import can
import cantools
import numpy as np
import pyarrow
import pytest
from pyarrow import parquet

from app.errors import ImportFailed
from app.estimation.arrays import FloatArray
from app.live.pipeline import Output, Pipeline
from app.live.pipeline_factory import PipelineFactory
from app.sessions.export.export import export
from app.sessions.export.formats import Names
from app.sessions.reading.reader import SessionFile
from app.sessions.transfer.import_session import ImportedSession, import_file
from app.sources.items import Item
from app.sources.loaded_battery import LoadedBattery
from app.sources.recordings.guess import guess
from app.sources.recordings.import_mapping import ImportMapping
from app.sources.recordings.table import read_table
from app.words import render

START_S = 1_780_000_000.0
N = 40
ROWS = 60
ORION = ImportMapping(
    time="Time", current="Pack Current (A)", charge_positive=True, voltages="Cell {n} (mV)", voltage_unit="mV",
    temperatures="Thermistor {n} (C)", soc="Pack SOC (%)",
)  # fmt: skip

DBC = """
VERSION ""
BU_: BMS
BO_ 256 Pack: 8 BMS
 SG_ PackCurrent : 0|16@1- (0.1,0) [0|0] "A" BMS
 SG_ PackSOC : 16|8@1+ (0.5,0) [0|0] "%" BMS
BO_ 257 Cells: 8 BMS
 SG_ CellID : 0|8@1+ (1,0) [0|0] "" BMS
 SG_ CellVoltage : 8|16@1+ (0.0001,0) [0|0] "V" BMS
BO_ 2566869221 Temps: 8 BMS
 SG_ Temp1 : 0|8@1+ (1,-40) [0|0] "C" BMS
 SG_ Temp2 : 8|8@1+ (1,-40) [0|0] "C" BMS
"""


def pipeline(battery: LoadedBattery) -> Pipeline:
    return PipelineFactory("coulomb", None, battery).pipeline("replay")


def millivolts(row: int, cell: int) -> int:
    return 3600 + cell + row % 5


@pytest.fixture(scope="module")
def csv(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """6 s of 40 cells and 10 sensors at 10 Hz, with a preamble, decimal points and a hole in one cell."""
    path = tmp_path_factory.mktemp("logs") / "orion log.csv"
    names = ["Time", "Pack Current (A)", "Pack SOC (%)"]
    names += [f"Cell {i + 1} (mV)" for i in range(N)] + [f"Thermistor {i + 1} (C)" for i in range(10)]
    lines = ["Some BMS log v3", ",".join(names)]
    for row in range(ROWS):
        values = [f"{START_S + row / 10:.1f}", f"{-25.5 + row % 3}", "80"]
        values += ["" if i == 7 and row == 5 else str(millivolts(row, i)) for i in range(N)]
        values += [str(20 + i) for i in range(10)]
        lines.append(",".join(values))
    path.write_text("\n".join(lines))
    return path


@pytest.fixture(scope="module")
def imported(csv: Path, tmp_path_factory: pytest.TempPathFactory) -> ImportedSession:
    """It as a session, for tests that only read."""
    return import_file(csv, ORION, tmp_path_factory.mktemp("sessions"), pipeline)


def test_a_csv_of_another_system_becomes_a_session_with_estimates(csv: Path, tmp_path: Path) -> None:
    done = import_file(csv, ORION, tmp_path / "sessions", pipeline, name="their run")
    assert (done.rows, done.cells) == (ROWS, N)
    assert "10 temperatures for 40 cells" in " ".join(map(render, done.notes))
    with SessionFile(done.info.path) as session:
        info = session.info
        assert (info.name, info.frames, info.is_closed) == ("their run", 0, True)
        assert session.battery.segments == (N,)
        assert (info.started_wall_ns / 1e9, info.duration_s) == pytest.approx((START_S, (ROWS - 1) / 10))
        names = ["v[0]", "v[39]", "v[7]", "i_fs", "t[3]", "t[39]", "soc", "v_min", "v_min_id"]
        found = session.series([*names, "estimate.soc[0]"])
        assert found["v[0]"].minimum == pytest.approx([millivolts(row, 0) / 1000 for row in range(ROWS)])
        assert found["v[39]"].maximum[ROWS - 1] == pytest.approx(millivolts(ROWS - 1, 39) / 1000)
        assert np.flatnonzero(np.isnan(found["v[7]"].minimum)).tolist() == [5]
        assert found["i_fs"].minimum[:3] == pytest.approx([25.5, 24.5, 23.5])
        assert (found["t[3]"].minimum[0], found["t[39]"].minimum[0]) == (20, 29)
        assert found["soc"].minimum == pytest.approx(np.full(ROWS, 0.8))
        assert found["v_min"].minimum[0] == pytest.approx(3.6)
        assert (np.diff(found["estimate.soc[0]"].minimum) <= 0).all()
        assert session.problems() == []


@pytest.fixture(scope="module")
def means(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive of two cells with 3 mohm, a row a second: the mean current over it and the voltages at its end."""
    rng = np.random.default_rng(4)
    amps = np.repeat(rng.uniform(-15.0, 75.0, 400), rng.integers(8, 30, 400))[:6000].reshape(-1, 10)
    volts = 3.8 - 0.003 * amps[:, -1] + 5e-4 * rng.normal(size=len(amps))
    rows = zip(range(len(amps)), amps.mean(axis=1), volts, volts, strict=True)
    path = tmp_path_factory.mktemp("logs") / "means.csv"
    path.write_text("\n".join(["t,I,U1,U2", *(f"{t},{i:.3f},{u:.5f},{w:.5f}" for t, i, u, w in rows)]))
    return path


def off_v(path: Path, folder: Path, choice: str) -> tuple[float, str, FloatArray]:
    """Return the rms of innovations of an import, its notes, and the voltage that its session keeps of a cell."""
    profile = ImportMapping(time="t", current="I", voltages="U{n}", current_means=choice)
    innovations: list[float] = []

    def watched(battery: LoadedBattery) -> Pipeline:
        made = PipelineFactory("fused", None, battery).pipeline("replay", predicts=False)
        feed = made.feed

        def see(item: Item, *, publishes: bool = True) -> Output:
            output = feed(item, publishes=publishes)
            if output.estimates is not None:
                innovations.append(float(output.estimates.innovation_v[0]))
            return output

        made.feed = see  # type: ignore[method-assign]
        return made

    done = import_file(path, profile, folder, watched)
    with SessionFile(done.info.path) as session:
        kept = session.series(["v[0]"])["v[0]"].minimum
    return float(np.sqrt(np.mean(np.square(innovations[60:])))), " ".join(map(render, done.notes)), kept


def test_means_of_a_second_are_seen_in_the_data_or_set_and_the_session_keeps_what_was_recorded(
    means: Path, tmp_path: Path
) -> None:
    recorded = np.loadtxt(means, delimiter=",", skiprows=1)[:, 2]
    by_data, noted, kept = off_v(means, tmp_path, "auto")
    as_set, _, _ = off_v(means, tmp_path, "yes")
    as_instants, silent, _ = off_v(means, tmp_path, "no")
    assert by_data == as_set < 0.8 * as_instants
    assert "means over each row" in noted
    assert "means over each row" not in silent
    np.testing.assert_allclose(kept, recorded, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "names"),
    [
        ("csv", "index"),
        ("csv", "number"),
        ("parquet", "index"),
        ("parquet", "pack"),
        ("mf4", "index"),
        ("mf4", "pack"),
        ("mcap", "index"),
        ("ld", "index"),
        ("ld", "number"),
    ],
)
def test_what_is_exported_comes_back_the_same(
    imported: ImportedSession, tmp_path: Path, name: str, names: Names
) -> None:
    signals = ["i_fs", "soc", *(f"v[{i}]" for i in range(N)), *(f"t[{i}]" for i in range(N))]
    with SessionFile(imported.info.path) as session:
        export(session, tmp_path / f"own.{name}", name, names=names)
        first = session.series(signals)
    again = import_file(
        tmp_path / f"own.{name}", guess(read_table(tmp_path / f"own.{name}")), tmp_path / "sessions", pipeline
    )
    with SessionFile(again.info.path) as session:
        second = session.series(signals)
    later_s = (again.info.started_wall_ns - imported.info.started_wall_ns) / 1e9
    assert abs(later_s) <= (1.0 if name == "ld" else 2e-3)  # .ld tells its start in whole seconds
    for signal in signals:
        assert second[signal].time_s == pytest.approx(first[signal].time_s + later_s, abs=2e-3)
        assert second[signal].minimum == pytest.approx(first[signal].minimum, abs=1e-3, nan_ok=True)


def test_a_parquet_file_says_the_same_as_the_csv(csv: Path, imported: ImportedSession, tmp_path: Path) -> None:
    table = read_table(csv)
    path = tmp_path / "log.parquet"
    parquet.write_table(pyarrow.table({name: pyarrow.array(v) for name, v in table.columns.items()}), path)
    done = import_file(path, ORION, tmp_path / "sessions", pipeline)
    with SessionFile(imported.info.path) as first, SessionFile(done.info.path) as second:
        rows = [[item.numbers for item in each.measurements()] for each in (first, second)]
        np.testing.assert_array_equal(*rows)


def log_of(path: Path) -> Path:
    """20 s of a bus: current 10 times a second, a cell 20 times, temperatures once until they stop at 10 s."""
    database = cantools.database.load_string(DBC, "dbc")
    frames = []
    for step in range(400):
        at_s = START_S + step / 20
        cell = step % 20
        frames.append((at_s, "Cells", {"CellID": cell, "CellVoltage": 3.6 + cell / 1000}))
        if step % 2 == 0:
            frames.append((at_s, "Pack", {"PackCurrent": 12.3, "PackSOC": 55.0}))
        if step % 20 == 0 and step < 200:
            frames.append((at_s, "Temps", {"Temp1": 31, "Temp2": 33}))
    with can.Logger(path) as logger:
        for at_s, name, values in frames:
            message = database.get_message_by_name(name)
            logger.on_message_received(
                can.Message(
                    timestamp=at_s, arbitration_id=message.frame_id, is_extended_id=message.is_extended_frame,
                    data=message.encode(values, padding=True, strict=False), channel=0,
                )
            )  # fmt: skip
    return path


@pytest.mark.parametrize("ending", ["log", "blf", "asc"])
def test_a_can_log_with_a_dbc_becomes_a_session(tmp_path: Path, ending: str) -> None:
    dbc = tmp_path / "bus.dbc"
    dbc.write_text(DBC)
    profile = ImportMapping(
        current="PackCurrent", voltages="CellVoltage[CellID]", temperatures="Temp{n}", soc="PackSOC", hold_s=2.0
    )
    log = log_of(tmp_path / f"bus.{ending}")
    done = import_file(log, profile, tmp_path / "sessions", pipeline, dbc=dbc)
    assert (done.rows, done.cells) == (200, 20)
    with SessionFile(done.info.path) as session:
        found = session.series(["v[19]", "i_fs", "t[0]", "soc"])
        assert np.nanmin(found["v[19]"].minimum) == pytest.approx(3.619)
        assert np.isnan(found["v[19]"].minimum[:9]).all()
        assert found["i_fs"].minimum == pytest.approx(np.full(200, 12.3))
        assert found["soc"].minimum == pytest.approx(np.full(200, 0.55))
        assert found["t[0]"].maximum[0] == 31
        known = np.isfinite(found["t[0]"].maximum)
        assert found["t[0]"].time_s[known][-1] == pytest.approx(START_S + 11, abs=0.11)
        assert session.info.can_frames == 610


def test_a_can_log_without_a_dbc_is_of_our_own_master(tmp_path: Path) -> None:
    path = tmp_path / "candump.log"
    with can.Logger(path) as logger:
        for step in range(50):
            logger.on_message_received(
                can.Message(timestamp=START_S + step / 10, arbitration_id=0x100, is_extended_id=False,
                            data=bytes.fromhex("281e9087e8030000"), channel="can0")
            )  # fmt: skip
    done = import_file(path, ImportMapping(), tmp_path / "sessions", pipeline)
    with SessionFile(done.info.path) as session:
        assert session.info.can_frames == 50
        assert "i_fs" in session.signal_names()


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"current": "Amps"}, "current = 'Amps': no such column; available: 'Time'"),
        ({"voltages": "Zelle {n}"}, "no column fits"),
        ({"voltages": ""}, "voltages is not named"),
        ({"voltage_unit": "V"}, "voltage_unit = V: no cell voltage is within"),
        ({"time_unit": "h"}, "is the unit of time right"),
    ],
)
def test_what_does_not_fit_is_named_and_leaves_nothing(csv, tmp_path, change, reason):
    with pytest.raises(ImportFailed, match=reason):
        import_file(csv, replace(ORION, **change), tmp_path / "sessions", pipeline)
    assert not list((tmp_path / "sessions").glob("*"))


def test_more_cells_than_a_battery_may_have_are_refused(tmp_path):
    path = tmp_path / "big.csv"
    path.write_text("t,I," + ",".join(f"C{i}" for i in range(1001)) + "\n0,1," + ",".join(["3.7"] * 1001))
    with pytest.raises(ImportFailed, match="1001 cells, maximum 1000"):
        import_file(path, ImportMapping(time="t", current="I", voltages="C{n}"), tmp_path / "sessions", pipeline)


def test_rows_that_come_too_quickly_are_left_out_and_counted(csv, tmp_path):
    done = import_file(csv, replace(ORION, max_rate_hz=2.0), tmp_path / "sessions", pipeline)
    assert done.rows == ROWS // 5
    assert f"{ROWS - ROWS // 5} of {ROWS} rows left out" in " ".join(map(render, done.notes))
