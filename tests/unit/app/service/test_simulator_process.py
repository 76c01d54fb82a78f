import sys
import time

import pytest

from app.errors import ConfigError
from app.service import simulator_process
from app.service.settings import Settings
from app.service.simulator_process import SimulatorProcess, choose_ports

READY = "import sys; print('ready', flush=True); sys.stdin.read()"


@pytest.fixture
def make(tmp_path):
    made = []

    def make(program: str) -> SimulatorProcess:
        process = SimulatorProcess(Settings(data=tmp_path))
        process._arguments = [sys.executable, "-c", program]
        made.append(process)
        return process

    yield make
    for process in made:
        process.stop()


@pytest.mark.parametrize("pty", [True, False])
def test_the_service_reaches_what_the_simulator_opens(pty):
    ports = choose_ports(pty=pty)
    if pty:
        assert ports.serial_argument == f"pty:{ports.serial_url}"
        ports.folder.rmdir()
    else:
        port = ports.serial_argument.removeprefix("tcp:")
        assert ports.serial_url == f"socket://127.0.0.1:{port}"
        assert f":{port}?" not in ports.can_url
        assert ports.folder is None


def test_it_leaves_no_folder_and_no_process(make):
    simulator = make(READY)
    simulator.start()
    process = simulator._process
    assert process.poll() is None
    assert simulator.ports.folder.is_dir()
    simulator.stop()
    assert process.poll() is not None
    assert not simulator.ports.folder.exists()
    assert not simulator._thread.is_alive()


def test_one_that_ends_at_once_is_said(make):
    with pytest.raises(ConfigError, match="code 3"):
        make("raise SystemExit(3)").start()


def test_one_that_dies_later_is_started_again(make, monkeypatch):
    monkeypatch.setattr("app.sources.links.backoff.Backoff.next_s", lambda self: 0.01)
    simulator = make(READY)
    simulator.start()
    first = simulator._process
    first.kill()
    deadline = time.monotonic() + 10
    while simulator._process is first:
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_one_that_does_not_listen_is_killed(make, monkeypatch):
    monkeypatch.setattr(simulator_process, "STOP_S", 0.2)
    simulator = make(
        "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('ready', flush=True); time.sleep(60)"
    )
    simulator.start()
    simulator.stop()
    assert simulator._process.wait(5) != 0
