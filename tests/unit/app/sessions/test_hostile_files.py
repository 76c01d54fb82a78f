"""One bad file among the sessions hides no other: it is a problem with its name and a reason, everywhere."""

import json
import os
import shutil
import signal
import time
from contextlib import closing
from pathlib import Path

import pytest

from app.battery.table_reader import ProfileError
from app.clock import Clock
from app.estimation.cell_model.cell_file import parse_cell
from app.estimation.errors import CellFileError
from app.season.tags import matches
from app.sessions.catalogue import Catalogue
from app.sessions.catalogue_index import INDEX
from app.sessions.errors import SessionError
from app.sessions.info import SessionInfo
from app.sessions.limited_reader import LISTING, LimitedReader
from app.sessions.reading.session_info import read_info
from app.sessions.recording.recorder import Recorder
from app.sessions.retention import Retention, RetentionRule, apply_rule
from app.sessions.worker import Workers
from app.sources.loaded_battery import battery_from_files, load_battery
from tests.unit.app.sessions.conftest import WALL_NS
from tests.unit.app.sessions.hostile import BATTERIES, DEEP_LIST, DEEP_TOML, HARMLESS, UNREADABLE, hostile

BAD = "20990101T000000Z"


@pytest.fixture
def sound(recorder: Recorder) -> Path:
    info = recorder.start("sound")
    recorder.stop()
    recorder.close()
    return info.path


@pytest.mark.parametrize("attack", UNREADABLE)
def test_a_file_that_cannot_be_read_is_named_and_the_others_are_listed(sound: Path, attack: str) -> None:
    bad = hostile(sound, sound.with_name(f"{BAD}.sqlite"), UNREADABLE[attack])
    catalogue = Catalogue(sound.parent)
    for _ in range(2):  # the second time it is known
        infos, problems = catalogue.survey()
        assert [info.id for info in infos] == [sound.stem]
        assert [BAD in str(problem) for problem in problems] == [True]
    with pytest.raises(SessionError), catalogue.open(bad.stem) as file:
        file.info  # noqa: B018


@pytest.mark.parametrize("attack", BATTERIES)
def test_a_listing_needs_no_battery_and_opening_refuses_a_hostile_one(sound: Path, attack: str) -> None:
    hostile(sound, sound.with_name(f"{BAD}.sqlite"), BATTERIES[attack])
    catalogue = Catalogue(sound.parent)
    assert len(catalogue.list()) == 2
    with pytest.raises(SessionError):
        catalogue.open(BAD)


@pytest.mark.parametrize("attack", HARMLESS)
def test_what_is_odd_but_sound_is_listed_searched_and_sent(sound: Path, attack: str) -> None:
    hostile(sound, sound.with_name(f"{BAD}.sqlite"), HARMLESS[attack])
    infos, problems = Catalogue(sound.parent).survey()
    assert len(infos) == 2
    assert not problems
    assert all(matches(info, sound.stem) == (info.id == sound.stem) for info in infos)
    json.dumps([dict(info.metadata) for info in infos], allow_nan=False).encode()


def test_retention_deletes_what_it_may_and_names_what_it_could_not_judge(sound: Path) -> None:
    for k, attack in enumerate(UNREADABLE):
        hostile(sound, sound.with_name(f"bad-{k}.sqlite"), UNREADABLE[attack])
    catalogue, notes = Catalogue(sound.parent), []
    gone = apply_rule(catalogue, RetentionRule(keep_gb=0.0), WALL_NS, lambda *note: notes.append(note))
    assert gone == [sound.stem]
    assert len(catalogue.survey()[1]) == len(UNREADABLE)


