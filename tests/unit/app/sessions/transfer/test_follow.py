"""Copies of a car's sessions over a link that cuts and damages: nothing lost, nothing twice, in either order."""

import hashlib
import random
import shutil
import threading
import urllib.error
from collections.abc import Iterator
from contextlib import closing
from email.message import Message as Headers
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.clock import Clock
from app.errors import AppError, ConfigError
from app.sessions.catalogue import Catalogue
from app.sessions.errors import FetchFailed
from app.sessions.info import SessionInfo
from app.sessions.reading.reader import SessionFile
from app.sessions.recording.recorder import Recorder
from app.sessions.storage.queries import StoredSession
from app.sessions.transfer.fetch import Remote
from app.sessions.transfer.follow import MOST_YIELD_S, Follower, Followers, remotes_of
from app.sessions.transfer.pieces import PIECE_NS, head_of, n_pieces, parse_piece, read_piece
from app.sessions.transfer.session_copy import COPIES, SessionCopy
from app.telemetry import Event
from app.telemetry.measurement import STALE_S
from app.words import Message
from firmware_protocol.framing import encode_frame
from tests.campaign import campaign, of_size
from tests.fake_clock import FunctionClock

WALL_NS = 1_790_000_000 * 10**9
START_NS = 77 * 10**9
SECONDS = 95


def record(folder: Path, seconds: int = SECONDS) -> SessionInfo:
    """A session of a frame every half second, each with an estimate, a CAN frame a second, and one of all else."""
    now = iter(range(10**9))
    end_ns = START_NS + seconds * 10**9
    clock = FunctionClock(lambda: START_NS if next(now) == 0 else end_ns, lambda: WALL_NS)
    recorder = Recorder(folder, clock, version="1")
    info = recorder.start("run", {"driver": "Anna"})
    recorder.config(START_NS, WALL_NS, bytes(420), "in force")
    for step in range(2 * seconds):
        t_ns, wall_ns = START_NS + step * 500_000_000 + 7, WALL_NS + step * 500_000_000
        raw = encode_frame(3, step & 0xFF, step * 500, step.to_bytes(4, "little"))[1:-1]
        is_good = step % 17 != 3
        recorder.frame(t_ns, wall_ns, 0, raw if is_good else raw[:-1], is_good)
        recorder.estimates(t_ns, step * 500, np.full(96, 0.9 - step * 1e-4), np.full(96, np.nan))
        if step % 2:
            recorder.can_frame(t_ns, wall_ns, 0x100, bytes([step % 256]))
        if step % 100 == 99:
            recorder.flush()
    recorder.marker(START_NS + 30 * 10**9, WALL_NS, "first lap", kind="lap", who="anna")
    recorder.event(
        START_NS + 31 * 10**9,
        Event(WALL_NS, "trip", "cell-overtemperature", Message("cell-overtemperature"), cell=7, value=61.0),
    )
    recorder.close()
    return info


class Car(Remote):
    """A recorder in the car: a folder, over a link whose faults are drawn from `rng`."""

    def __init__(self, folder: Path, *, loss: float = 0.0, damage: float = 0.0, seed: int = 1) -> None:
        super().__init__("http://car.local:8000", label="car")
        self.catalogue = Catalogue(folder)
        self.recording: str | None = None
        self.loss, self.damage, self.rng = loss, damage, random.Random(seed)
        self.sent: list[int] = []

    def _lose(self) -> None:
        if self.rng.random() < self.loss:
            raise FetchFailed(self.url, "cut")

    def offers(self) -> list[dict[str, Any]]:
        self._lose()
        return [
            {"id": i.id, "started": i.started_wall_ns / 1e9, "bytes": i.size_bytes, "recording": i.id == self.recording,
             "pieces": n_pieces(i, is_recording=i.id == self.recording)}
            for i in self.catalogue.list()
        ]  # fmt: skip

    def head(self, session_id: str) -> dict[str, Any]:
        self._lose()
        with self.catalogue.open(session_id) as session:
            return head_of(session, session.info, is_recording=session_id == self.recording)

    def pieces(self, session_id: str, first: int, count: int, *, descending: bool) -> Iterator[tuple[int, str, bytes]]:
        self._lose()
        with self.catalogue.open(session_id) as session, closing(StoredSession(session.path)) as stored:
            is_recording = session_id == self.recording
            there = n_pieces(session.info, is_recording=is_recording)
            for number in range(first, first - count, -1) if descending else range(first, first + count):
                is_last = number == there - 1 and not is_recording
                body = read_piece(session, stored, session.info, number, is_last=is_last)
                self.sent.append(number)
                digest = hashlib.sha256(body).hexdigest()
                self._lose()
                yield number, digest, body[:-3] if self.rng.random() < self.damage else body


