import threading
import time

import numpy as np
import pytest

from app.clock import Clock
from app.errors import AppError, ConfigError, NotNow
from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.estimators import make_estimator
from app.live.pipeline import Pipeline
from app.sessions.reading.reader import SessionFile
from app.sessions.recording.recorder import Recorder
from app.sessions.replay import ReplayOptions, ReplayPlayer
from app.sessions.replay_schedule import LEAD_S
from app.sources.items import SerialItem
from app.sources.master.source import MasterSource
from app.telemetry import TripCause
from app.words import condition
from tests.fake_clock import FunctionClock

RECORDED_SOC = 0.42
CELL = load_cell("samsung-25r-10p")


def new_pipeline(*_, **__):
    return Pipeline(MasterSource("replay"), lambda: make_estimator("coulomb", CELL, 96), filter_name="c", cell_name="c")


class Player(ReplayPlayer):
    """Plays through pipelines that a test makes; keeps what it was asked for."""

    def __init__(self, shown, failures, new=new_pipeline, cause=None, **more):
        self.begun_at, self.asked_at = [], []

        def pipeline(from_s):
            self.begun_at.append(from_s)
            return new()

        def find_cause(session, at_s):
            self.asked_at.append(at_s)
            return cause

        super().__init__(lambda file, options: pipeline, find_cause, shown, failures.append, Clock(), **more)


def recorded(folder, master, n_frames):
    """A session of frames every 0.1 s."""
    recorder = Recorder(folder, FunctionClock(lambda: master.t_ns), version="0")
    path = recorder.start().path
    for _ in range(n_frames):
        item = master.frame()
        recorder.frame(item.t_mono_ns, item.t_wall_ns, 0, item.frame.raw, True)
    recorder.close()
    return path


@pytest.fixture
def session(tmp_path, master):
    """A session of twenty frames in two seconds."""
    recorder = Recorder(tmp_path, FunctionClock(lambda: master.t_ns), version="0")
    info = recorder.start()
    for _ in range(20):
        item = master.frame()
        recorder.frame(item.t_mono_ns, item.t_wall_ns, 0, item.frame.raw, True)
        recorder.estimates(item.t_mono_ns, master.uptime_ms, np.full(96, RECORDED_SOC), np.full(96, 0.02))
    recorder.close()
    return info.path


class Shown:
    """Collects snapshots; `wait` for one that fulfils a condition."""

    def __init__(self):
        self.snapshots = []
        self.changed = threading.Condition()

    def __call__(self, snapshot):
        with self.changed:
            self.snapshots.append(snapshot)
            self.changed.notify_all()

    def wait(self, condition):
        with self.changed:
            assert self.changed.wait_for(lambda: any(condition(s) for s in self.snapshots), 10)


@pytest.fixture
def failures():
    return []


@pytest.fixture
def shown():
    return Shown()


@pytest.fixture
def replaying(shown, failures):
    made = Player(shown, failures)
    yield made
    made.stop()
    assert not [t for t in threading.enumerate() if t.name == "replay"]


def test_it_shows_what_was_recorded(replaying, shown, session):
    replaying.start(session, ReplayOptions(100))
    assert replaying.state().session_id == session.stem
    shown.wait(lambda s: s.links.rs232.frames == 20)
    assert shown.snapshots[-1].cells.voltage_v[3] == pytest.approx(3.7003)


def test_a_replay_that_stands_still_goes_on_saying_so(replaying, shown, session):
    replaying.start(session, ReplayOptions(100))
    shown.wait(lambda s: s.links.rs232.frames == 20 and not s.is_fresh)
    assert replaying.state().finished
    replaying.control(paused=True, seek_s=0.5)
    deadline = time.monotonic() + 5
    while not replaying.state().paused:
        assert time.monotonic() < deadline
        replaying._thread.join(0.01)
    assert replaying.state().position_s == pytest.approx(0.5)


def test_a_file_that_is_no_session_is_refused_and_the_car_stays_shown(replaying, tmp_path):
    broken = tmp_path / "broken.sqlite"
    broken.write_bytes(b"no database" * 100)
    with pytest.raises(AppError):
        replaying.start(broken, ReplayOptions())
    assert not replaying.is_active
    assert replaying.state() is None


def test_one_that_fails_while_it_plays_ends_and_says_so(shown, failures, session):
    class Broken:
        def __init__(self):
            self.filter_name, self.cell_name = "f", "c"

        def warm_up(self):
            pass

        def feed(self, item):
            if isinstance(item, SerialItem):
                raise ValueError("broken")

    replaying = Player(shown, failures, Broken)
    replaying.start(session, ReplayOptions(1))
    replaying._thread.join(5)
    assert not replaying.is_active
    assert failures[0].code == "replay-failed"


