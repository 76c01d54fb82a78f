"""Sessions of schema 4 open as before: one of several buses, one of a table kept as frames with a DBC of its own."""

import hashlib
import lzma
from pathlib import Path

import numpy as np
import pytest

from app.live.pipeline_factory import PipelineFactory
from app.sessions.export.can_log import write_asc, write_candump
from app.sessions.export.export import export
from app.sessions.export.table import SignalTable
from app.sessions.reading.reader import SessionFile
from app.sessions.replay import item_of, prepare
from app.sessions.storage.database import SESSION, open_for_writing
from app.telemetry import Snapshot
from tests.peer_batteries import one_signal_a_cell

KEPT = Path(__file__).parents[3] / "recorded/schema_4"
PEER = one_signal_a_cell(8, 0, "V{}", "T{}", 0.0001, "V")
CSV = {  # SHA-256 of what the version that wrote them exports
    "several_buses": "7ca6547ce71d3089584a242be0b874c946df897d9f2f23fd62b24c89f03761d2",
    "table": "aa1f71eb1341dfadedf329f83de25c149deddef0473718bd6b63958620ab1d5a",
}


@pytest.fixture(params=[False, True], ids=["as it is", "brought up to date"])
def kept(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A folder with both."""
    for name in CSV:
        path = tmp_path / f"{name}.sqlite"
        path.write_bytes(lzma.decompress((KEPT / f"{name}.sqlite.xz").read_bytes()))
        if request.param:
            open_for_writing(path, SESSION).close()
    return tmp_path


def replayed(session: SessionFile) -> list[Snapshot]:
    pipeline = PipelineFactory("coulomb", None, session.loaded_battery).pipeline("replay", "rs232", "can")
    prepare(pipeline, session)
    outputs = [pipeline.feed(item_of(frame)) for frame in session.received()]  # type: ignore[arg-type]
    return [output.snapshot for output in outputs if output.snapshot is not None]


@pytest.mark.parametrize("name", CSV)
def test_it_is_sound_and_exports_the_same_bytes(kept: Path, name: str) -> None:
    with SessionFile(kept / f"{name}.sqlite") as session:
        assert session.problems() == []
        export(session, kept / "all.csv", "csv")
    assert hashlib.sha256((kept / "all.csv").read_bytes()).hexdigest() == CSV[name]


def test_the_frames_of_other_buses_are_apart(kept: Path) -> None:
    with SessionFile(kept / "several_buses.sqlite") as session:
        ids = {each.can_id for each in PEER.sent}
        assert {frame.can_id for frame in session.can_frames()} == ids
        assert {(frame.can_id, frame.bus) for frame in session.can_frames(all_buses=True)} == {
            (can_id, bus) for can_id in ids for bus in (0, 1, 3)
        }
        shown = replayed(session)
        assert 0 <= sum(1 for _ in session.can_frames()) - shown[-1].links.can.frames < len(ids)
        assert np.isfinite(shown[-1].cells.voltage_v).all()


@pytest.mark.parametrize(
    ("write", "channels"), [(write_candump, {"can0", "can1", "can3"}), (write_asc, {"1", "2", "4"})]
)
def test_its_logs_have_a_channel_for_each_bus(kept: Path, write, channels) -> None:  # type: ignore[no-untyped-def]
    with SessionFile(kept / "several_buses.sqlite") as session:
        n_frames = sum(1 for _ in session.can_frames(all_buses=True))
        write(SignalTable(session, ["v[0]"]), kept / "run.log")
    lines = [line.split() for line in (kept / "run.log").read_text().splitlines() if " d " in line or "#" in line]
    assert len(lines) == n_frames == 3 * len(list(PEER.frames(6)))
    assert {line[1] for line in lines} == channels


def test_frames_that_a_table_was_packed_in_are_replayed(kept: Path) -> None:
    with SessionFile(kept / "table.sqlite") as session:
        assert list(session.measurements()) == []
        (first,) = session.samples([session.signals.find("v[2]")])
        shown = replayed(session)
    assert len(shown) > 30
    assert {snapshot.cells.voltage_v[2] for snapshot in shown} <= set(first.counts)