class Patient(threading.Event):
    """Does not wait, and ends by itself once `is_done` says so."""

    def __init__(self, is_done) -> None:
        super().__init__()
        self._is_done = is_done

    def wait(self, timeout: float | None = None) -> bool:
        if self._is_done():
            self.set()
        return self.is_set()


@pytest.fixture
def pit(tmp_path) -> Path:
    (tmp_path / "pit").mkdir()
    return tmp_path / "pit"


def whole(pit: Path):
    return lambda: not SessionCopy.all_in(pit) and any(pit.glob("*.sqlite"))


def assert_same(original: Path, copy: Path) -> None:
    with SessionFile(original) as there, SessionFile(copy) as here:
        assert list(here.frames()) == list(there.frames())
        assert list(here.can_frames()) == list(there.can_frames())
        assert here.configs() == there.configs()
        assert here.markers() == there.markers()
        assert here.events() == there.events()
        for mine, theirs in zip(here.estimates(), there.estimates(), strict=True):
            assert mine[:2] == theirs[:2]
            assert np.array_equal(mine[2], theirs[2])
            assert np.array_equal(mine[3], theirs[3], equal_nan=True)
        assert here.problems() == []
        assert (here.info.started_mono_ns, here.info.ended_mono_ns) == (
            there.info.started_mono_ns,
            there.info.ended_mono_ns,
        )
        assert (here.info.is_closed, dict(here.info.metadata)) == (there.info.is_closed, dict(there.info.metadata))


@campaign(30, 120, 600)
@pytest.mark.parametrize("order", ["oldest", "newest"])
def test_over_a_link_that_loses_and_damages_every_third_thing_nothing_is_lost(tmp_path, pit, order):
    info = record(tmp_path / "car", of_size(SECONDS, 300, 1200, 4200))
    car = Car(tmp_path / "car", loss=0.3, damage=0.1)
    told: list[Message] = []
    Follower(car, pit, Clock(), order=order, note=told.append).run(Patient(whole(pit)))
    assert_same(info.path, pit / f"car-{info.id}.sqlite")
    assert told[0].code == "session-fetched"
    assert not list((pit / COPIES).iterdir())
    again = Follower(Car(tmp_path / "car"), pit, Clock())
    assert again.step() is False
    assert again.remote.sent == []


@pytest.mark.parametrize(("order", "first"), [("oldest", [0, 1, 2, 3]), ("newest", [9, 8, 7, 6])])
def test_what_comes_first_is_chosen(tmp_path, pit, order, first):
    record(tmp_path / "car")
    car = Car(tmp_path / "car")
    follower = Follower(car, pit, Clock(), order=order)
    while len(car.sent) < 4:
        follower.step()
    assert car.sent[:4] == first
    Followers([follower]).choose("newest" if order == "oldest" else "oldest")
    sent = len(car.sent)
    follower.step()
    assert car.sent[sent] == {"oldest": 9, "newest": 0}[order]


