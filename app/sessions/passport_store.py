"""What sessions told about cells, and swaps of modules, on the disk: one file in the data folder."""

import json
import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from app.sessions.errors import NotASession
from app.sessions.storage.migrate import PASSPORT
from app.sessions.storage.own_database import OnSetAside, nobody_asks
from app.sessions.storage.small_store import Store, packed

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class StoredSwap:
    """A swap as it was recorded."""

    id: int
    time_s: float  # unix
    cells: list[int]
    note: str
    who: str | None
    car: str | None = None  # None: of every car


class PassportStore:
    """Records and swaps of a data folder; any thread."""

    def __init__(self, path: Path, on_set_aside: OnSetAside = nobody_asks) -> None:
        """Open or create the file; a damaged one is set aside.

        Raises:
            SchemaTooNew: the file is a newer program's.
            RecordingFailed: the disk does not take it.
        """
        self._store = Store(path, PASSPORT, on_set_aside)

    def close(self) -> None:
        """Close the file."""
        self._store.close()

    def add_record(self, session_id: str, start_wall_ns: int, car: str, body: dict[str, Any]) -> None:
        """Keep what a session of a car told; an older record of it is replaced.

        Raises:
            RecordingFailed: the disk does not take it.
        """
        row = (session_id, start_wall_ns, car, packed(body))
        self._store.change(
            "INSERT OR REPLACE INTO records (session_id, start_wall_ns, car, body) VALUES (?, ?, ?, ?)", row
        )

    def known(self) -> set[str]:
        """Sessions of which there is a record."""
        return {row[0] for row in self._store.rows("SELECT session_id FROM records")}

    def without_car(self) -> set[str]:
        """Sessions whose record is from before it said of which car."""
        return {row[0] for row in self._store.rows("SELECT session_id FROM records WHERE car IS NULL")}

    def name_car(self, session_id: str, car: str) -> None:
        """Say of which car a record is.

        Raises:
            RecordingFailed: the disk does not take it.
        """
        self._store.change("UPDATE records SET car = ? WHERE session_id = ?", (car, session_id))

    def cars(self) -> list[str]:
        """All cars that a record is of, that of the newest first."""
        query = "SELECT car FROM records WHERE car IS NOT NULL GROUP BY car ORDER BY max(start_wall_ns) DESC, car"
        return [row[0] for row in self._store.rows(query)]

    def records(self, car: str) -> list[dict[str, Any]]:
        """The records of a car, the oldest first, with those of which nobody knows the car.

        One that is damaged is deleted, so that its session is read again.
        """
        query = "SELECT session_id, body FROM records WHERE car = ? OR car IS NULL ORDER BY start_wall_ns, session_id"
        rows = self._store.rows(query, (car,))
        found = []
        for session_id, body in rows:
            try:
                found.append(self._store.unpacked(body, f"the record of {session_id}"))
            except NotASession as error:
                log.warning("%s: it is deleted and made again", error)
                self._store.change("DELETE FROM records WHERE session_id = ?", (session_id,))
        return found

    def add_swap(self, t_wall_ns: int, cells: list[int], note: str, who: str | None, car: str | None) -> None:
        """Record that modules of a car were swapped; None: of every car.

        Raises:
            RecordingFailed: the disk does not take it.
        """
        row = (t_wall_ns, json.dumps(sorted(set(cells))), note, who, car)
        self._store.change("INSERT INTO swaps (t_wall_ns, cells, note, who, car) VALUES (?, ?, ?, ?, ?)", row)

    def remove_swap(self, swap_id: int) -> bool:
        """Take a swap back; False where there is none."""
        return self._store.change("DELETE FROM swaps WHERE id = ?", (swap_id,)) > 0

    def swaps(self) -> list[StoredSwap]:
        """All swaps of all cars, the oldest first."""
        rows = self._store.rows("SELECT id, t_wall_ns, cells, note, who, car FROM swaps ORDER BY t_wall_ns, id")
        return [StoredSwap(row[0], row[1] / 1e9, json.loads(row[2]), row[3], row[4], row[5]) for row in rows]