@pytest.mark.parametrize(
    "content",
    [DEEP_LIST, '{"version": 1, "sessions": 1}', '{"version": 1, "sessions": {"SOUND": {"changed_ns": CHANGED, '
     '"bytes": BYTES, "info": {"id": "SOUND", "path": "SOUND.sqlite", "name": 1}}}}', "\x00"],
)  # fmt: skip
def test_a_damaged_index_is_set_aside_and_made_again(sound: Path, content: str) -> None:
    stat = sound.stat()
    text = (
        content.replace("SOUND", sound.stem)
        .replace("CHANGED", str(stat.st_mtime_ns))
        .replace("BYTES", str(stat.st_size))
    )
    (sound.parent / INDEX).write_text(text)
    assert [info.name for info in Catalogue(sound.parent).list()] == ["sound"]
    assert [path.read_text() for path in sound.parent.glob(f"{INDEX}.damaged-*")] == [text]
    assert [info.name for info in Catalogue(sound.parent).list()] == ["sound"]
    assert len(list(sound.parent.glob(f"{INDEX}.damaged-*"))) == 1


def end_process(path: Path) -> SessionInfo:
    os.kill(os.getpid(), signal.SIGKILL)
    return read_info(path)


class Ended(LimitedReader):
    """Its process is killed at one file."""

    def __init__(self, workers: Workers) -> None:
        super().__init__(workers)
        self.workers = workers
        self.asked: list[str] = []

    def info(self, path: Path) -> SessionInfo:
        self.asked.append(path.stem)
        return self.workers.run(LISTING, end_process if path.stem == BAD else read_info, path)


def test_a_file_that_ends_the_process_is_named_and_not_tried_again_before_it_changes(sound: Path) -> None:
    bad = shutil.copy(sound, sound.with_name(f"{BAD}.sqlite"))
    for path in (sound, bad):
        os.utime(path, ns=(WALL_NS, WALL_NS))
    with closing(Workers()) as workers:
        reader = Ended(workers)
        catalogue = Catalogue(sound.parent, reader)
        for _ in range(3):
            infos, problems = catalogue.survey()
            assert [info.id for info in infos] == [sound.stem]
            assert "crashed or was killed" in str(problems[0])
        assert reader.asked.count(BAD) == 1
        os.utime(bad, ns=(WALL_NS, WALL_NS + 1))
        catalogue.survey()
        assert reader.asked.count(BAD) == 2


def test_what_a_session_brings_along_is_parsed_in_another_process_once(sound: Path) -> None:
    files = {"battery.toml": b"[battery]"}
    with closing(Workers()) as workers:
        reader = LimitedReader(workers, own=("ours",))
        assert reader.parse(process_of, "theirs") != os.getpid()
        assert reader.parse(process_of, "ours") == os.getpid()
        assert reader.parse(at_once, files) == reader.parse(at_once, dict(files))
        reasons = set()
        for _ in range(2):
            with pytest.raises(ProfileError) as refused:
                reader.parse(battery_from_files, files)
            reasons.add(str(refused.value))
        assert len(reasons) == 1
        with pytest.raises(CellFileError, match="more than 8 levels"):
            reader.parse(parse_cell, DEEP_TOML)


def process_of(text: str) -> int:
    return os.getpid()


def at_once(files: dict[str, bytes]) -> int:
    return time.monotonic_ns()


def test_an_own_battery_of_another_program_comes_back_whole(sound: Path) -> None:
    files = load_battery("foxbms-2").files
    with closing(Workers()) as workers:
        assert LimitedReader(workers).parse(battery_from_files, files) == battery_from_files(files)


def test_the_thread_of_retention_outlives_a_failure_and_says_so_once(sound: Path, monkeypatch) -> None:
    catalogue, notes = Catalogue(sound.parent), []
    retention = Retention(catalogue, RetentionRule(keep_gb=0.0), lambda *note: notes.append(note), Clock())
    hostile(sound, sound.with_name(f"{BAD}.sqlite"), UNREADABLE["deep"])
    for _ in range(2):
        retention.apply()
    assert [(severity, message.code) for severity, message in notes] == [
        ("warning", "retention-unjudged"),
        ("info", "session-expired"),
    ]
    monkeypatch.setattr(catalogue, "expired", lambda *_, **__: 1 / 0)
    notes.clear()
    for _ in range(2):
        retention.apply()
    assert [message.code for _, message in notes] == ["retention-failed"]
