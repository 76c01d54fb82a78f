"""The connection that a person chose on a page: a small file in the data folder.

What the command line or the environment names wins over all of it.
"""

import contextlib
import json
import os
import re
import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

from app.battery.by_shape import files_of_shape
from app.battery.library import bundled_profiles, profile_files
from app.battery.shape import TEAM_PROFILE
from app.errors import AppError, ConfigError, NotNow
from app.sources.data_file import checked, parse_object, replace_file, set_aside
from app.sources.links.can_bus import parse_bus
from app.sources.links.serial_url import check_url
from app.sources.loaded_battery import LoadedBattery, load_battery
from app.words import Message

if TYPE_CHECKING:  # `voltwall sessions --help` needs no learning
    from app.sources.dbc.infer.profile_draft import ProfileDraft

FILE = "connections.json"
Load = Callable[..., LoadedBattery]  # as `load_battery`
MOST_NAME = 200  # bytes of a file's name; most disks take 255
BATTERIES = "batteries"  # folder of uploaded profiles, one folder each


@dataclass(frozen=True, slots=True)
class Connections:
    """Links and battery; with no link the battery is simulated."""

    serial: str | None = None
    can: str | None = None
    battery: str = TEAM_PROFILE  # file, or name of a bundled one

    def check(self, *, by_operator: bool = False, load: Load = load_battery) -> None:
        """Refuse links that do not fit the battery, are none, or are none that a request may name.

        Args:
            by_operator: the command line or the environment names them, no request.
            load: reads the battery.

        Raises:
            ConfigError, ProfileError: names the setting and what it has to be.
            ImportFailed, ExtraMissing: a DBC of the battery cannot be read.
        """
        kind = load(self.battery, own_folder=not by_operator).kind
        if kind == "dbc" and self.serial is not None:
            raise ConfigError("serial", self.serial, Message("battery-needs-can", battery=self.battery))
        if kind == "serial" and self.can is not None:
            raise ConfigError("can", self.can, Message("battery-on-serial", battery=self.battery))
        if self.serial is not None:
            check_url(self.serial, by_operator=by_operator)
        if self.can is not None and first_bus(self.can) != self.can:
            raise ConfigError("can", self.can, Message("one-bus"))
        if self.can is not None:
            parse_bus(self.can, by_operator=by_operator)


def first_bus(urls: str) -> str:
    """Return the battery's own of several buses, which earlier versions named with commas between them."""
    return re.split(r",(?=[a-z_0-9]+:)", urls)[0]


NAMES = tuple(field.name for field in fields(Connections))


def load_connections(folder: Path) -> Connections | None:
    """Return what was chosen, None where nothing was; a file that is no such choice is set aside.

    Raises:
        ConfigError: the disk does not give it, or does not let it be renamed.
    """
    path = folder / FILE
    if not path.is_file():
        return None
    try:
        try:
            connections = _choice(path.read_bytes())
        except (TypeError, ValueError):
            set_aside(path)
            return None
    except OSError as error:
        raise ConfigError("data", path, str(error)) from error
    check_battery(folder, connections.battery)
    return connections


def _files_of(battery: str) -> dict[str, bytes]:
    """The files of a battery, by which a changed profile of the same name is another one; none where it has none."""
    with contextlib.suppress(AppError):
        return dict(profile_files(battery))
    return {}


def check_battery(folder: Path, battery: str) -> None:
    """Refuse a battery that a request may not name: a file that was not uploaded into the data folder.

    Raises:
        ConfigError: it is neither a bundled nor an uploaded one, nor a shape to simulate.
        ProfileError: a shape without cells, or with too many.
    """
    if battery in bundled_profiles() or files_of_shape(battery) is not None:
        return
    if Path(battery).absolute() not in [path.absolute() for path in _uploaded(folder)]:
        raise ConfigError("battery", battery, Message("battery-not-offered"))


def _uploaded(folder: Path) -> list[Path]:
    return sorted((folder / BATTERIES).glob("*/*.toml"))


def _choice(content: bytes) -> Connections:
    """Return the choice that a file holds.

    Raises:
        TypeError, ValueError: it is none.
    """
    chosen = checked(Connections(**parse_object(content)))
    chosen = chosen if chosen.can is None else replace(chosen, can=first_bus(chosen.can))
    if "" in (chosen.serial, chosen.can, chosen.battery):
        raise ValueError("an empty name")
    return chosen


def save_connections(folder: Path, connections: Connections) -> None:
    """Write the file, whole or not at all.

    Raises:
        OSError: the disk does not take it.
    """
    replace_file(folder / FILE, (json.dumps(asdict(connections), indent=2) + "\n").encode())


