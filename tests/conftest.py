"""What tests of every kind share: the real service as a process, and the C reference built into a master on this PC.

A module whose tests shall hold on either master says so: `MASTERS = ("simulated", "c")`.
"""

import os
import re
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import httpx
import pytest

START_S = 30.0
TESTS_FOLDER = Path(__file__).parent
SLOWEST_FIRST = ("e2e", "integration", "numeric", "property", "docs", "unit")
C_FOLDER = TESTS_FOLDER.parent / "firmware_protocol" / "c"
C_FLAGS = ("-std=c99", "-O1", "-g", "-Wall", "-Wextra", "-Werror")
C_SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")


def compile_c(program: Path, *sources: Path) -> Path:
    """Compile sources of the C reference, with sanitizers where gcc has them; skips without gcc, in CI it fails."""
    if shutil.which("gcc") is None:
        missing = "gcc is missing; install it (Debian: apt-get install gcc)"
        pytest.fail(missing) if os.environ.get("CI") else pytest.skip(missing)
    command = ["gcc", *C_FLAGS, "-I", str(C_FOLDER), *map(str, sources), "-o", str(program)]
    built = subprocess.run([*command, *C_SANITIZERS], capture_output=True, text=True, check=False)
    if built.returncode and "cannot find" in built.stderr:
        built = subprocess.run(command, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    return program


@dataclass
class CMaster:
    """The C reference as a master behind a pseudo-terminal, its EEPROM in a file that outlives it."""

    program: Path
    folder: Path
    options: tuple[str, ...] = ()
    process: subprocess.Popen[str] | None = None

    @property
    def link(self) -> Path:
        """What `--serial` is given."""
        return self.folder / "c-master"

    def start(self, *arguments: str) -> "CMaster":
        """Switch it on; the port is there on return."""
        eeprom = ("--eeprom", str(self.folder / "c-eeprom.bin"))
        self.folder.mkdir(parents=True, exist_ok=True)
        self.process = subprocess.Popen(
            [self.program, "--serial", self.link, *eeprom, *self.options, *arguments], stdout=subprocess.PIPE, text=True
        )
        assert self.process.stdout.readline() == "ready\n"
        return self

    def stop(self) -> int:
        """Switch it off, if it still runs; its exit status."""
        if self.process.poll() is None:
            self.process.terminate()
        status = self.process.wait(10)
        self.process.stdout.close()
        return status


@dataclass
class Service:
    """`voltwall serve` as a process of its own."""

    data: Path
    arguments: list[str]
    environment: dict[str, str] = field(default_factory=dict)
    process: subprocess.Popen[str] | None = None
    base_url: str = ""
    lines: list[str] = field(default_factory=list)
    reader: threading.Thread | None = None
    c_master: CMaster | None = None  # on which it runs, switched on and off with it

    def start(self) -> "Service":
        """Start and wait for the line that names the address."""
        self.lines = []
        serial = () if self.c_master is None else ("--serial", str(self.c_master.start().link))
        ready = threading.Event()
        self.process = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "app.cli",
                "serve",
                "--port",
                "0",
                "--data",
                str(self.data),
                *self.arguments,
                *serial,
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=os.environ | {"PYTHONUNBUFFERED": "1"} | self.environment,
        )

        def read(process: subprocess.Popen[str]) -> None:
            with process.stdout:
                for line in process.stdout:
                    self.lines.append(line.rstrip())
                    if match := re.search(r"Voltwall: (http://\S+)", line):
                        self.base_url = match[1]
                        ready.set()
            ready.set()

        self.reader = threading.Thread(target=read, args=(self.process,), daemon=True)
        self.reader.start()
        assert ready.wait(START_S), "\n".join(self.lines)
        assert self.base_url, "\n".join(self.lines)
        return self

    def client(self, **options) -> httpx.Client:
        """An HTTP client of /api/v1."""
        return httpx.Client(base_url=self.base_url + "/api/v1", timeout=20, **options)

    def kill(self) -> None:
        """SIGKILL, as a power cut would."""
        self.process.send_signal(signal.SIGKILL)
        self.process.wait(10)
        self.reader.join(10)
        if self.c_master is not None:
            self.c_master.stop()

    def stop(self) -> int:
        """SIGTERM and wait; the exit code."""
        if self.process.poll() is None:
            self.process.terminate()
        try:
            return self.process.wait(20)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise
        finally:
            self.reader.join(10)
            if self.c_master is not None:
                self.c_master.stop()

    def wait_for(self, condition: Callable[[dict], object], seconds: float = 20.0) -> dict:
        """Read snapshots off the websocket until one fulfils a condition; returns it."""
        import json
        import time

        from websockets.sync.client import connect

        deadline = time.monotonic() + seconds
        last: dict = {}
        with connect(self.base_url.replace("http", "ws") + "/api/v1/live", max_size=1 << 22) as socket:
            while (left := deadline - time.monotonic()) > 0:
                try:
                    last = json.loads(socket.recv(timeout=left))
                except TimeoutError:
                    break
                if condition(last):
                    return last
        summary = {name: last.get(name) for name in ("accumulator", "links", "master", "alarms", "age")}
        raise AssertionError(f"not within {seconds} s; last: {summary}")


