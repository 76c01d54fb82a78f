"""A season estimated again while what does it is killed: the program itself, and a worker of a Dask cluster over TCP.

Runs in `make campaign` alone: a cluster of three processes takes longer to start than a test may take.
"""

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from tests.campaign import SIZE, campaign, of_size, report_figure
from tests.recorded.arrays import SessionMaker

PROJECT = Path(__file__).parents[2]
SESSIONS = of_size(8, 12, 20, 40)
pytestmark = [campaign(120, 240, 600), pytest.mark.skipif(SIZE == "sample", reason="in the campaign")]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """One session of some minutes."""
    time_s = np.arange(0.0, 60.0 * of_size(5, 5, 5, 15), 0.1)
    current_a = np.where(np.sin(0.5 * time_s) > 0.0, 60.0, 0.0)
    return SessionMaker(tmp_path_factory.mktemp("recorded"))(time_s, current_a, 3.7 - 0.003 * current_a)


@pytest.fixture
def season(recorded, tmp_path):
    folder = tmp_path / "sessions"
    folder.mkdir()
    for k in range(SESSIONS):
        shutil.copyfile(recorded, folder / f"session-{k:02}.sqlite")
    return tmp_path


def command(season, *options):
    return [sys.executable, "-m", "app.cli", "season", "estimate", str(season), *options]


def results(season):
    return {path: path.read_bytes() for path in season.glob("estimates/*/session-*.json")}


def wait_until(condition, process):
    while not condition():
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)


def test_a_killed_run_goes_on_where_it_was(season):
    first = subprocess.Popen(
        command(season, "--processes", "2"),
        cwd=PROJECT,
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        process_group=0,
    )
    wait_until(lambda: len(results(season)) >= 2, first)
    os.killpg(first.pid, signal.SIGKILL)
    first.communicate()
    kept = results(season)
    assert 2 <= len(kept) < SESSIONS
    for body in kept.values():
        json.loads(body)
    again = subprocess.run(command(season, "--processes", "2", "--json"), cwd=PROJECT, capture_output=True, check=True)
    told = json.loads(again.stdout)
    assert len(told["kept"]) == len(kept)
    assert len(told["estimated"]) == SESSIONS - len(kept)
    assert {path: results(season)[path] for path in kept} == kept
    report_figure(f"season: killed after {len(kept)} of {SESSIONS} sessions, then the other {len(told['estimated'])}")


@contextmanager
def cluster(workers):
    """A scheduler and workers, each a process, over TCP; gives its port and the workers."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    where = ["--host", "127.0.0.1", "--no-dashboard"]
    started = [[f"{sys.executable}", "-m", "distributed.cli.dask_scheduler", "--port", str(port), *where]]
    one = ["--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", "127.0.0.1", "--death-timeout", "30"]
    started += [[sys.executable, "-m", "distributed.cli.dask_worker", f"tcp://127.0.0.1:{port}", *one]] * workers
    processes = [
        subprocess.Popen(line, cwd=PROJECT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) for line in started
    ]
    try:
        yield port, processes[1:]
    finally:
        for process in processes:
            process.kill()
            process.wait()


def test_a_dask_worker_that_is_killed_loses_no_session(season):
    from distributed import Client

    with cluster(2) as (port, workers):
        with Client(f"tcp://127.0.0.1:{port}", timeout=60, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=60)
        began_s = time.monotonic()
        run = subprocess.Popen(
            command(season, "--engine", f"dask://127.0.0.1:{port}", "--json"),
            cwd=PROJECT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        wait_until(lambda: len(results(season)) >= 1, run)
        workers[0].kill()
        stdout, stderr = run.communicate()
        took_s = time.monotonic() - began_s
    assert run.returncode == 0, stderr.decode()
    told = json.loads(stdout)
    assert len(told["estimated"]) == SESSIONS
    made_by = {json.loads(body)["process"] for body in results(season).values()}
    assert made_by <= {worker.pid for worker in workers}
    assert workers[1].pid in made_by
    report_figure(
        f"season: {SESSIONS} sessions on Dask, one of two workers killed on the way: all done, {took_s:.0f} s"
    )
