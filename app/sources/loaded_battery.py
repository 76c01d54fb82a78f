"""A battery with all that decodes it: its profile, what that includes, and its DBCs, read and as bytes."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from pathlib import Path

from app.battery.battery import Battery
from app.battery.library import profile_files, profile_of
from app.battery.shape import TEAM_PROFILE
from app.battery.source import DbcMapping, MemoryMap, Source, TableMapping
from app.battery.table_reader import ProfileError
from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.definitions import Definitions
from app.words import Message

CLASSIC_BYTES = 8  # data bytes of a classic CAN frame; more is CAN FD


@dataclass(frozen=True, slots=True)
class LoadedBattery:
    """A battery, its source, and its message definitions; none of a master."""

    battery: Battery
    source: Source
    definitions: Definitions
    files: Mapping[str, bytes]  # the profile first, then what it names; equal files are the same battery

    @property
    def dbc_mapping(self) -> DbcMapping | None:
        """Its mapping of DBC signals, None without one."""
        return self.source if isinstance(self.source, DbcMapping) else None

    @property
    def has_memory_map(self) -> bool:
        """Whether its values are those of our own master."""
        return isinstance(self.source, MemoryMap)

    @property
    def uses_fd(self) -> bool:
        """Its messages are longer than classic CAN allows."""
        return any(message.length > CLASSIC_BYTES for message in self.definitions.messages)


def load_battery(name: str, *, own_folder: bool = False) -> LoadedBattery:
    """Return a bundled battery by its name, or the one of a profile's file.

    Args:
        name: of a bundled battery, or the path of a profile.
        own_folder: it comes from a request: no file outside of its own folder is read.

    Raises:
        ProfileError: the profile, or a file that it names, cannot be read, or is wrong.
        ImportFailed, ExtraMissing: a DBC cannot be read.
    """
    loaded = battery_from_files(profile_files(name, own_folder=own_folder))
    if isinstance(loaded.source, TableMapping):
        raise ProfileError(name, None, "source.kind", "table", Message("table-in-session"))
    cell = Path(name).parent / loaded.battery.cell
    if not cell.is_file():
        return loaded
    return replace(loaded, battery=replace(loaded.battery, cell=str(cell)))  # next to the profile


def battery_from_files(files: Mapping[str, bytes]) -> LoadedBattery:
    """Return the battery of such files, as a session keeps them.

    Raises:
        ProfileError: the profile is wrong.
        ImportFailed, ExtraMissing: a DBC cannot be read.
    """
    return _read(tuple(files.items()))


@lru_cache(maxsize=16)  # a page reads one session after the other of the same battery
def _read(items: tuple[tuple[str, bytes], ...]) -> LoadedBattery:
    files = dict(items)
    profile = profile_of(files)
    definitions = Definitions(())
    for name in profile.source.dbc if isinstance(profile.source, DbcMapping) else ():
        if name not in files:
            raise ProfileError(profile.file, None, "source.dbc", name, Message("no-such-file"))
        definitions = definitions.joined(parse_definitions(files[name], name))
    return LoadedBattery(profile.battery, profile.source, definitions, files)


@cache
def team_battery() -> LoadedBattery:
    """The team's own, which sessions of earlier versions are of."""
    return load_battery(TEAM_PROFILE)