@pytest.fixture(scope="session")
def build_c() -> Callable[..., Path]:
    """Compile: program, sources."""
    return compile_c


@pytest.fixture(scope="session")
def c_master_program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The program `firmware_protocol/c/host/master.c`, built once."""
    sources = (*sorted(C_FOLDER.glob("vw_*.c")), *sorted((C_FOLDER / "host").glob("*.c")))
    return compile_c(tmp_path_factory.mktemp("c-master") / "master", *sources)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Start with the folders whose files take longest, so that all workers end at nearly the same time."""
    if config.getoption("dist", "no") != "no":
        rank = {name: number for number, name in enumerate(SLOWEST_FIRST)}
        items.sort(key=lambda item: rank.get(item.path.relative_to(TESTS_FOLDER).parts[0], 0))


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run what needs a master once on each that its module names."""
    masters = getattr(metafunc.module, "MASTERS", None)
    if masters is not None and "master" in metafunc.fixturenames:
        metafunc.parametrize("master", masters, indirect=True, scope="module")


@pytest.fixture(scope="module")
def master(request: pytest.FixtureRequest) -> str:
    """What the services of this module read: `simulated`, or `c`."""
    return getattr(request, "param", "simulated")


def c_master_for(master: str, folder: Path, request: pytest.FixtureRequest) -> CMaster | None:
    """The C master that goes with a service, None on the simulated one."""
    return CMaster(request.getfixturevalue("c_master_program"), folder) if master == "c" else None


@pytest.fixture
def make_service(tmp_path: Path, master: str, request: pytest.FixtureRequest) -> Iterator[Callable[..., Service]]:
    """Start services that are stopped at the end."""
    made: list[Service] = []

    def make(*arguments: str, data: Path | None = None, start: bool = True, **environment: str) -> Service:
        c_master = None if "--serial" in arguments else c_master_for(master, tmp_path / "car", request)
        service = Service(data or tmp_path / "data", list(arguments), environment, c_master=c_master)
        made.append(service)
        return service.start() if start else service

    yield make
    for service in made:
        if service.process is not None and service.process.poll() is None:
            service.kill()


@pytest.fixture(scope="module")
def scenario() -> str:
    """What the simulated car of this module does."""
    return "race-day"


@pytest.fixture(scope="module")
def service(
    tmp_path_factory: pytest.TempPathFactory, master: str, scenario: str, request: pytest.FixtureRequest
) -> Iterator[Service]:
    """One service for all tests of a module; it delivers snapshots already."""
    folder = tmp_path_factory.mktemp("service")
    c_master = c_master_for(master, folder, request)
    running = Service(folder / "data", ["--seed", "1", "--scenario", scenario], c_master=c_master).start()
    has_can = c_master is None
    running.wait_for(
        lambda s: s["accumulator"]["loaded_cells"] == 96 and (s["links"]["can"]["state"] == "live" or not has_can)
    )
    yield running
    running.stop()
