import sqlite3
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from app.sessions.errors import NotASession, SchemaTooNew, UnknownSignal
from app.sessions.reading.reader import SessionFile
from app.sessions.recording.recorder import Recorder
from firmware_protocol.framing import encode_frame
from firmware_protocol.memory_map import CONFIG_SIZE, FIELDS
from firmware_protocol.messages import Data, Window
from tests.unit.app.sessions.conftest import Stream, recorder_in

MONO_NS = 5_000 * 10**9
WALL_S = 1_790_000_000
NAMES = ["v[36]", "i_fs", "estimate.soc[95]"]


@pytest.fixture(scope="module", params=["unclosed", "closed", "long", "long unclosed"])
def recorded(request, tmp_path_factory) -> Iterator[tuple[Path, Stream]]:
    """Sessions with no chunk stored, one, and several; the unclosed ones with a part that is in no chunk."""
    recorder, stream = recorder_in(tmp_path_factory.mktemp("sessions")), Stream()
    info = recorder.start()
    for _ in range(4 if "long" in request.param else 1):
        stream.feed(recorder, 450)
        recorder.flush()
    if "unclosed" not in request.param:
        recorder.stop()
        recorder.flush()
    yield info.path, stream
    recorder.close()


def test_series_hold_every_sample_where_they_are_few(recorded) -> None:
    path, stream = recorded
    n = stream.count
    with SessionFile(path) as session:
        series = session.series(NAMES, points=5000)
    voltage = series["v[36]"]
    assert voltage.unit == "V"
    assert voltage.time_s == pytest.approx(WALL_S + 0.1 * np.arange(n))
    assert voltage.minimum == pytest.approx([each[36] * 1e-4 for each in stream.voltages])
    assert (voltage.minimum == voltage.maximum).all()
    assert series["i_fs"].maximum == pytest.approx([each * 0.01 for each in stream.currents])
    assert series["estimate.soc[95]"].minimum == pytest.approx(0.8 - 1e-4 * np.arange(1, n + 1), abs=1.1e-5)
    assert voltage.gaps == ()


