import sys
import threading

import pytest

from app.errors import ConfigError
from app.service.settings import Settings
from app.service.simulator_process import SimulatorProcess, choose_ports
from app.sources.links.serial import Backoff

READY = "import sys; print('ready', flush=True); sys.stdin.read()"


@pytest.fixture
def make(tmp_path):
    made = []

    def make(program: str, **more) -> SimulatorProcess:
        process = SimulatorProcess(Settings(data=tmp_path), **more)
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


def test_one_that_dies_later_is_started_again(make):
    deaths = threading.Semaphore(0)

    class CountedBackoff(Backoff):
        def next_s(self) -> float:
            deaths.release()
            return 0.01

    make("print('ready', flush=True)", backoff=CountedBackoff()).start()
    for _ in range(2):  # the second one was started after the first had died
        assert deaths.acquire(timeout=10)


def test_one_that_does_not_listen_is_killed(make):
    deaf = "import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('ready', flush=True); signal.pause()"
    simulator = make(deaf, stop_s=0.2)
    simulator.start()
    simulator.stop()
    assert simulator._process.wait(5) != 0


def test_a_scenario_that_cannot_be_played_is_named_and_no_command(make):
    process = make("import sys; sys.exit(2)")
    process._scenario = "no-such"
    with pytest.raises(ConfigError) as refused:
        process.start()
    assert str(refused.value) == "scenario = no-such: the simulator stopped with exit code 2, see its output above"