def test_what_is_missing_is_told_and_a_killed_copy_goes_on(tmp_path, pit):
    record(tmp_path / "car")
    car = Car(tmp_path / "car")
    follower = Follower(car, pit, Clock())
    follower.step()
    follower.step()  # one piece, then two
    (copy,) = SessionCopy.all_in(pit)
    state = copy.state()
    start_s = WALL_NS / 1e9
    assert (state["pieces"], state["missing_s"]) == (10, 70.0)
    assert state["missing"] == [(start_s + 30, start_s + 100)]
    (pit / COPIES / "car-damaged").mkdir()
    (pit / COPIES / "car-damaged" / "head.json").write_text("{")
    assert [each.id for each in SessionCopy.all_in(pit)] == [copy.id]
    shutil.rmtree(pit / COPIES / "car-damaged")
    (pit / COPIES / copy.id / ".000003.x.piece.part").write_bytes(b"cut off in the middle")
    next_one = Car(tmp_path / "car")
    Follower(next_one, pit, Clock()).run(Patient(whole(pit)))
    assert sorted(next_one.sent) == list(range(3, 10))


def test_a_session_is_copied_while_it_is_recorded_and_its_gap_is_filled_when_the_car_is_back(tmp_path, pit):
    info = record(tmp_path / "car", 55)
    car = Car(tmp_path / "car")
    car.recording = info.id
    follower = Follower(car, pit, Clock())
    while follower.step():
        pass
    assert sorted(car.sent) == list(range(5))  # 53 s are settled
    assert SessionCopy.all_in(pit)[0].missing() == []
    assert not list(pit.glob("*.sqlite"))
    car.recording = None
    Follower(car, pit, Clock()).run(Patient(whole(pit)))
    assert_same(info.path, pit / f"car-{info.id}.sqlite")


def test_a_session_can_be_looked_at_before_all_of_it_is_here(tmp_path, pit, monkeypatch):
    monkeypatch.setattr("app.sessions.transfer.follow.FRESH_PIECES", 3)
    info = record(tmp_path / "car")
    follower = Follower(Car(tmp_path / "car"), pit, Clock(), order="newest")
    for _ in range(2):
        follower.step()
    path = pit / f"car-{info.id}.sqlite"
    with SessionFile(path) as session:
        assert session.info.metadata["missing"] == [[0.0, 70.0]]
        assert session.info.frames == 50
    while follower.step():
        pass
    assert_same(info.path, path)


def test_pieces_that_do_not_go_on_from_each_other_are_refused_by_the_ids_of_their_frames(tmp_path, pit):
    info = record(tmp_path / "car")
    copy = SessionCopy(pit, "car-x")
    with SessionFile(info.path) as session, closing(StoredSession(info.path)) as stored:
        copy.note_head(head_of(session, session.info, is_recording=False))
        bodies = [read_piece(session, stored, session.info, n, is_last=n == 9) for n in range(10)]

    def put(number: int, body: bytes) -> None:
        copy.put(number, body, hashlib.sha256(body).hexdigest())

    put(1, bodies[1])
    with pytest.raises(ValueError, match="go on"):
        put(2, bodies[3])
    assert copy.have() == {}  # which of the two is wrong is not known: both come again
    with pytest.raises(ValueError, match="go on"):
        put(0, bodies[1])
    with pytest.raises(ValueError, match="not what was sent"):
        copy.put(0, bodies[0], "0" * 64)
    for number, body in enumerate(bodies):
        put(number, body)
    assert copy.is_whole()
    assert parse_piece(bodies[0]).ids[0] == 1
    assert copy.head["start_mono_ns"] + 10 * PIECE_NS > copy.head["end_mono_ns"]


def test_a_session_that_began_anew_under_the_same_name_is_another_one(tmp_path, pit):
    info = record(tmp_path / "car")
    copy = SessionCopy(pit, "car-x")
    with SessionFile(info.path) as session, closing(StoredSession(info.path)) as stored:
        head = head_of(session, session.info, is_recording=False)
        copy.note_head(head)
        body = read_piece(session, stored, session.info, 0, is_last=False)
    copy.put(0, body, hashlib.sha256(body).hexdigest())
    copy.note_head(head | {"start_mono_ns": 5})
    assert copy.have() == {}


@pytest.mark.parametrize("body", [b"", b"x" * 50, b"x\x9c\x03\x00\x00\x00\x00\x01"])
def test_what_is_no_piece_is_refused(body):
    with pytest.raises(ValueError, match=r"\w"):
        parse_piece(body)


