"""Swaps of modules: when modules of a car were replaced. A small JSON file in the data folder keeps them."""

from __future__ import annotations

import contextlib
import json
import logging
import sqlite3
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Final

from filelock import FileLock

from app.battery.battery import Battery
from app.battery.library import file_name_of
from app.errors import ConfigError
from app.sessions.errors import RecordingFailed
from app.sources.data_file import replace_file
from app.sources.loaded_battery import team_battery
from app.words import Message

log = logging.getLogger(__name__)
_LOCK_S: Final = 10.0


@dataclass(frozen=True)
class Swap:
    """Modules that were replaced at an instant: what is in these places from then on inherits nothing."""

    time_s: float  # unix
    cells: tuple[int, ...]
    note: str = ""
    who: str | None = None
    car: str | None = None  # None: of every car
    id: int = 0

    def is_of(self, car: str) -> bool:
        """Return whether it counts for a car."""
        return self.car in (None, car)


class SwapFile:
    """The swaps of a battery, those of simulated cars in a file of their own; any thread, any process."""

    def __init__(self, folder: Path, battery: Battery, *, simulated: bool = False) -> None:
        """Name the file in a data folder; nothing is read yet."""
        own = "" if battery == team_battery().battery else f"-{file_name_of(battery.name)}"
        whose = f"{own}{'-simulated' if simulated else ''}"
        self._path = folder / f"swaps{whose}.json"
        self._passports = folder / f"passport{whose}.sqlite"  # which held them in earlier versions
        self._n_cells = battery.n_cells

    def read(self) -> list[Swap]:
        """Return all swaps of all cars, the oldest first; those of earlier versions are taken over.

        Raises:
            ConfigError: the file is damaged.
        """
        if not self._path.exists() and (swaps := _of_passports(self._passports)):
            with contextlib.suppress(RecordingFailed):  # the next time, then
                self._change(lambda kept: kept)
            return swaps
        return self._read()

    def add(
        self, cells: Sequence[int], time_s: float, note: str, who: str | None, car: str, cars: Sequence[str]
    ) -> None:
        """Record that modules of a car were swapped.

        Without a car it is the only one of `cars`, all that there are; where there is none yet it counts for every car.

        Raises:
            ConfigError: no cell, or one that there is not; no such car, or which of several is not given.
            RecordingFailed: the disk does not take it.
        """
        if not cells or not all(0 <= cell < self._n_cells for cell in cells):
            raise ConfigError("cells", list(cells), f"at least one of 0..{self._n_cells - 1}")
        if cars and (car or len(cars) > 1) and car not in cars:
            raise ConfigError("car", car, Message("one-of", choices=tuple(sorted(cars))))
        of_car = car or (cars[0] if cars else None)
        made = Swap(time_s, tuple(sorted(set(cells))), note, who, of_car)
        self._change(lambda swaps: [*swaps, replace(made, id=1 + max((swap.id for swap in swaps), default=0))])

    def remove(self, swap_id: int) -> bool:
        """Take a swap back; False where there is none.

        Raises:
            ConfigError: the file is damaged.
            RecordingFailed: the disk does not take it.
        """
        if swap_id not in (swap.id for swap in self.read()):
            return False
        self._change(lambda swaps: [swap for swap in swaps if swap.id != swap_id])
        return True

    def _read(self) -> list[Swap]:
        try:
            swaps = [_swap(**row) for row in json.loads(self._path.read_bytes())]
            return sorted(swaps, key=lambda swap: (swap.time_s, swap.id))
        except FileNotFoundError:
            return []
        except (OSError, ValueError, TypeError) as error:
            raise ConfigError("swaps", self._path, Message("swaps-unreadable")) from error

    def _change(self, change: Callable[[list[Swap]], list[Swap]]) -> list[Swap]:
        try:
            with FileLock(self._path.with_suffix(".lock"), timeout=_LOCK_S):
                swaps = self._read() if self._path.exists() else _of_passports(self._passports)
                made = change(swaps)
                replace_file(self._path, json.dumps([asdict(swap) for swap in made], indent=1).encode())
        except OSError as error:
            raise RecordingFailed(Message("of-source", source=str(self._path), reason=str(error))) from error
        return made


def _swap(time_s: float, cells: list[int], note: str, who: str | None, car: str | None, id: int) -> Swap:
    return Swap(float(time_s), tuple(map(int, cells)), str(note), who, car, int(id))


def _of_passports(path: Path) -> list[Swap]:
    """The swaps in the file of an earlier version, none where it cannot be read; in the first one they had no car."""
    if not path.is_file():
        return []
    try:
        with contextlib.closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)) as file:
            file.row_factory = sqlite3.Row
            rows = [dict(row) for row in file.execute("SELECT * FROM swaps ORDER BY t_wall_ns, id")]
        return [
            _swap(row["t_wall_ns"] / 1e9, json.loads(row["cells"]), row["note"], row["who"], row.get("car"), row["id"])
            for row in rows
        ]
    except (sqlite3.Error, ValueError, TypeError, KeyError) as error:
        log.warning("swaps of modules in %s cannot be read: %s", path, error)
        return []
