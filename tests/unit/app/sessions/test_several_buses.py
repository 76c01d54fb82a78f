"""Sessions of versions that read several buses and other sources of one battery: they open, and replay one bus."""

from collections.abc import Iterable
from pathlib import Path

import pytest

from app.live.pipeline_factory import PipelineFactory
from app.sessions.export.can_log import write_asc, write_candump
from app.sessions.export.table import SignalTable
from app.sessions.info import SessionInfo
from app.sessions.reading.reader import SessionFile
from app.sessions.recording.recorder import Recorder
from app.sessions.replay import item_of, prepare
from app.sources.loaded_battery import LoadedBattery, battery_from_files, load_battery
from app.telemetry import Snapshot
from tests.fake_clock import FunctionClock
from tests.peer_batteries import one_signal_a_cell
from tests.recorded.peer_sessions import write_profile

WALL_NS = 10**18
PEER = one_signal_a_cell(8, 0, "V{}", "T{}", 0.0001, "V")
WITNESS = b"""
[[witness]]
name = "second"
bus = 1
dbc = "second.dbc"
[witness.current]
signal = "Pack_Current"
"""


def recorded_before(folder: Path, buses: Iterable[int]) -> tuple[SessionInfo, LoadedBattery]:
    """A session as such a version wrote it: the number of the bus in bits 29 and 30 of the id."""
    (folder / "second.dbc").write_text(PEER.dbc())
    profile = write_profile(PEER, folder)
    files = dict(load_battery(str(profile)).files)
    battery = battery_from_files(files | {profile.name: files[profile.name] + WITNESS, "second.dbc": b"no DBC"})
    recorder = Recorder(folder / "sessions", FunctionClock(lambda: 0, lambda: WALL_NS), version="0", battery=battery)
    info = recorder.start()
    for t_ns, can_id, data in PEER.frames(6):
        for bus in buses:
            recorder.can_frame(t_ns + 1000 * bus, WALL_NS + t_ns, can_id | bus << 29, data if bus == 0 else bytes(8))
    recorder.close()
    return info, battery


def replayed(session: SessionFile) -> Snapshot:
    pipeline = PipelineFactory("coulomb", None, session.loaded_battery).pipeline("replay", "rs232", "can")
    prepare(pipeline, session)
    outputs = [pipeline.feed(item_of(frame)) for frame in session.received()]  # type: ignore[arg-type]
    newest = next(output.snapshot for output in reversed(outputs) if output.snapshot is not None)
    assert newest is not None
    return newest


def test_another_source_of_the_battery_is_left_out_of_a_replay(tmp_path: Path) -> None:
    found = []
    for name, buses in (("one", (0,)), ("three", (0, 1, 3))):
        (tmp_path / name).mkdir()
        info, battery = recorded_before(tmp_path / name, buses)
        with SessionFile(info.path) as session:
            assert session.loaded_battery.files == battery.files
            assert WITNESS in next(iter(session.loaded_battery.files.values()))
            found.append(replayed(session))
            assert {frame.can_id for frame in session.can_frames()} == {each.can_id for each in PEER.sent}
    alone, among = found
    assert alone.accumulator == among.accumulator
    assert alone.links.can.frames == among.links.can.frames
    assert (alone.cells.voltage_v == among.cells.voltage_v).all()


@pytest.mark.parametrize(
    ("write", "word", "channels"), [(write_candump, 1, {"can0", "can1", "can3"}), (write_asc, 1, {"1", "2", "4"})]
)
def test_its_logs_have_a_channel_for_each_bus(write, word, channels, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    info, _ = recorded_before(tmp_path, (0, 1, 3))
    with SessionFile(info.path) as session:
        n_frames = sum(1 for _ in session.can_frames(all_buses=True))
        write(SignalTable(session, ["v[0]"]), tmp_path / "run.log")
    lines = [line.split() for line in (tmp_path / "run.log").read_text().splitlines() if " d " in line or "#" in line]
    assert len(lines) == n_frames == 3 * len(list(PEER.frames(6)))
    assert {line[word] for line in lines} == channels
