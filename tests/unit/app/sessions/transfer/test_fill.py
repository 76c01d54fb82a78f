"""The pit's recording of a run with a bad radio, filled from the recorder in the car, whose clocks are others."""

import csv
import random
import shutil
import struct
from pathlib import Path

import mcap.reader
import numpy as np
import pytest
from pyarrow import parquet

from app.errors import NotNow
from app.sessions.export.export import export
from app.sessions.reading.reader import SessionFile
from app.sessions.reading.session_info import write_note
from app.sessions.recording.recorder import Recorder
from app.sessions.transfer.fill import FILLED_LINK, CanOnlySession, NoOverlap, fill_gaps
from tests.fake_clock import FunctionClock
from tests.unit.app.sessions.conftest import Stream

PIT_MONO_NS, PIT_WALL_NS = 900 * 10**9, 1_790_000_000 * 10**9
CAR_MONO_NS, CAR_WALL_NS = 77 * 10**9, 86_400 * 10**9  # a machine without a real-time clock
LATENCY_NS = 40_000_000
LENGTH = 900


def recorder_at(folder: Path, mono_ns: int, wall_ns: int) -> Recorder:
    clock = iter(range(10**9))
    return Recorder(
        folder,
        FunctionClock(lambda: mono_ns + (0 if next(clock) == 0 else 95 * 10**9), lambda: wall_ns),
        version="1",
        free_bytes=lambda _: 1 << 40,
    )


def record(folder, stream, received, mono_ns, wall_ns, *, jitter=lambda: 0, extra=b"") -> Path:
    """A session of the frames whose numbers are in `received`, each with an estimate, and a CAN frame every second."""
    recorder = recorder_at(folder, mono_ns, wall_ns)
    info = recorder.start("endurance", {"driver": "Anna"})
    for step in range(LENGTH):
        at_ns = step * 100_000_000
        uptime_ms = stream.uptime_ms
        _, _, raw = stream.next()
        if step in received:
            t_ns = mono_ns + at_ns + jitter()
            recorder.frame(t_ns, wall_ns + at_ns, 0, raw + extra, not extra)
            recorder.estimates(t_ns, uptime_ms, np.full(96, 0.9 - step * 1e-4), np.full(96, 0.02))
            if step % 10 == 0:
                recorder.can_frame(t_ns, wall_ns + at_ns, 0x100, bytes([step % 256]))
        if step % 300 == 299:
            recorder.flush()
    recorder.marker(mono_ns + 10**9, wall_ns + 10**9, "first lap", kind="lap")
    recorder.config(mono_ns, wall_ns, bytes(420), "in force")
    recorder.close()
    return info.path


@pytest.fixture(scope="module")
def recorded_run(tmp_path_factory):
    """Two recordings of 90 s: the pit's lacks the end, two holes and single frames."""
    folder = tmp_path_factory.mktemp("run")
    rng = random.Random(1)
    lost = {*range(200, 300), *range(650, 660), *range(870, 900), *rng.sample(range(301, 600, 10), 20)}
    jitter = random.Random(2)
    pit = record(
        folder / "pit", Stream(), set(range(LENGTH)) - lost, PIT_MONO_NS, PIT_WALL_NS,
        jitter=lambda: LATENCY_NS + jitter.randrange(5_000_000),
    )  # fmt: skip
    car = record(folder / "car", Stream(), set(range(LENGTH)), CAR_MONO_NS, CAR_WALL_NS)
    return pit, car, lost


@pytest.fixture
def run(recorded_run, tmp_path):
    """Both recordings, in files of this test's own."""
    pit, car, lost = recorded_run
    own = [Path(shutil.copytree(path.parent, tmp_path / path.parent.name)) / path.name for path in (pit, car)]
    return (*own, lost)


def test_every_frame_that_was_lost_is_in_its_place_and_marked(run):
    pit, car, lost = run
    with SessionFile(pit) as session:
        before = [frame.raw for frame in session.frames()]
    filled = fill_gaps(pit, car, t_wall_ns=1)
    assert filled.frames == len(lost)
    with SessionFile(pit) as session, SessionFile(car) as source:
        frames = list(session.frames())
        assert [frame.raw for frame in frames] == [frame.raw for frame in source.frames()]
        assert [i for i, frame in enumerate(frames) if frame.link == FILLED_LINK] == sorted(lost)
        assert [frame.raw for frame in frames if frame.link == 0] == before
        times = np.array([frame.t_mono_ns for frame in frames])
        assert (np.diff(times) > 0).all()
        assert times - PIT_MONO_NS == pytest.approx(np.arange(LENGTH) * 1e8 + LATENCY_NS, abs=5_500_000)
        assert session.problems() == []


def test_signals_estimates_and_can_of_the_gaps_are_there(run):
    pit, car, _ = run
    filled = fill_gaps(pit, car, t_wall_ns=1)
    with SessionFile(pit) as session, SessionFile(car) as source:
        names = ["v[36]", "i_fs", "estimate.soc[5]"]
        mine, theirs = session.series(names), source.series(names)
        for name in names:
            assert mine[name].gaps == ()
            assert mine[name].minimum == pytest.approx(theirs[name].minimum)
        assert [each[1] for each in session.estimates()] == [each[1] for each in source.estimates()]
        assert [frame.data for frame in session.can_frames()] == [frame.data for frame in source.can_frames()]
        spans = session.filled()
    assert filled.can_frames == 14
    start_s = PIT_WALL_NS / 1e9
    assert (spans[0][0] - start_s, spans[0][1] - start_s) == pytest.approx((20.04, 29.94), abs=0.01)
    assert filled.seconds == pytest.approx(9.9 + 0.9 + 2.9, abs=0.05)