class Setup:
    """Chooses what the service reads; a choice takes effect when the service starts again, in the same process."""

    def __init__(self, folder: Path, in_force: Connections, *, fixed: bool = True) -> None:
        self._folder = folder
        self.in_force = in_force  # what is read now
        self.fixed = fixed  # command line or environment name it, or nothing could start again
        self.instance = os.urandom(4).hex()  # another one after each start
        self.on_choice: Callable[[], None] = lambda: None  # starts the service again
        self.load: Load = load_battery  # reads a battery's files; the service does so in a limited process
        self._loaded: dict[Path, tuple[int, LoadedBattery]] = {}  # uploaded ones, with when they changed [ns]
        self._files_in_force = _files_of(in_force.battery)
        self.draft: tuple[str, ProfileDraft] | None = None  # what is being learned, by its id

    def begin_draft(self, draft: "ProfileDraft") -> str:
        """Keep what is being learned, one at a time; return its id."""
        self.end_draft()
        self.draft = os.urandom(4).hex(), draft
        return self.draft[0]

    def replace_draft(self, draft_id: str, draft: "ProfileDraft") -> "ProfileDraft":
        """Keep the same draft by more frames, unless another one began or it ended meanwhile; return it."""
        if self.draft is not None and self.draft[0] == draft_id:
            self.draft = draft_id, draft
        return draft

    def end_draft(self) -> None:
        """Give the bus of what was being learned free."""
        if self.draft is not None:
            self.draft[1].close()
        self.draft = None

    @property
    def chosen(self) -> Connections | None:
        """Return the connection that was chosen, None where there is none, or where the file cannot be read."""
        try:
            return load_connections(self._folder)
        except ConfigError:
            return None

    @property
    def is_needed(self) -> bool:
        """Return whether no connection was ever chosen."""
        return not self.fixed and self.chosen is None

    def choose(self, connections: Connections) -> bool:
        """Keep a choice and start again with it; return False where the service reads just that and runs on.

        Raises:
            NotNow: the command line or the environment says what is read.
            ConfigError: it cannot work; names the setting and what it has to be.
        """
        if self.fixed:
            raise NotNow(Message("named-on-command-line"))
        if connections.battery != self.in_force.battery:
            check_battery(self._folder, connections.battery)
        connections.check(load=self.load)
        self.end_draft()
        save_connections(self._folder, connections)
        if connections == self.in_force and _files_of(connections.battery) == self._files_in_force:
            return False
        self.on_choice()
        return True

    def batteries(self) -> dict[str, LoadedBattery]:
        """Return bundled, uploaded and present batteries by what `--battery` takes, without those that are wrong."""
        batteries = {}
        for name in (self.in_force.battery, *bundled_profiles()):
            with contextlib.suppress(Exception):
                batteries[name] = load_battery(name)
        for path in _uploaded(self._folder):
            with contextlib.suppress(Exception):
                batteries[str(path)] = self._uploaded_battery(path)
        return batteries

    def _uploaded_battery(self, path: Path) -> LoadedBattery:
        """An uploaded battery, read again where its profile changed."""
        changed_ns = path.stat().st_mtime_ns
        loaded = self._loaded.get(path)
        if loaded is None or loaded[0] != changed_ns:
            loaded = self._loaded[path] = changed_ns, self.load(str(path), own_folder=True)
        return loaded[1]

    def upload(self, files: dict[str, bytes]) -> str:
        """Keep a profile and its DBCs in the data folder; return the name by which it can be chosen.

        Args:
            files: by their names, the profile among them.

        Raises:
            ConfigError: there is not exactly one profile, a name is no file's, or the profile is wrong.
            ImportFailed, ExtraMissing: a DBC cannot be read.
            OSError: the disk does not take it; one of this name stays as it was.
        """
        profiles = [name for name in files if name.endswith(".toml")]
        if len(profiles) != 1:
            raise ConfigError("files", ", ".join(files), Message("one-profile"))
        for name in files:
            is_plain = Path(name).name == name and name.isprintable() and not name.startswith(".")
            if not is_plain or not 0 < len(name.encode()) <= MOST_NAME:
                raise ConfigError("files", name, Message("plain-file-name"))
        profile = profiles[0]
        batteries = self._folder / BATTERIES
        batteries.mkdir(parents=True, exist_ok=True)
        folder = batteries / profile.removesuffix(".toml")
        with tempfile.TemporaryDirectory(prefix=".new-", dir=batteries) as scratch:
            fresh, before = Path(scratch) / "new", Path(scratch) / "before"
            fresh.mkdir()
            for name, data in files.items():
                replace_file(fresh / name, data)
            self.load(str(fresh / profile), own_folder=True)
            if folder.exists():
                folder.rename(before)
            try:
                fresh.rename(folder)
            except OSError:
                if before.exists():
                    before.rename(folder)
                raise
        return str(folder / profile)
