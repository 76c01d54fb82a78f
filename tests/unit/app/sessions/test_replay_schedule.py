import math
from pathlib import Path

import pytest

from app.errors import ConfigError
from app.sessions.info import RecordedCanFrame, RecordedFrame
from app.sessions.reading.reader import SessionFile
from app.sessions.recording.recorder import Recorder
from app.sessions.replay_schedule import LEAD_S, MAX_ITEMS, Pacer

MONO_NS = 5_000 * 10**9
FRAMES = 200


@pytest.fixture
def session(recorder: Recorder, stream):
    info = recorder.start()
    stream.feed(recorder, FRAMES)
    recorder.can_frame(MONO_NS + 50_000_000, 0, 0x100, b"can")
    recorder.flush()
    with SessionFile(info.path) as session:
        yield session


def raws(items: list[RecordedFrame | RecordedCanFrame]) -> list[bytes]:
    return [item.raw if isinstance(item, RecordedFrame) else item.data for item in items]


def all_raws(session: SessionFile) -> list[bytes]:
    frames = [frame.raw for frame in session.frames()]
    return [frames[0], b"can", *frames[1:]]


@pytest.mark.parametrize("speed", [0.1, 1.0, 3.7, 100.0, math.inf])
def test_everything_comes_once_in_order_at_any_speed(session: SessionFile, speed: float) -> None:
    now_s = 1000.0
    pacer = Pacer(session, now_s=now_s, speed=speed)
    played = pacer.due(now_s)
    while (wait_s := pacer.wait_s(now_s)) is not None:
        now_s += wait_s + 1e-9
        played += pacer.due(now_s)
    assert raws(played) == all_raws(session)
    assert pacer.is_finished
    assert pacer.position_s(now_s) == pacer.duration_s
    if not math.isinf(speed):
        assert now_s - 1000.0 == pytest.approx(19.9 / speed, rel=1e-3)


def test_an_item_is_due_at_its_time_and_not_before(session: SessionFile) -> None:
    pacer = Pacer(session, now_s=0.0, speed=2.0)
    assert len(pacer.due(0.0)) == 1
    assert pacer.due(0.0249) == []
    assert raws(pacer.due(0.0251)) == [b"can"]
    assert len(pacer.due(0.0501)) == 1


def test_a_pause_holds_the_position(session: SessionFile) -> None:
    pacer = Pacer(session, now_s=0.0)
    pacer.due(5.05)
    pacer.pause(5.05)
    assert pacer.due(500.0) == []
    assert pacer.wait_s(500.0) is None
    assert pacer.position_s(500.0) == pytest.approx(5.05)
    pacer.resume(600.0)
    assert len(pacer.due(600.06)) == 1


def test_a_change_of_speed_goes_on_from_where_it_was(session: SessionFile) -> None:
    pacer = Pacer(session, now_s=0.0, speed=10.0)
    pacer.due(0.5)
    pacer.set_speed(0.5, 0.5)
    assert pacer.position_s(0.5) == pytest.approx(5.0)
    assert pacer.position_s(1.5) == pytest.approx(5.5)


def test_a_jump_brings_what_was_just_before_at_once(session: SessionFile) -> None:
    pacer = Pacer(session, now_s=0.0)
    pacer.seek(12.05, 100.0)
    assert pacer.position_s(100.0) == pytest.approx(12.05)
    lead = pacer.due(100.0)
    assert lead[-1].t_mono_ns == MONO_NS + 12_000_000_000
    assert lead[-1].t_mono_ns - lead[0].t_mono_ns == pytest.approx(LEAD_S * 1e9, abs=1e8)
    pacer.seek(0.0, 200.0)
    assert raws(pacer.due(200.06)) == all_raws(session)[:2]
    pacer.seek(1e9, 300.0)
    pacer.due(300.0)
    assert pacer.is_finished


def test_a_step_plays_one_serial_frame_and_stands_still(session: SessionFile) -> None:
    pacer = Pacer(session, now_s=0.0)
    assert raws(pacer.step()) == all_raws(session)[:1]
    assert raws(pacer.step()) == all_raws(session)[1:3]
    assert pacer.is_paused
    assert pacer.position_s(77.0) == pytest.approx(0.1)


@pytest.mark.parametrize("speed", [0, -1, 0.09, 101, math.nan])
def test_a_speed_out_of_range_is_refused(session: SessionFile, speed: float) -> None:
    with pytest.raises(ConfigError, match="speed"):
        Pacer(session, now_s=0.0, speed=speed)


def test_an_empty_session_is_finished_at_once(recorder: Recorder, tmp_path: Path) -> None:
    info = recorder.start()
    recorder.flush()
    with SessionFile(info.path) as session:
        pacer = Pacer(session, now_s=0.0)
        assert pacer.is_finished
        assert pacer.due(1.0) == []


def test_who_is_slow_plays_slower_and_leaves_nothing_out(recorder: Recorder, stream) -> None:
    info = recorder.start()
    stream.feed(recorder, 2 * MAX_ITEMS)
    recorder.flush()
    with SessionFile(info.path) as session:
        pacer = Pacer(session, now_s=0.0, speed=100.0)
        played, now_s = pacer.due(0.0), 0.0
        while not pacer.is_finished:
            now_s += 10.0  # a thousand seconds of the session
            found = pacer.due(now_s)
            assert 0 < len(found) <= MAX_ITEMS
            played += found
            assert pacer.is_finished or pacer.position_s(now_s) == (found[-1].t_mono_ns - MONO_NS) / 1e9
        assert len(played) == 2 * MAX_ITEMS