def test_all_else_of_the_session_stays_and_a_second_time_changes_nothing(run):
    pit, car, _ = run
    write_note(pit, "laps", [1, 2], t_wall_ns=5, who="anna")
    with SessionFile(pit) as session:
        before = (
            session.info.id,
            session.info.name,
            session.info.started_wall_ns,
            session.markers(),
            session.configs(),
        )
    fill_gaps(pit, car, t_wall_ns=1)
    with SessionFile(pit) as session:
        info = session.info
        assert (info.id, info.name, info.started_wall_ns, session.markers(), session.configs()) == before
        assert info.is_closed
        assert info.metadata["driver"] == "Anna"
        assert session.note("laps") == [1, 2]
        (event,) = session.events()
        assert (event["code"], event["unit"]) == ("gaps-filled", "s")
    assert fill_gaps(pit, car, t_wall_ns=1).frames == 0
    assert [path.name for path in pit.parent.iterdir()] == [pit.name]


def test_sessions_of_different_runs_are_not_mixed(run, tmp_path, stream):
    pit, _, _ = run
    stream.uptime_ms = 10_000_000
    other = record(tmp_path / "other", stream, set(range(50)), CAR_MONO_NS, CAR_WALL_NS)
    content = pit.read_bytes()
    with pytest.raises(NoOverlap, match="not the same run"):
        fill_gaps(pit, other, t_wall_ns=1)
    assert pit.read_bytes() == content


def test_a_session_that_is_recorded_is_left_alone(run, tmp_path, recorder, stream):
    _, car, _ = run
    info = recorder.start()
    stream.feed(recorder, 5)
    recorder.flush()
    with pytest.raises(NotNow):
        fill_gaps(info.path, car, t_wall_ns=1)


def test_a_session_that_was_cut_off_stays_one(run, tmp_path, stream):
    pit, car, _ = run
    with SessionFile(pit) as session:
        frames = list(session.frames())
    recorder = recorder_at(tmp_path / "cut", PIT_MONO_NS, PIT_WALL_NS)
    info = recorder.start()
    for frame in frames[:400]:
        recorder.frame(frame.t_mono_ns, frame.t_wall_ns, 0, frame.raw, True)
    recorder.flush()
    cut = tmp_path / "cut.sqlite"
    with SessionFile(info.path) as session:
        session.copy_to(cut)
    recorder.close()
    assert fill_gaps(cut, car, t_wall_ns=1).frames >= 100
    with SessionFile(cut) as session:
        assert not session.info.is_closed
        assert session.series(["i_fs"])["i_fs"].gaps == ()


def test_a_session_heard_on_can_alone_is_refused_with_the_reason(run, tmp_path):
    _, car, _ = run
    recorder = recorder_at(tmp_path / "can", PIT_MONO_NS, PIT_WALL_NS)
    info = recorder.start()
    for step in range(20):
        recorder.can_frame(PIT_MONO_NS + step * 10**8, PIT_WALL_NS + step * 10**8, 0x100, bytes([step]))
    recorder.close()
    for pair in ((info.path, car), (car, info.path)):
        with pytest.raises(CanOnlySession, match=f"{info.id} was recorded from CAN only"):
            fill_gaps(*pair, t_wall_ns=1)


@pytest.mark.parametrize("name", ["csv", "parquet", "mcap", "ld"])
def test_exports_mark_what_was_filled(run, tmp_path, name):
    pit, car, lost = run
    out = tmp_path / f"out.{name}"
    with SessionFile(pit) as session:
        export(session, out, name, signals=["v[3]"])
    before = out.read_bytes()
    assert b"filled" not in before
    fill_gaps(pit, car, t_wall_ns=1)
    with SessionFile(pit) as session:
        export(session, out, name, signals=["v[3]"])
        started_s = session.info.started_wall_ns / 1e9
    in_gaps = {n for n in lost if not 300 < n < 600}  # single frames are no gap
    at_edges = 6 if name == "ld" else 0  # its rows are on a grid of their own
    assert len(in_gaps ^ set(filled_rows(out, name, started_s))) <= at_edges


def filled_rows(path, name, started_s):
    """Numbers of the frames that a file says came from elsewhere, by their time."""
    if name == "csv":
        with path.open(newline="") as file:
            times = [float(row["elapsed_s"]) for row in csv.DictReader(file) if row["filled"] == "1"]
    elif name == "parquet":
        table = parquet.read_table(path)
        times = [row["elapsed_s"] for row in table.select(["elapsed_s", "filled"]).to_pylist() if row["filled"]]
    elif name == "mcap":
        with path.open("rb") as file:
            found = mcap.reader.make_reader(file).iter_messages(topics=["/filled"])
            is_one = b"\x09" + struct.pack("<d", 1.0)  # Protobuf: field 1 is a double
            times = [m.log_time / 1e9 - started_s for _, _, m in found if bytes(m.data).startswith(is_one)]
    else:
        content = path.read_bytes()
        second = struct.unpack_from("<4I", content, 11336 + 124)  # the last channel's header: chain, data, samples
        values = np.frombuffer(content, "<f4", second[3], second[2])
        times = (np.flatnonzero(values == 1) / 10).tolist()
    return [round(t * 10) for t in times]