def test_of_many_started_at_once_one_is_left(replaying, session):
    threads = [threading.Thread(target=replaying.start, args=(session, ReplayOptions())) for _ in range(5)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len([t for t in threading.enumerate() if t.name == "replay"]) == 1


def test_without_a_replay_there_is_nothing_to_control(replaying):
    with pytest.raises(NotNow):
        replaying.control(paused=True)
    replaying.stop()


def fresh(snapshots):
    return [(s.t_mono_ns, s.cells.soc.tolist(), s.accumulator, s.alarms) for s in snapshots if s.is_fresh]


def test_step_by_step_is_the_same_as_in_one_go(replaying, shown, session):
    replaying.start(session, ReplayOptions(100))
    shown.wait(lambda s: s.links.rs232.frames == 20)
    at_once = fresh(shown.snapshots)
    shown.snapshots.clear()
    replaying.start(session, ReplayOptions(0.1))
    replaying.control(paused=True, seek_s=0.0)
    for frames in range(1, 21):
        replaying.control(step=True)
        shown.wait(lambda s, frames=frames: s.is_fresh and s.links.rs232.frames == frames)
    assert fresh(shown.snapshots)[-20:] == at_once


def test_a_loop_begins_anew_until_it_is_taken_off(replaying, shown, session):
    replaying.start(session, ReplayOptions(100))
    replaying.control(loop=(0.5, 1.5))
    shown.wait(lambda s: s.is_fresh)
    first = shown.snapshots[0].t_mono_ns
    with shown.changed:
        assert shown.changed.wait_for(lambda: sum(s.t_mono_ns == first for s in shown.snapshots if s.is_fresh) > 2, 10)
    assert replaying.state().loop == (0.5, 1.5)
    replaying.control(loop="off", seek_s=0.0)
    shown.wait(lambda s: s.links.rs232.frames == 20 and not s.is_fresh)


@pytest.mark.parametrize("loop", [(-1.0, 1.0), (1.0, 0.5), (0.0, 1e6)])
def test_a_loop_beyond_the_session_is_refused(replaying, session, loop):
    replaying.start(session, ReplayOptions(1))
    with pytest.raises(ConfigError, match="loop"):
        replaying.control(loop=loop)


def test_both_estimates_are_told_and_either_is_shown(replaying, shown, session):
    replaying.start(session, ReplayOptions(100, estimates="recorded"))
    shown.wait(lambda s: s.links.rs232.frames == 20 and not s.is_fresh)  # the state is told before it is repeated
    snapshot = next(s for s in shown.snapshots if s.is_fresh)
    assert snapshot.cells.soc == pytest.approx(np.full(96, RECORDED_SOC), abs=2e-5)
    assert snapshot.accumulator.soc == pytest.approx(RECORDED_SOC, abs=2e-5)
    compared = replaying.state().compared
    assert compared.recorded_soc == pytest.approx(RECORDED_SOC, abs=2e-5)
    assert compared.largest_difference >= abs(compared.recomputed_soc - RECORDED_SOC) - 2e-5
    shown.snapshots.clear()
    replaying.control(estimates="recomputed", seek_s=0.0)
    shown.wait(lambda s: s.is_fresh and s.accumulator.soc == pytest.approx(compared.recomputed_soc, abs=1e-3))


def test_a_replay_that_was_ended_while_it_compiled_says_nothing_more(shown, failures, session, monkeypatch):
    release = threading.Event()
    made = []

    def pipeline(*_, **__):
        built = new_pipeline()
        if not made:
            monkeypatch.setattr(built, "warm_up", lambda: release.wait(10))
        made.append(built)
        return built

    replaying = Player(shown, failures, pipeline, end_s=0.05)
    replaying.start(session, ReplayOptions(100))
    (compiling,) = [thread for thread in threading.enumerate() if thread.name == "replay"]
    replaying.control(seek_s=1.0, paused=True)
    replaying.start(session, ReplayOptions(0.1))
    release.set()
    compiling.join(10)
    assert not compiling.is_alive()
    state = replaying.state()
    assert (state.speed, state.paused) == (0.1, False)
    replaying.stop()
    assert replaying.state() is None
    assert failures == []


def test_a_jump_goes_on_with_what_the_cells_had_shown_before_it(shown, failures, tmp_path, master):
    """The pipeline begins so long before the position that every window of the stream has had its turn."""
    path = recorded(tmp_path, master, 100)
    replaying = Player(shown, failures)
    replaying.start(path, ReplayOptions(100))
    shown.wait(lambda s: s.links.rs232.frames == 100)
    shown.snapshots.clear()
    replaying.control(seek_s=LEAD_S + 2.0)
    shown.wait(lambda s: s.links.rs232.frames == 29)
    replaying.stop()
    with SessionFile(path) as file:
        assert replaying.begun_at == [None, pytest.approx(file.info.started_wall_ns / 1e9 + 2.0)]


def test_the_cause_of_a_trip_is_looked_for_once_and_told_to_the_alarm_that_holds(shown, failures, tmp_path, master):
    master.set("status.flags", [0])  # the master holds the shutdown circuit open
    path = recorded(tmp_path, master, 100)
    cause = TripCause("joint-resistance-high", condition("joint-resistance-high"), 63, 5, 0.9, ())
    replaying = Player(shown, failures, cause=cause)
    replaying.start(path, ReplayOptions(10))
    shown.wait(lambda s: any(alarm.cause == cause for alarm in s.alarms if alarm.severity == "trip"))
    replaying.stop()
    assert len(replaying.asked_at) == 1
