"""What tests of every kind share: the real service as a process, on the simulated car or on the C reference.

A module whose tests shall hold on either master says so: `MASTERS = ("simulated", "c")`.
"""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.c_programs import CMaster, build_program
from tests.service_process import Service

TESTS_FOLDER = Path(__file__).parent
SLOWEST_FIRST = ("e2e", "integration", "numeric", "property", "docs", "unit")


@pytest.fixture(scope="session")
def c_master_program() -> Path:
    """The program `firmware_protocol/c/host`."""
    return build_program("host")


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
        if service.is_running:
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
