import threading
import time

import pytest

from app.errors import AppError, NotNow
from app.estimation.cellfile import load_cell
from app.estimation.estimators import make_estimator
from app.pipeline import Pipeline
from app.replaying import Replaying
from app.sessions.writer import Recorder

CELL = load_cell("samsung-25r-10p")


def new_pipeline(*_):
    return Pipeline("replay", lambda: make_estimator("coulomb", CELL, 96), filter_name="c", cell_name="c")


@pytest.fixture
def session(tmp_path, master):
    """A session of twenty frames in two seconds."""
    recorder = Recorder(tmp_path, version="0", monotonic_ns=lambda: master.t_ns)
    info = recorder.start()
    for _ in range(20):
        item = master.frame()
        recorder.frame(item.t_mono_ns, item.t_wall_ns, 0, item.frame.raw, True)
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
    made = Replaying(new_pipeline, shown, failures.append)
    yield made
    made.stop()
    assert not [t for t in threading.enumerate() if t.name == "replay"]


def test_it_shows_what_was_recorded(replaying, shown, session):
    replaying.start(session, 100)
    assert replaying.state()["session_id"] == session.stem
    shown.wait(lambda s: s.links["rs232"].frames == 20)
    assert shown.snapshots[-1].cells.voltage_v[3] == pytest.approx(3.7003)


def test_a_replay_that_stands_still_goes_on_saying_so(replaying, shown, session):
    replaying.start(session, 100)
    shown.wait(lambda s: s.links["rs232"].frames == 20 and not s.is_fresh)
    assert replaying.state()["finished"]
    replaying.control(paused=True, speed=None, seek_s=0.5)
    deadline = time.monotonic() + 5
    while not replaying.state()["paused"]:
        assert time.monotonic() < deadline
        replaying._thread.join(0.01)
    assert replaying.state()["position_s"] == pytest.approx(0.5)


def test_a_file_that_is_no_session_is_refused_and_the_car_stays_shown(replaying, tmp_path):
    broken = tmp_path / "broken.sqlite"
    broken.write_bytes(b"no database" * 100)
    with pytest.raises(AppError):
        replaying.start(broken, 1)
    assert not replaying.is_active
    assert replaying.state() is None


def test_one_that_fails_while_it_plays_ends_and_says_so(shown, failures, session):
    replaying = Replaying(lambda *_: None, shown, failures.append)
    replaying.start(session, 1)
    deadline = time.monotonic() + 5
    while replaying.is_active:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    assert "failed" in failures[0]


def test_of_many_started_at_once_one_is_left(replaying, session):
    threads = [threading.Thread(target=replaying.start, args=(session, 1)) for _ in range(5)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len([t for t in threading.enumerate() if t.name == "replay"]) == 1


def test_without_a_replay_there_is_nothing_to_control(replaying):
    with pytest.raises(NotNow):
        replaying.control(paused=True, speed=None, seek_s=None)
    replaying.stop()