def test_the_live_view_goes_first(tmp_path, pit):
    record(tmp_path / "car")
    waited: list[float] = []

    class Watch(threading.Event):
        def wait(self, timeout: float | None = None) -> bool:
            waited.append(timeout or 0.0)
            return False

    late = iter([2 * STALE_S] * 7)
    follower = Follower(Car(tmp_path / "car"), pit, Clock(), live_age_s=lambda: next(late, None))
    follower.step(Watch())
    assert len(waited) == 7
    waited.clear()
    Follower(Car(tmp_path / "car"), pit / "b", Clock(), live_age_s=lambda: STALE_S).step(Watch())
    assert sum(waited) == pytest.approx(MOST_YIELD_S, rel=0.1)  # a live view that is gone does not hold it for ever


def test_a_recorder_that_is_away_is_told_and_asked_again(pit):
    remote = Remote("http://127.0.0.1:1", label="car")
    follower = Follower(remote, pit, Clock())
    tries = iter(range(3))
    Followers([follower]).stop()
    follower.run(Patient(lambda: next(tries, None) is None))
    assert (follower.state.is_reached, follower.state.last_contact_s) == (False, None)
    assert follower.state.error


def test_recorders_are_named_by_url_and_label():
    first, second = remotes_of("red=http://red.local:8000, http://10.0.0.7:8000", "secret")
    assert (first.label, first.url, second.label) == ("red", "http://red.local:8000", "10-0-0-7")
    assert remotes_of(None, None) == []
    with pytest.raises(ConfigError, match="recorder = ftp"):
        remotes_of("ftp://red", None)
    for both in ("car=http://a,car=http://b", "http://car:8000,http://car:8001", "red=http://red,red"):
        with pytest.raises(ConfigError, match="recorder = "):
            remotes_of(both, None)
    with pytest.raises(ConfigError, match="another recorder has this label"):
        remotes_of("http://car:8000,http://car:8001", None)


def test_a_piece_that_is_refused_names_the_session(tmp_path, pit):
    record(tmp_path / "car")
    with pytest.raises(AppError, match="car-"):
        Follower(Car(tmp_path / "car", damage=1.0), pit, Clock()).step()


def test_a_session_that_was_deleted_on_the_recorder_does_not_keep_the_next_ones_from_coming(tmp_path, pit):
    first = record(tmp_path / "car", 55)
    gone: set[str] = set()

    class Deleting(Car):
        def offers(self) -> list[dict[str, Any]]:
            return [each for each in super().offers() if each["id"] not in gone]

        def pieces(self, session_id: str, first: int, count: int, *, descending: bool) -> Iterator[Any]:
            if session_id in gone:
                refused = urllib.error.HTTPError(self.url, 404, "Not Found", Headers(), None)
                raise FetchFailed(self.url, "Not Found") from refused
            return super().pieces(session_id, first, count, descending=descending)

    car = Deleting(tmp_path / "car")
    follower = Follower(car, pit, Clock())
    follower.step()  # a piece of it is here
    gone.add(first.id)
    second = record(tmp_path / "car", 15)
    tries = iter(range(50))
    follower.run(Patient(lambda: next(tries, None) is None or any(pit.glob("*.sqlite"))))
    assert_same(second.path, pit / f"car-{second.id}.sqlite")


def test_a_session_of_which_nothing_can_be_made_here_does_not_keep_the_next_ones_from_coming(
    tmp_path, pit, monkeypatch
):
    good, bad = record(tmp_path / "car", 15), record(tmp_path / "car", 25)  # the newer one is listed first
    build = SessionCopy.build
    monkeypatch.setattr(SessionCopy, "build", lambda copy, parse: 1 / 0 if copy.id.endswith(bad.id) else build(copy))
    now = iter(range(0, 10**15, 10**10))  # the list is due each time
    follower = Follower(Car(tmp_path / "car"), pit, FunctionClock(lambda: next(now), lambda: WALL_NS))
    tries = iter(range(50))
    follower.run(Patient(lambda: next(tries, None) is None or (any(pit.glob("*.sqlite")) and follower.state.error)))
    assert_same(good.path, pit / f"car-{good.id}.sqlite")
    assert follower.state.error
