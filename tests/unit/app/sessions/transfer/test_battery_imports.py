"""Logs of other teams' batteries as sessions: what is read is what cantools decodes."""

import sqlite3
from collections import defaultdict
from contextlib import closing
from pathlib import Path

import cantools
import numpy as np
import pytest

from app.errors import ImportFailed
from app.live.pipeline import Pipeline
from app.live.pipeline_factory import PipelineFactory
from app.sessions.catalogue import Catalogue
from app.sessions.errors import NotASession
from app.sessions.reading.reader import SessionFile
from app.sessions.transfer.import_session import ImportedSession, import_file
from app.sources.loaded_battery import LoadedBattery, load_battery
from app.sources.recordings.import_mapping import ImportMapping
from app.words import render
from firmware_protocol.memory_map import CAN_ID_EXTENDED
from tests.peer_batteries import PEERS, cell_number, one_signal_a_cell, segments_in_fd_frames
from tests.peer_messages import Peer
from tests.recorded.mf4 import write_mf4
from tests.recorded.peer_sessions import START_S, write_log, write_profile

DURATION_S = 8.0  # a round of the slowest, which tells 10 cells a second
OF_OTHERS_S = 2.5
OF_FRAMES_S = 2.0  # where only the frames are compared


def pipeline(battery: LoadedBattery) -> Pipeline:
    return PipelineFactory("coulomb", None, battery).pipeline("replay", "imported", "imported")


def test_an_import_tells_how_far_it_is_from_the_first_line_to_the_last_frame(tmp_path: Path) -> None:
    peer, told = cell_number(), []
    battery = load_battery(str(write_profile(peer, tmp_path)))
    log = write_log(peer, tmp_path / "peer.log", DURATION_S)
    folder = tmp_path / "sessions"
    import_file(
        log, ImportMapping(), folder, pipeline, battery=battery, on_progress=lambda done, of: told.append(done / of)
    )
    assert told == sorted(told)
    assert 0.0 < told[0] < 0.2
    assert told[-1] == 1.0


def test_an_import_that_does_not_look_ahead_writes_the_same_session(tmp_path: Path) -> None:
    peer = cell_number()
    battery = load_battery(str(write_profile(peer, tmp_path)))
    log = write_log(peer, tmp_path / "peer.log", DURATION_S)
    written = []
    for predicts in (True, False):
        factory = PipelineFactory("fused", None, battery)
        made = import_file(
            log,
            ImportMapping(),
            tmp_path / "sessions",
            lambda _, of=factory, ahead=predicts: of.pipeline("replay", "imported", "imported", predicts=ahead),
            battery=battery,
        )
        with closing(sqlite3.connect(made.info.path)) as session:
            tables = ("can_frames", "events", "chunks", "tracks", "columns")
            written.append([session.execute(f"SELECT * FROM {table}").fetchall() for table in tables])
    assert written[0] == written[1]
    assert written[0][2], "the cells were estimated"


def test_sensors_that_are_not_connected_are_counted(tmp_path: Path) -> None:
    peer = one_signal_a_cell(8, 4, "Voltage_Cell_{:02d}", "Temp_Sensor_{:02d}", 0.001, "V")
    peer.temperature = lambda sensor, t: -40.0 if sensor == 1 else 25.0
    done = imported(peer, tmp_path)
    (note,) = [note for note in done.notes if note.code == "absent-sensors"]
    with SessionFile(done.info.path) as session:
        assert note.args["values"] == sum(frame.can_id == 0x280 for frame in session.can_frames())


def test_two_buses_of_a_log_are_never_imported_as_one(tmp_path: Path) -> None:
    peer = cell_number()
    battery = load_battery(str(write_profile(peer, tmp_path)))
    log = write_log(peer, tmp_path / "peer.log", DURATION_S)
    lines = log.read_text().splitlines()
    others = [line.replace(" can0 ", " can1 ")[:-2] + "00" for line in lines]
    log.write_text("\n".join(line for both in zip(lines, others, strict=True) for line in both) + "\n")
    with pytest.raises(ImportFailed, match="can0, can1"):
        import_file(log, ImportMapping(), tmp_path / "sessions", pipeline, battery=battery)
    done = import_file(log, ImportMapping(bus="can0"), tmp_path / "sessions", pipeline, battery=battery)
    assert done.rows == len(lines)


