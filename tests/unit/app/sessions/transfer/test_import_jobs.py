"""An uploaded file on its way to becoming a session: what is told while it comes, and at its end."""

import threading
from dataclasses import replace

import pytest

from app.errors import ImportFailed, NotNow
from app.live.pipeline import Pipeline
from app.live.pipeline_factory import PipelineFactory
from app.sessions.transfer import import_jobs
from app.sessions.transfer.import_jobs import ImportJobs, ImportState
from app.sources.loaded_battery import LoadedBattery
from app.sources.recordings.import_mapping import ImportMapping
from app.words import render
from tests.in_process import InProcess

PROFILE = ImportMapping(time="t", current="I", voltages="Cell {n}")
TABLE = "t,I,Cell 1,Cell 2\n" + "".join(f"{row / 10},12,3.7,3.71\n" for row in range(5))


class Watched(ImportJobs):
    """Keeps every state that a reader could have seen."""

    def __init__(self, *arguments):
        self.told: list[ImportState | None] = []
        self.is_noted = threading.Event()
        self.notes = []
        super().__init__(*arguments, self.take, InProcess())

    def take(self, severity, code, message):
        self.notes.append((severity, code))
        self.is_noted.set()

    def __setattr__(self, name, value):
        super().__setattr__(name, value)
        if name == "state":
            self.told.append(value)

    def run(self, body: str | bytes, profile: ImportMapping = PROFILE, name: str = "theirs.csv") -> ImportState:
        """Import a file and return the state at the end."""
        number, path = self.new_path(name)
        path.write_bytes(body.encode() if isinstance(body, str) else body)
        self.inspect(number, path)
        self.start(number, profile, dbc=None, name="")
        for thread in threading.enumerate():
            if thread.name == "job":
                thread.join(30)
        return self.told[-1]


def pipeline(battery: LoadedBattery) -> Pipeline:
    return PipelineFactory("coulomb", None, battery).pipeline("replay")


@pytest.fixture
def jobs(tmp_path):
    return Watched(tmp_path, pipeline)


def test_an_import_is_over_in_the_moment_in_which_its_session_is_known(jobs):
    end = jobs.run(TABLE)
    assert (end.is_running, end.error, end.done) == (False, None, 5)
    ended = [state for state in jobs.told if state is not None and not state.is_running]
    assert [state.session_id for state in ended] == [end.session_id] != [None]
    assert jobs.is_noted.is_set()


def test_what_cannot_be_imported_is_over_with_its_reason(jobs):
    end = jobs.run(TABLE, replace(PROFILE, current="Strom"))
    assert "no such column" in render(end.error)
    assert [state for state in jobs.told if state is not None and not state.is_running] == [end]
    assert jobs.notes == [("warning", "import-failed")]


def test_a_mistake_of_ours_ends_the_import_too(jobs, monkeypatch):
    def fail(*_: object, **__: object) -> None:
        raise KeyError("a mistake")

    monkeypatch.setattr(import_jobs, "import_file", fail)
    end = jobs.run(TABLE)
    assert (end.is_running, end.error) == (False, "'a mistake'")
    assert jobs.notes == [("warning", "import-failed")]


def test_one_import_at_a_time(jobs, monkeypatch):
    go_on = threading.Event()
    take_over = import_jobs.import_file

    def slow(*arguments: object, **options: object) -> object:
        go_on.wait(30)
        return take_over(*arguments, **options)

    monkeypatch.setattr(import_jobs, "import_file", slow)
    number, path = jobs.new_path("theirs.csv")
    path.write_text(TABLE)
    jobs.inspect(number, path)
    assert jobs.start(number, PROFILE, dbc=None, name="").is_running
    with pytest.raises(NotNow, match=r"theirs\.csv"):
        jobs.start(number, PROFILE, dbc=None, name="")
    go_on.set()
    assert jobs.is_noted.wait(30)
    with pytest.raises(ImportFailed):  # taken over, so it is gone
        jobs.start(number, PROFILE, dbc=None, name="")


def test_an_upload_is_looked_at_before_it_is_imported(jobs):
    number, path = jobs.new_path("theirs.csv")
    path.write_text(TABLE)
    jobs.inspect(number, path)
    found = jobs.preview(number, PROFILE, ["voltage"], dbc=None)
    assert (found.understood.rows, len(found.cells), found.profile) == (5, 2, PROFILE)
    assert jobs.state is None
    with pytest.raises(ImportFailed, match="no such upload"):
        jobs.preview(number, PROFILE, [], dbc=99)
