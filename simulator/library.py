"""The scenarios that come with the simulator: found by name, and listed together with files that cannot be read."""

import functools
from dataclasses import dataclass
from pathlib import Path

from firmware_protocol.names import did_you_mean
from simulator.errors import ScenarioError
from simulator.scenario import Scenario
from simulator.scenario_file import load_scenario, recorded_scenario
from simulator.shape import TEAM, Shape

LIBRARY = Path(__file__).parent / "scenarios"


@dataclass(frozen=True, slots=True)
class Unreadable:
    """A file of the library that cannot be read, and why."""

    name: str
    reason: str


def library(folder: Path = LIBRARY, shape: Shape = TEAM) -> tuple[list[Scenario], list[Unreadable]]:
    """Return the folder's scenarios by name, and the files that are none for such a battery."""
    good, bad = [], []
    for path in sorted(folder.glob("*.toml")):
        try:
            good.append(_load(path, path.stat().st_mtime_ns, shape))
        except (ScenarioError, OSError) as error:
            bad.append(Unreadable(path.name, str(error).replace(str(path), path.name)))
    return good, bad


@functools.lru_cache(maxsize=128)
def _load(path: Path, _changed_ns: int, shape: Shape) -> Scenario:
    return load_scenario(path, shape)


def find_scenario(name_or_file: str, shape: Shape = TEAM) -> Scenario:
    """Return a scenario of the library by its name, one from a .toml file, or the replay of a recorded .csv.

    Raises:
        ScenarioError: there is neither, or the file makes no sense.
    """
    in_library = LIBRARY / f"{name_or_file}.toml"
    if in_library.parent == LIBRARY and in_library.exists():
        return load_scenario(in_library, shape)
    path = Path(name_or_file)
    if path.name.endswith((".csv", ".csv.gz")) and path.exists():
        return recorded_scenario(path)
    if path.suffix != ".toml" or not path.exists():
        names = sorted(item.stem for item in LIBRARY.glob("*.toml"))
        unknown = f"unknown scenario{did_you_mean(name_or_file, names) or '.'}"
        raise ScenarioError(name_or_file, f"{unknown} Give a .toml file, a recorded .csv, or one of {', '.join(names)}")
    return load_scenario(path, shape)