def imported(peer: Peer, folder: Path, ending: str = "log", duration_s: float = DURATION_S) -> ImportedSession:
    battery = load_battery(str(write_profile(peer, folder)))
    log = write_log(peer, folder / f"peer.{ending}", duration_s)
    return import_file(log, ImportMapping(), folder / "sessions", pipeline, battery=battery)


def by_cantools(peer: Peer, duration_s: float) -> dict[str, list[tuple[float, float]]]:
    """Every value of every signal that cantools decodes, with its time."""
    database = cantools.database.load_string(peer.dbc(), "dbc", strict=False)
    ids = {m.frame_id | (CAN_ID_EXTENDED if m.is_extended_frame else 0): m for m in database.messages}
    found: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for t_ns, can_id, data in peer.frames(duration_s):
        for name, value in ids[can_id].decode(data, decode_choices=False).items():
            found[name].append((START_S + t_ns / 1e9, float(value)))
    return found


@pytest.mark.parametrize("make", PEERS, ids=[make().name for make in PEERS])
def test_every_cell_of_every_way_to_address_cells_is_in_the_session(make, tmp_path: Path) -> None:
    peer = make()
    duration_s = DURATION_S if make is cell_number else OF_OTHERS_S
    done = imported(peer, tmp_path, duration_s=duration_s)
    assert (done.cells, done.notes) == (peer.n_cells, ())
    with SessionFile(done.info.path) as session:
        assert session.battery.n_cells == peer.n_cells
        assert session.info.can_frames == len(peer.frames(duration_s))
        samples = session.samples([session.signals.find(f"v[{i}]") for i in range(peer.n_cells)])
        for cell, found in enumerate(samples):
            times_s = (found.track.times_us - session.info.started_mono_ns // 1000) / 1e6
            first_s = peer.frames(0.5)[0][0] / 1e9
            near = [[peer.voltage(cell, t + first_s + us * 1e-6) for us in (-2, 2)] for t in times_s]  # at a step both
            assert np.abs(np.array(near) - found.counts[:, None]).min(axis=1).max() < 0.51 * peer.resolution_v + 1e-5
        rows = [block["v"].values for block in session.fields(["v"])]
        assert np.isfinite(np.concatenate(rows)[-1]).all()


def test_values_are_those_of_cantools_to_the_last_bit(tmp_path: Path) -> None:
    peer = segments_in_fd_frames()
    done = imported(peer, tmp_path, duration_s=OF_FRAMES_S)
    with SessionFile(done.info.path) as session:
        expected = by_cantools(peer, OF_FRAMES_S)
        for cell in (0, 27, 28, 139):
            name = f"Seg{'ABCDE'[cell // 28]}_Cell{cell % 28 + 1}"
            (found,) = session.samples([session.signals.find(f"v[{cell}]")])
            assert found.counts.tolist() == [value for _, value in expected[name]]
        (current,) = session.samples([session.signals.find("i_fs")])
        assert current.counts.tolist() == [-value for _, value in expected["TS_Current"]]
        (heat,) = session.samples([session.signals.find("t[139]")])
        assert heat.counts.tolist() == [value for _, value in expected["SegE_Temp28"]]


@pytest.mark.parametrize("ending", ["log", "asc", "blf", "trc"])
def test_logs_of_all_tools_say_the_same(tmp_path: Path, ending: str) -> None:
    peer = cell_number()
    done = imported(peer, tmp_path, ending, OF_FRAMES_S)
    with SessionFile(done.info.path) as session:
        frames = [(frame.can_id, frame.data) for frame in session.can_frames()]
        assert frames == [(can_id, data) for _, can_id, data in peer.frames(OF_FRAMES_S)]


@pytest.mark.parametrize("make", [cell_number, segments_in_fd_frames])
def test_bus_logging_in_mf4_says_the_same(tmp_path: Path, make) -> None:
    peer = make()
    frames = peer.frames(OF_FRAMES_S)
    log = write_mf4(tmp_path / "peer.mf4", [(t_ns / 1e9, can_id, data) for t_ns, can_id, data in frames])
    battery = load_battery(str(write_profile(peer, tmp_path)))
    done = import_file(log, ImportMapping(), tmp_path / "sessions", pipeline, battery=battery)
    with SessionFile(done.info.path) as session:
        assert [(frame.can_id, frame.data) for frame in session.can_frames()] == [
            (each, data) for _, each, data in frames
        ]
        assert session.info.started_wall_ns / 1e9 == pytest.approx(START_S + frames[0][0] / 1e9, abs=0.2)


def test_all_is_estimated_and_closed(tmp_path: Path) -> None:
    done = imported(segments_in_fd_frames(), tmp_path)
    with SessionFile(done.info.path) as session:
        assert session.info.is_closed
        assert session.problems() == []
        estimates = list(session.estimates())
        assert len(estimates) > 50
        assert estimates[-1][2].shape == (140,)
        assert np.isfinite(estimates[-1][2]).all()
        assert session.cell_file is not None


def test_a_log_of_another_bus_is_refused_and_leaves_nothing(tmp_path: Path) -> None:
    battery = load_battery(str(write_profile(segments_in_fd_frames(), tmp_path)))
    log = write_log(cell_number(), tmp_path / "other.log", 1.0)
    with pytest.raises(ImportFailed, match=r"no frame contains a cell voltage of 1: FD"):
        import_file(log, ImportMapping(), tmp_path / "sessions", pipeline, battery=battery)
    assert not list((tmp_path / "sessions").glob("*"))


def test_an_empty_log_is_refused_as_one_without_frames(tmp_path: Path) -> None:
    (tmp_path / "empty.log").write_bytes(b"")
    with pytest.raises(ImportFailed, match=r"^empty\.log: .*frame"):
        import_file(tmp_path / "empty.log", ImportMapping(), tmp_path / "sessions", pipeline)


def test_cells_that_were_never_heard_are_counted(tmp_path: Path) -> None:
    done = imported(cell_number(), tmp_path, duration_s=3.05)
    assert done.cells == 30
    assert [render(note) for note in done.notes] == ["42 of 72 cells were never received"]


def test_a_cell_test_is_a_battery_of_one_cell(tmp_path: Path) -> None:
    path = tmp_path / "cell.csv"
    lines = [f"{k / 10},{1.23456789 + k % 3},{3.70001234 + k * 1e-6},{25.125}" for k in range(100)]
    path.write_text("\n".join(["t,I,U 1,T 1", *lines]))
    profile = ImportMapping(time="t", current="I", voltages="U {n}", temperatures="T {n}")
    done = import_file(path, profile, tmp_path / "sessions", pipeline)
    with SessionFile(done.info.path) as session:
        assert session.battery.segments == (1,)
        voltage, current, heat = session.samples([session.signals.find(name) for name in ("v[0]", "i_fs", "t[0]")])
        assert voltage.counts.tolist() == [3.70001234 + k * 1e-6 for k in range(100)]
        assert current.counts.tolist() == [1.23456789 + k % 3 for k in range(100)]
        assert set(heat.counts.tolist()) == {25.125}


def test_a_table_has_the_shape_of_the_battery_that_is_named(tmp_path: Path) -> None:
    path = tmp_path / "pack.csv"
    names = ",".join(f"U{i}" for i in range(72))
    path.write_text(f"t,I,{names}\n" + "".join(f"{k},5,{','.join(['3.7'] * 72)}\n" for k in range(20)))
    profile = ImportMapping(time="t", current="I", voltages="U{n}")
    orion = load_battery("orion-bms-2")
    done = import_file(path, profile, tmp_path / "sessions", pipeline, battery=orion)
    with SessionFile(done.info.path) as session:
        assert session.battery.segments == (12,) * 6
    with pytest.raises(ImportFailed, match="the file has 72 cells, the battery 216"):
        import_file(path, profile, tmp_path / "sessions", pipeline, battery=load_battery("foxbms-2"))


def test_a_session_whose_profile_cannot_be_understood_is_listed_and_says_why_it_cannot_be_opened(
    tmp_path: Path,
) -> None:
    done = imported(cell_number(), tmp_path, duration_s=1.0)
    with closing(sqlite3.connect(done.info.path, isolation_level=None)) as connection:
        connection.execute("UPDATE battery_files SET data = ? WHERE id = 1", (b"[battery]",))
    with pytest.raises(NotASession, match=r"battery\.segments|battery\.name"):
        SessionFile(done.info.path)
    assert [info.id for info in Catalogue(tmp_path / "sessions").list()] == [done.info.id]
