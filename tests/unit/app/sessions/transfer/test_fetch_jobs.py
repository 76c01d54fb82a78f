"""Fetching as the service and the command do it, from a recorder that is a folder behind a tiny server."""

import json
import threading
from pathlib import Path
from typing import NamedTuple

import pytest

from app.cli import main
from app.clock import Clock
from app.errors import NotNow
from app.sessions.catalogue import Catalogue
from app.sessions.errors import SessionNotFound
from app.sessions.reading.reader import SessionFile
from app.sessions.recording.recorder import Recorder
from app.sessions.transfer.fetch import Remote
from app.sessions.transfer.fetch_jobs import Fetch, FetchJobs
from app.words import render
from firmware_protocol.framing import encode_frame
from tests.fake_clock import FunctionClock
from tests.http_stub import http_stub

WALL_NS = 1_790_000_000 * 10**9


def record(folder, name, frames, *, start_ns=0, wall_ns=WALL_NS):
    clock = iter([start_ns])
    recorder = Recorder(folder, FunctionClock(lambda: next(clock, start_ns + 10**11), lambda: wall_ns), version="1")
    info = recorder.start(name)
    for step in frames:
        raw = encode_frame(3, step & 0xFF, step * 100, step.to_bytes(4, "little"))[1:-1]
        recorder.frame(start_ns + step * 10**8, wall_ns + step * 10**8, 0, raw, True)
    recorder.close()
    return info


class Car(NamedTuple):
    """A recorder behind a tiny server, which answers while `held` is set."""

    folder: Path
    url: str
    held: threading.Event


@pytest.fixture
def car(tmp_path):
    """A service of three requests: list, file, and nothing else."""
    catalogue = Catalogue(tmp_path / "car")
    held = threading.Event()
    held.set()

    def answer(asked):
        held.wait(10)
        if asked.path != "/api/v1/sessions":
            return 200, {}, catalogue.path(asked.path.split("/")[4]).read_bytes()
        listed = [
            {"id": i.id, "name": i.name, "started": i.started_wall_ns / 1e9, "duration_s": i.duration_s,
             "bytes": i.size_bytes, "recording": not i.is_closed}
            for i in catalogue.list()
        ]  # fmt: skip
        return 200, {}, json.dumps({"sessions": listed}).encode()

    with http_stub(answer) as url:
        yield Car(tmp_path / "car", url, held)
        held.set()


@pytest.fixture
def remote(car):
    return Remote(car.url, label="car", sleep=lambda _: None)


def test_all_that_is_finished_and_not_here_is_fetched_once_and_fills_what_is_here(car, remote, tmp_path):
    record(car.folder, "run 1", range(100), wall_ns=WALL_NS)
    record(car.folder, "run 2", range(100), wall_ns=WALL_NS + 10**13)
    here = record(tmp_path / "pit", "pit", [*range(40), *range(60, 100)], start_ns=5 * 10**9)
    catalogue = Catalogue(tmp_path / "pit")
    done = Fetch(remote, tmp_path / "pit", catalogue, Clock()).run()
    assert len(done.fetched) == 2
    said = f"{here.id}: 20 missing frames filled, 1.9 s in 1 gap, from {done.fetched[0]}"
    assert [render(each) for each in done.filled] == [said]
    with SessionFile(here.path) as session:
        assert session.info.frames == 100
    again = Fetch(remote, tmp_path / "pit", catalogue, Clock()).run()
    assert (again.fetched, again.already_here, again.filled) == ((), 2, ())


@pytest.mark.parametrize("is_fetched", [True, False], ids=["fetch", "fill"])
def test_the_commands_say_in_words_what_was_filled(car, tmp_path, capsys, is_fetched):
    there = record(car.folder, "run", range(100))
    here = record(tmp_path / "data" / "sessions", "pit", [*range(40), *range(60, 100)], start_ns=5 * 10**9)
    words = ["fetch", car.url, "--label", "car"] if is_fetched else ["fill", str(here.path), "--from", str(there.path)]
    assert main(["sessions", *words, "--data", str(tmp_path / "data")]) == 0
    source = f"car-{there.id}" if is_fetched else there.id
    assert f"{here.id}: 20 missing frames filled, 1.9 s in 1 gap, from {source}\n" in capsys.readouterr().out


def test_a_recorder_without_a_clock_fills_all_the_same(car, remote, tmp_path):
    record(car.folder, "run", range(100), wall_ns=3600 * 10**9)
    record(tmp_path / "pit", "pit", range(50), start_ns=5 * 10**9)
    done = Fetch(remote, tmp_path / "pit", Catalogue(tmp_path / "pit"), Clock()).run()
    assert "50 missing frames" in render(done.filled[0])


def test_only_what_is_wanted_and_nothing_filled_where_it_is_not(car, remote, tmp_path):
    wanted = record(car.folder, "run", range(100))
    here = record(tmp_path / "pit", "pit", range(50))
    done = Fetch(remote, tmp_path / "pit", Catalogue(tmp_path / "pit"), Clock()).run([wanted.id], fill=False)
    assert done.fetched == (f"car-{wanted.id}",)
    with SessionFile(here.path) as session:
        assert session.info.frames == 50
    with pytest.raises(SessionNotFound):
        Fetch(remote, tmp_path / "pit", Catalogue(tmp_path / "pit"), Clock()).run(["none"])


def test_in_the_service_one_fetch_at_a_time_and_its_end_is_told(car, remote, tmp_path):
    record(car.folder, "run", range(10))
    told, ended = [], threading.Event()

    def note(severity: str, code: str, text: str) -> None:
        told.append((severity, code))
        ended.set()

    bringing = FetchJobs(tmp_path / "pit", Catalogue(tmp_path / "pit"), note, Clock())
    assert bringing.state() is None
    car.held.clear()
    assert bringing.start(remote, [], fill=True).is_running
    with pytest.raises(NotNow):
        bringing.start(remote, [], fill=True)
    car.held.set()
    assert ended.wait(10)
    assert told == [("info", "session-fetched")]
    ended.clear()
    bringing.start(Remote("http://127.0.0.1:1", sleep=lambda _: None), [], fill=True)
    assert ended.wait(10)
    assert told[-1] == ("warning", "fetch-failed")
    assert bringing.state().error
