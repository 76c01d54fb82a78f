"""Which columns of another program's recording are what: written once, kept as TOML, used for every file of that kind.

A pattern stands for many columns: `Cell {n} Voltage`, with several packs `Pack{p}_Cell{n}_V`; columns are taken in
the order of pack and number. In a CAN log names are signals of the DBC, also as Message.Signal; one signal whose cell
another signal of the same message tells is `CellVoltage[CellID]`.
"""

import json
import re
import tomllib
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from app.errors import ImportFailed

UNITS: dict[str, dict[str, tuple[float, float]]] = {  # factor and offset into ours
    "time": {"s": (1, 0), "ms": (1e-3, 0), "us": (1e-6, 0), "min": (60, 0), "h": (3600, 0)},
    "current": {"A": (1, 0), "mA": (1e-3, 0), "0.1A": (0.1, 0)},
    "voltage": {"V": (1, 0), "mV": (1e-3, 0), "0.1mV": (1e-4, 0)},
    "temperature": {"degC": (1, 0), "K": (1, -273.15), "degF": (5 / 9, -160 / 9), "0.1degC": (0.1, 0)},
    "soc": {"percent": (0.01, 0), "fraction": (1, 0)},
}
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9 ._-]{0,59}")


@dataclass(frozen=True, slots=True)
class ImportProfile:
    """Where each quantity is; an empty text is: not there."""

    time: str = ""
    time_unit: str = "s"
    current: str = ""
    current_unit: str = "A"
    charge_positive: bool = False  # the file counts charging current as positive
    voltages: str = ""
    voltage_unit: str = "V"
    temperatures: str = ""
    temperature_unit: str = "degC"
    soc: str = ""  # of the pack, as the other system has it
    soc_unit: str = "percent"
    max_rate_hz: float = 0.0  # rows that come quicker are left out, and counted; 0 keeps every one
    hold_s: float = 2.0  # CAN: how long a signal counts after its frame

    def __post_init__(self) -> None:
        """Check units and numbers.

        Raises:
            ImportFailed: names the field and what it may be.
        """
        for quantity, units in UNITS.items():
            unit = getattr(self, f"{quantity}_unit")
            if unit not in units:
                raise ImportFailed("profile", f"{quantity}_unit = {unit!r}: one of {', '.join(units)}")
        for name, limit in (("max_rate_hz", 1000.0), ("hold_s", 600.0)):
            if not 0.0 <= getattr(self, name) <= limit:
                raise ImportFailed("profile", f"{name} = {getattr(self, name)}: 0..{limit:g}")

    def check_complete(self) -> None:
        """Refuse a profile that names too little.

        Raises:
            ImportFailed: it says which quantity is missing.
        """
        for name in ("current", "voltages"):
            if not getattr(self, name):
                raise ImportFailed("profile", f"{name} is not named: which column, or pattern of columns, is it?")


def parse_profile(text: str, source: str = "profile") -> ImportProfile:
    """Return the profile in a TOML text.

    Raises:
        ImportFailed: it is no TOML, or a field is unknown or of the wrong kind.
    """
    try:
        return profile_of(tomllib.loads(text), source)
    except tomllib.TOMLDecodeError as error:
        raise ImportFailed(source, f"no TOML: {error}") from error


def profile_of(given: dict[str, object], source: str = "profile") -> ImportProfile:
    """Return the profile of named values.

    Raises:
        ImportFailed: a field is unknown or of the wrong kind.
    """
    kinds = {each.name: type(each.default) for each in fields(ImportProfile)}
    for name, value in given.items():
        if name not in kinds:
            raise ImportFailed(source, f"{name}: no such field; there are {', '.join(kinds)}")
        is_number = kinds[name] is float and isinstance(value, int | float) and not isinstance(value, bool)
        if not is_number and not isinstance(value, kinds[name]):
            raise ImportFailed(source, f"{name} = {value!r}: a {kinds[name].__name__}")
    return ImportProfile(**given)  # type: ignore[arg-type]


def profile_text(profile: ImportProfile) -> str:
    """Return the profile as TOML."""
    return "".join(f"{name} = {json.dumps(value, ensure_ascii=False)}\n" for name, value in asdict(profile).items())


class ProfileShelf:
    """Profiles by name in a folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def names(self) -> list[str]:
        """All of them, by name."""
        return sorted(path.stem for path in self._folder.glob("*.toml")) if self._folder.is_dir() else []

    def load(self, name: str) -> ImportProfile:
        """Return a profile.

        Raises:
            ImportFailed: there is none of this name, or it cannot be read.
        """
        path = self._path(name)
        if not path.is_file():
            raise ImportFailed(name, f"no such profile; there are: {', '.join(self.names()) or 'none yet'}")
        return parse_profile(path.read_text(encoding="utf-8"), str(path))

    def save(self, name: str, profile: ImportProfile) -> None:
        """Keep a profile under a name, in place of an older one.

        Raises:
            ImportFailed: the name cannot be one.
        """
        path = self._path(name)
        self._folder.mkdir(parents=True, exist_ok=True)
        path.write_text(profile_text(profile), encoding="utf-8")

    def _path(self, name: str) -> Path:
        if not _NAME.fullmatch(name):
            raise ImportFailed("profile", f"a profile cannot be called {name[:60]!r}: letters, digits, spaces, . _ -")
        return self._folder / f"{name}.toml"