def test_a_bucket_keeps_its_smallest_and_largest(recorded) -> None:
    path, stream = recorded
    with SessionFile(path) as session:
        current = session.series(["i_fs"], points=stream.count // 30)["i_fs"]
    assert len(current.time_s) == stream.count // 30
    assert current.maximum.max() == pytest.approx(50.09)
    assert current.minimum.min() == pytest.approx(-50.0)
    assert (current.maximum[1:-1] > 50).all()
    assert (current.minimum[1:-1] < -49).all()


def test_a_range_contains_both_its_ends(recorded) -> None:
    path, _ = recorded
    with SessionFile(path) as session:
        voltage = session.series(["v[0]"], WALL_S + 10, WALL_S + 20)["v[0]"]
        frames = list(session.frames(WALL_S + 10, WALL_S + 20))
    assert voltage.time_s[[0, -1]] == pytest.approx([WALL_S + 10, WALL_S + 20])
    assert len(voltage.time_s) == len(frames) == 101


def test_info_tells_length_and_whether_it_was_closed(recorded) -> None:
    path, stream = recorded
    with SessionFile(path) as session:
        info = session.info
    assert info.frames == stream.count
    assert info.started_wall_ns == WALL_S * 10**9
    assert info.size_bytes > 300 * stream.count


def test_silence_is_a_gap_with_nothing_drawn_in_it(recorder: Recorder, stream) -> None:
    info = recorder.start()
    stream.feed(recorder, 50)
    stream.skip(100)
    stream.feed(recorder, 50)
    recorder.flush()
    for points in (1000, 20):
        with SessionFile(info.path) as session:
            series = session.series(["v[3]", "estimate.soc[3]"], points=points)
        for each in series.values():
            ((start, end),) = each.gaps
            assert (start, end) == pytest.approx((WALL_S + 4.9, WALL_S + 15))
            inside = (each.time_s > start) & (each.time_s < end)
            assert inside.sum() == 1
            assert np.isnan(each.minimum[inside]).all()
            assert np.isfinite(each.minimum[~inside]).all()


def test_a_cell_without_a_measurement_is_nan_and_not_zero(recorder: Recorder, stream) -> None:
    info = recorder.start()
    t_mono_ns, t_wall_ns, _ = stream.next()
    FIELDS["v"].pack_into(stream.image, (0,) * 96)
    image = bytes(stream.image)
    body = Data((Window(1896, image[1896:2088]), Window(2290, b"\x80" * 96))).to_body()
    recorder.frame(t_mono_ns, t_wall_ns, 0, encode_frame(1, 0, 5, body)[1:-1], True)
    recorder.flush()
    with SessionFile(info.path) as session:
        for series in session.series(["v[7]", "t[7]"]).values():
            assert len(series.minimum) == 1
            assert np.isnan(series.minimum).all()


def test_windows_that_cut_a_field_give_the_whole_elements(recorder: Recorder, stream) -> None:
    info = recorder.start()
    for windows in (((1896, 101),), ((1996, 92), (1884, 12))):
        recorder.frame(*stream.next()[:2], 0, stream.next(windows)[2], True)
    recorder.flush()
    with SessionFile(info.path) as session:
        series = session.series(["v[49]", "v[50]", "v[95]", "i_fs"])
    assert {name: len(each.time_s) for name, each in series.items()} == {"v[49]": 1, "v[50]": 1, "v[95]": 1, "i_fs": 1}
    assert series["v[49]"].minimum[0] == pytest.approx(stream.voltages[1][49] * 1e-4)
    assert series["v[50]"].minimum[0] == pytest.approx(stream.voltages[3][50] * 1e-4)


def test_a_step_of_the_wall_clock_moves_no_sample_against_another(recorder: Recorder, stream) -> None:
    info = recorder.start()
    step_ns = 3600 * 10**9
    for i in range(100):
        t_mono_ns, t_wall_ns, raw = stream.next()
        recorder.frame(t_mono_ns, t_wall_ns - (step_ns if i >= 50 else 0), 0, raw, True)
    recorder.flush()
    with SessionFile(info.path) as session:
        times = session.series(["v[0]"])["v[0]"].time_s
        frames = list(session.frames())
    assert np.diff(times) == pytest.approx(0.1, abs=1e-6)
    assert times[0] == pytest.approx(WALL_S - 3600)
    assert frames[49].t_wall_ns - frames[50].t_wall_ns == step_ns - 10**8


def test_a_reboot_of_the_master_keeps_order_and_instants_apart(recorder: Recorder, stream) -> None:
    info = recorder.start()
    stream.feed(recorder, 20)
    stream.uptime_ms = 0
    stream.feed(recorder, 20)
    recorder.flush()
    with SessionFile(info.path) as session:
        samples = session.samples([session.signals.find("v[0]"), session.signals.find("estimate.soc[0]")])
    instants, of_estimates = (each.track.instants for each in samples)
    assert (np.diff(instants) > 0).all()
    assert instants[-1] >> 32 == 1
    assert np.array_equal(instants, of_estimates)


def test_estimates_without_a_serial_link_go_into_chunks_too(recorder: Recorder) -> None:
    info = recorder.start()
    for i in range(1500):
        recorder.estimates(MONO_NS + i * 10**8, i * 100, np.full(96, i / 2000), np.full(96, 0.01))
        if i % 100 == 99:
            recorder.flush()
    connection = sqlite3.connect(info.path)
    assert connection.execute("SELECT count(*) FROM chunks").fetchone()[0] == 2
    assert connection.execute("SELECT count(*) FROM estimates").fetchone()[0] < 700
    connection.close()
    with SessionFile(info.path) as session:
        series = session.series(["estimate.soc[5]"])["estimate.soc[5]"]
    assert series.minimum == pytest.approx(np.arange(1500) / 2000, abs=1e-5)


def test_configuration_signals_come_from_the_images_in_force(recorder: Recorder, stream) -> None:
    info = recorder.start()
    image = bytearray(CONFIG_SIZE)
    for i, ts_ms in enumerate((100, 50)):
        FIELDS["conf.ts"].pack_into(image, (ts_ms,))
        recorder.config(MONO_NS + i * 10**9, WALL_S * 10**9 + i * 10**9, bytes(image), "read")
    stream.feed(recorder, 30)
    recorder.flush()
    with SessionFile(info.path) as session:
        series = session.series(["conf.ts"])["conf.ts"]
        assert "conf.ts" in session.signal_names()
    assert list(series.minimum) == [100, 50, 50]
    assert series.time_s == pytest.approx([WALL_S, WALL_S + 1, WALL_S + 2.9])


def test_received_puts_all_sources_in_order_of_arrival(recorder: Recorder, stream) -> None:
    info = recorder.start()
    sent = stream.feed(recorder, 3)
    recorder.can_frame(MONO_NS + 50_000_000, 0, 0x100, b"can")
    recorder.config(MONO_NS - 5, 0, bytes(420), "read")
    recorder.flush()
    with SessionFile(info.path) as session:
        kinds = [getattr(item, "raw", getattr(item, "data", None)) for item in session.received()]
    assert kinds == [None, sent[0], b"can", *sent[1:]]


def test_a_copy_is_one_file_with_everything_so_far(recorder: Recorder, stream, tmp_path: Path) -> None:
    info = recorder.start()
    stream.feed(recorder, 30)
    recorder.flush()
    with SessionFile(info.path) as session:
        session.copy_to(tmp_path / "copy.sqlite")
    with SessionFile(tmp_path / "copy.sqlite") as copy:
        assert copy.info.frames == 30
        assert not copy.info.is_closed
        assert copy.problems() == []


def test_a_closed_session_is_one_file_and_stays_so_when_read(recorder: Recorder, stream) -> None:
    info = recorder.start()
    stream.feed(recorder, 30)
    recorder.stop()
    recorder.flush()
    with SessionFile(info.path) as session:
        assert len(session.series(["v[0]"])["v[0]"].time_s) == 30
    assert [path.name for path in info.path.parent.iterdir()] == [info.path.name]


def test_a_session_that_is_read_while_it_ends_is_closed_all_the_same(recorder: Recorder, stream) -> None:
    info = recorder.start()
    stream.feed(recorder, 30)
    recorder.flush()
    with SessionFile(info.path) as session, session.consistent():
        assert not session.info.is_closed
        recorder.stop()
        recorder.flush()
        assert not session.info.is_closed
    with SessionFile(info.path) as session:
        assert session.info.is_closed
        assert session.info.frames == 30


@pytest.mark.parametrize("name", ["w[3]", "v", "v[96]", "v[1][2]", "i_fs[0]", "estimate.soc", "conf.nothing", ""])
def test_an_unknown_signal_is_named_in_the_error(recorder: Recorder, name: str) -> None:
    info = recorder.start()
    recorder.flush()
    with SessionFile(info.path) as session, pytest.raises(UnknownSignal) as error:
        session.series([name])
    assert error.value.name == name


@pytest.mark.parametrize("content", [None, b"", b"hello" * 1000, b"SQLite format 3\0" + bytes(4080)])
def test_another_file_is_no_session(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "x.sqlite"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(NotASession, match=r"x\.sqlite"):
        SessionFile(path)


def test_a_database_of_another_program_is_no_session_and_is_not_touched(tmp_path: Path) -> None:
    path = tmp_path / "x.sqlite"
    connection = sqlite3.connect(path)
    connection.execute("CREATE TABLE t (a)")
    connection.close()
    before = path.read_bytes()
    with pytest.raises(NotASession):
        SessionFile(path)
    assert path.read_bytes() == before


def test_a_newer_schema_is_refused_with_what_to_do(recorder: Recorder) -> None:
    info = recorder.start()
    recorder.stop()
    recorder.flush()
    connection = sqlite3.connect(info.path)
    connection.execute("PRAGMA user_version = 99")
    connection.close()
    with pytest.raises(SchemaTooNew, match="update voltwall"):
        SessionFile(info.path)


def test_whole_fields_are_what_their_signals_are(stream, recorder):
    info = recorder.start()
    stream.feed(recorder, 700)
    recorder.flush()
    stream.feed(recorder, 200)
    recorder.close()
    with SessionFile(info.path) as session:
        start = session.info.started_wall_ns / 1e9
        pieces = list(session.fields(["v", "i_fs", "estimate.soc", "r_fs"], start + 10, start + 80))
        assert len(pieces) == 2  # a minute, and what came after it
        assert "r_fs" not in pieces[0]
        for name, element in (("v", 36), ("estimate.soc", 95), ("i_fs", 0)):
            of_field = np.concatenate([piece[name].values[:, element] for piece in pieces])
            signal = name if name == "i_fs" else f"{name}[{element}]"
            alone = session.series([signal], start + 10, start + 80, points=10_000)[signal]
            np.testing.assert_array_equal(of_field, alone.minimum)
            np.testing.assert_array_equal(np.concatenate([piece[name].time_s for piece in pieces]), alone.time_s)
        with pytest.raises(UnknownSignal):
            list(session.fields(["v[3]"]))
