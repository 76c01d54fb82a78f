"""What tests of every kind share: the real service as a process, on the simulated car.

A module whose tests change nothing in the service says `READS_ONLY = True`, and shares one with all others that do.
"""

import gc
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

import app  # noqa: F401  before numpy: it keeps each process to one thread
from firmware_protocol.config_image import default_image
from firmware_protocol.eeprom import EEPROM_SIZE, encode_slot
from hatch_build import build_libraries
from tests.bytecode import write_bytecode
from tests.campaign import IS_FULL, examples, report_figure
from tests.service_process import Service

# On a loaded machine the time of one example says nothing.
settings.register_profile(
    "voltwall", max_examples=examples(100), deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("voltwall")

TESTS_FOLDER = Path(__file__).parent
ROOT = TESTS_FOLDER.parent
READ_SERVICE = pytest.StashKey[Service]()
WAITING = ("e2e", "integration")  # most of their time they wait for a car, a service or a page
LONGEST = (  # half a minute and more
    "integration/test_evidence.py",
    "integration/test_simulator_scenarios.py",
    "integration/test_stalled_disk.py",
    "e2e/test_debrief.py",
    "e2e/test_parameters_page.py",
)
LONGEST_BEGIN_BY = (
    0.5  # share of the run: not at its end, and not together, where one would compute and the others wait
)
WAITING_ENDS_AT = 0.8  # share of the run: the end is many short files, which all processes share
MEMORY = Path("/dev/shm")
MEMORY_BYTES = 3_000_000_000  # free, for the files of a whole run


def pytest_configure(config: pytest.Config) -> None:
    """Bring the libraries in C and the bytecode up to date with their sources."""
    gc.disable()  # until everything is collected: nothing of that is garbage
    if not IS_FULL:
        keep_files_in_memory()
    if not hasattr(config, "workerinput"):  # pytest-xdist's
        build_libraries(ROOT)
        write_bytecode(config)


def keep_files_in_memory() -> None:
    """Let temporary folders be in memory: thousands of commits would each wait for the disk, one after the other.

    What a disk does when it is full, fails or loses its power is tested with disks made for that, and the full
    campaign runs on the real one. Where there is little memory, or where no program may be run from it, as in most
    containers, the folders stay where they are.
    """
    if "TMPDIR" in os.environ or not os.access(MEMORY, os.W_OK) or os.statvfs(MEMORY).f_flag & os.ST_NOEXEC:
        return
    if shutil.disk_usage(MEMORY).free > MEMORY_BYTES:
        os.environ["TMPDIR"] = str(MEMORY)
        tempfile.tempdir = None  # asked for before: look again


@pytest.fixture
def tell() -> Callable[[str], None]:
    """Say the figure of a campaign, in one line."""
    return report_figure


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """Two processes per core: where a test waits for a service or a page, another one computes."""
    return 2 * (os.cpu_count() or 1)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mix files that wait with files that compute, so that all cores are busy from the start to the end.

    First comes what shares a service, so that this need not run for long; the longest start one after the other.
    """
    if not hasattr(config, "workerinput"):  # pytest-xdist's
        return
    folders: dict[str, list[Path]] = {}
    for path in dict.fromkeys(item.path for item in items if not reads_only(item)):
        folders.setdefault(path.relative_to(TESTS_FOLDER).parts[0], []).append(path)
    place: dict[Path, float] = {}
    for folder, paths in folders.items():
        end = WAITING_ENDS_AT if folder in WAITING else 1.0
        place |= {path: end * number / len(paths) for number, path in enumerate(paths)}
    longest = [path for name in LONGEST if (path := TESTS_FOLDER / name) in place]
    place |= {path: LONGEST_BEGIN_BY * number / len(longest) for number, path in enumerate(longest)}
    items.sort(key=lambda item: place.get(item.path, -1.0))


def pytest_collection_finish() -> None:
    """Look for garbage seldom, and not among what thousands of collected tests hold: a tenth of the processor time."""
    gc.freeze()
    gc.set_threshold(10_000, 50, 50)
    gc.enable()


def reads_only(item: pytest.Item | None) -> bool:
    """Whether a test changes nothing in the service, by its module's word."""
    return getattr(getattr(item, "module", None), "READS_ONLY", False)


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> None:
    """End the shared service before tests that do not need it: it would simulate, estimate and record beside them."""
    if READ_SERVICE in item.config.stash and not reads_only(nextitem):
        item.config.stash[READ_SERVICE].stop()
        del item.config.stash[READ_SERVICE]


@contextmanager
def services(folder: Path) -> Iterator[Callable[..., Service]]:
    """Start services with data in a folder; at the end they are stopped."""
    made: list[Service] = []

    def make(*arguments: str, data: Path | None = None, start: bool = True, **environment: str) -> Service:
        service = Service(data or folder / "data", list(arguments), environment)
        made.append(service)
        return service.start() if start else service

    yield make
    for service in made:
        if service.is_running:
            service.kill()


@pytest.fixture
def make_service(tmp_path: Path) -> Iterator[Callable[..., Service]]:
    """Start services for one test."""
    with services(tmp_path) as make:
        yield make


@pytest.fixture(scope="module")
def make_module_service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., Service]]:
    """Start services for all tests of a module."""
    with services(tmp_path_factory.mktemp("services")) as make:
        yield make


@pytest.fixture(scope="module")
def scenario() -> str:
    """What the simulated car of this module does."""
    return "race-day"


def live_service(folder: Path, scenario: str, *, is_stored: bool = False) -> Service:
    """A service that delivers snapshots of every cell already; the master's EEPROM is empty, or has the defaults."""
    if is_stored:  # a car that drives stores nothing
        (folder / "data").mkdir()
        (folder / "data" / "eeprom.bin").write_bytes(encode_slot(default_image(), 1).ljust(EEPROM_SIZE, b"\xff"))
    running = Service(folder / "data", ["--seed", "1", "--scenario", scenario]).start()
    running.wait_for(lambda s: s["accumulator"]["loaded_cells"] == 96 and s["links"]["can"]["state"] == "live")
    return running


def read_service(request: pytest.FixtureRequest, make_folder: pytest.TempPathFactory) -> Service:
    """One service for all tests that only read; its master has a stored configuration, as in the car."""
    stash = request.config.stash
    if READ_SERVICE not in stash:
        stash[READ_SERVICE] = live_service(make_folder.mktemp("read"), "race-day", is_stored=True)
    return stash[READ_SERVICE]


@pytest.fixture(scope="module")
def service(
    tmp_path_factory: pytest.TempPathFactory, scenario: str, request: pytest.FixtureRequest
) -> Iterator[Service]:
    """One service for all tests of a module, or of all modules that only read."""
    if getattr(request.module, "READS_ONLY", False):
        yield read_service(request, tmp_path_factory)
        return
    is_stored = getattr(request.module, "IS_STORED", False)
    running = live_service(tmp_path_factory.mktemp("service"), scenario, is_stored=is_stored)
    yield running
    running.stop()
