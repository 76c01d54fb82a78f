"""A battery with all that decodes it: its profile, what that includes, and its DBCs, read and as bytes."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from pathlib import Path
from typing import Literal

from app.battery.battery import Battery
from app.battery.library import profile_files, profile_of
from app.battery.serial import SerialMapping
from app.battery.shape import TEAM_PROFILE
from app.battery.source import DbcMapping, MemoryMap, Source, TableMapping
from app.battery.table_reader import ProfileError
from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.definitions import Definitions
from app.sources.serial.checksums import checksum_of
from app.sources.serial.patterns import group_names
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
    def serial(self) -> SerialMapping | None:
        """Return the mapping of its serial line, where a profile describes one."""
        return self.source if isinstance(self.source, SerialMapping) else None

    @property
    def mapping(self) -> DbcMapping | SerialMapping | None:
        """Return the mapping of its frames, on CAN or a serial line; None of our own master and of a table."""
        return self.dbc_mapping or self.serial

    @property
    def has_memory_map(self) -> bool:
        """Return whether its values are those of our own master."""
        return isinstance(self.source, MemoryMap)

    @property
    def means_s(self) -> float:
        """Time over which each current of a table is a mean [s]; 0: instants."""
        return self.source.means_s if isinstance(self.source, TableMapping) else 0.0

    @property
    def has_checksum(self) -> bool | None:
        """True where each frame on its serial line has a checksum; None where it is on none."""
        return True if self.has_memory_map else None if self.serial is None else self.serial.has_checksum

    @property
    def kind(self) -> Literal["master", "dbc", "serial", "table"]:
        """Return the kind of source it is read by."""
        if self.has_memory_map:
            return "master"
        return "dbc" if self.dbc_mapping else "serial" if self.serial else "table"

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
    if isinstance(profile.source, SerialMapping):
        _check_serial(profile.file, profile.source)
    return LoadedBattery(profile.battery, profile.source, definitions, files)


def _check_serial(file: str, mapping: SerialMapping) -> None:
    """Refuse a checksum of no known kind, and an expression that is none.

    Raises:
        ProfileError: by its line.
        ExtraMissing: RE2 is needed and not installed.
    """
    for i, frame in enumerate(mapping.frames):
        if frame.checksum is not None and checksum_of(frame.checksum.kind) is None:
            path, limit = f"serial.frame[{i}].checksum", Message("serial-checksum")
            raise ProfileError(file, frame.line, path, frame.checksum.kind, limit)
    for i, line in enumerate(mapping.lines):
        if not line.pattern:
            continue
        try:
            names = group_names(line.pattern)
        except ValueError as error:
            raise ProfileError(file, line.row, f"serial.line[{i}].pattern", line.pattern, str(error)) from error
        for field in line.fields:
            if field.group not in names:
                limit = Message("one-of-these", names=names)
                raise ProfileError(file, field.line, f"serial.line[{i}].fields", field.group, limit)


@cache
def team_battery() -> LoadedBattery:
    """The team's own, which sessions of earlier versions are of."""
    return load_battery(TEAM_PROFILE)
