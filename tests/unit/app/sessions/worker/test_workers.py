"""Against real processes: what a job may not do, and what the next one finds."""

import gzip
import os
import signal
import subprocess
import time
from contextlib import closing
from pathlib import Path

import pytest

from app.errors import ImportFailed, LimitExceeded, NotNow, WorkerEnded
from app.sessions.transfer.import_jobs import columns_of
from app.sessions.worker import JobLimits, Workers, command_of
from app.sessions.worker import workers as module
from app.sessions.worker.process import NICENESS
from app.words import Message, render
from firmware_protocol.dbc_import import from_dbc
from firmware_protocol.errors import DecodeError

FEW = JobLimits(20, 256 << 20)


@pytest.fixture(scope="module")
def workers():
    made = Workers()
    yield made
    made.close()


def hold(size: int) -> int:
    return len(bytearray(size))


def turn() -> None:
    while True:
        pass


def sleep(seconds: float) -> None:
    time.sleep(seconds)


def end() -> None:
    os._exit(7)


def be_killed() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def fail() -> None:
    raise ImportFailed("their.csv", Message("file-empty"))


def throw(kind: type[Exception]) -> None:
    raise kind("of the job")


def fail_oddly() -> None:
    raise type("Odd", (Exception,), {})("of no module")


def nest() -> None:
    nest()


def count(to: int, *, on_progress) -> int:
    for number in range(to):
        on_progress(number, to)
    return to


def about() -> tuple[int, int]:
    return os.getpid(), os.nice(0)


def test_a_job_runs_in_another_process_after_all_others(workers):
    process, niceness = workers.run(FEW, about)
    assert process != os.getpid()
    assert niceness == min(19, os.nice(0) + NICENESS)
    assert workers.run(FEW, about)[0] == process  # which is kept


def test_progress_is_reported_here(workers):
    reported = []
    job = workers.start(FEW, count, 3, on_progress=lambda *values: reported.append(values))
    assert job.result(30) == 3
    assert reported == [(0, 3), (1, 3), (2, 3)]


def test_a_job_that_is_cancelled_ends_alone():
    with closing(Workers(2)) as workers:
        job, other = workers.start(FEW, sleep, 600.0), workers.start(FEW, about)
        assert job.cancel()
        with pytest.raises(WorkerEnded):
            job.result(30)
        assert not job.cancel()
        assert other.result(30)


def test_errors_of_ours_come_back_as_they_are(workers):
    with pytest.raises(ImportFailed) as caught:
        workers.run(FEW, fail)
    assert (caught.value.source, render(caught.value.message)) == ("their.csv", "their.csv: the file is empty")


@pytest.mark.parametrize("kind", [EOFError, BrokenPipeError])
def test_an_end_of_file_within_the_job_is_not_the_end_of_its_process(workers, kind):
    process, _ = workers.run(FEW, about)
    with pytest.raises(kind):
        workers.run(FEW, throw, kind)
    assert workers.run(FEW, about)[0] == process


def test_an_error_of_another_constructor_comes_back_whole(workers):
    with pytest.raises(DecodeError) as caught:
        workers.run(FEW, from_dbc, "nothing")
    assert (caught.value.what, str(caught.value)) == ("DBC", "DBC: no message (BO_) in it")


def test_an_error_that_cannot_be_sent_keeps_its_text(workers):
    with pytest.raises(Exception, match="of no module"):
        workers.run(FEW, fail_oddly)


@pytest.mark.parametrize(
    ("limits", "job", "words"),
    [
        (FEW, (hold, 1 << 30), "256 MB of memory"),
        (JobLimits(1), (turn,), "1 s of processor time"),
        (FEW, (nest,), "nested deeper"),
    ],
    ids=["memory", "time", "nesting"],
)
def test_a_limit_is_named_and_the_next_job_runs(workers, limits, job, words):
    with pytest.raises(LimitExceeded, match=words):
        workers.run(limits, *job)
    assert workers.run(FEW, hold, 1000) == 1000


@pytest.mark.parametrize(("job", "code"), [(end, "code 7"), (be_killed, "code -9")], ids=["exit", "SIGKILL"])
def test_a_process_that_ended_is_no_limit_and_the_next_job_runs(workers, job, code):
    with pytest.raises(WorkerEnded, match=code):
        workers.run(FEW, job)
    assert workers.run(FEW, hold, 1000) == 1000


def test_one_that_waits_for_ever_is_ended(workers):
    with pytest.raises(LimitExceeded, match="stopped after the time limit"):
        workers.run(JobLimits(20, wall_s=0.2), sleep, 600.0)


def test_too_many_at_once_are_refused(monkeypatch):
    monkeypatch.setattr(module, "WAITING", 0)
    with pytest.raises(NotNow):
        Workers().run(FEW, about)


def test_jobs_that_are_started_run_at_once_and_keep_their_processes():
    with closing(Workers(2, most_idle=2)) as workers:
        both = [workers.start(FEW, sleep, 600.0), workers.start(FEW, fail)]
        with pytest.raises(ImportFailed, match="the file is empty"):
            both[1].result(30)
        assert both[0].running()
        process, _ = workers.start(FEW, about).result(30)
        assert workers.start(FEW, about).result(30)[0] == process
        workers.close()
        with pytest.raises(WorkerEnded):
            both[0].result(30)
        with pytest.raises(NotNow):
            workers.run(FEW, about)


def test_a_gzip_bomb_is_refused_with_its_limit(workers, tmp_path):
    path = tmp_path / "bomb.csv.gz"
    with gzip.open(path, "wb", compresslevel=9) as file:
        for _ in range(64):
            file.write(b"0.0,1.0\n" * (1 << 17))
    with pytest.raises(LimitExceeded, match=r"larger than 1\d MB"):
        workers.run(FEW, columns_of, path)


def test_a_file_in_the_working_folder_is_not_run_in_place_of_a_library(tmp_path: Path) -> None:
    for name in ("can.py", "serial.py", "app.py", "simulator.py"):
        (tmp_path / name).write_text("raise SystemExit('run from the working folder')")
    done = subprocess.run(
        command_of("simulator.cli", "--help"), cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "--scenario" in done.stdout


def test_arguments_arrive_as_they_are(tmp_path: Path) -> None:
    command = command_of("simulator.cli", "--scenario", "no such scenario")
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "no such scenario" in done.stderr
