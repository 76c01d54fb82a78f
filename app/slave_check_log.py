"""Every check of a slave against a meter, in a file that only grows: one line of JSON each, `slave-checks.jsonl`."""

import json
import os
import threading
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from app.slave_check import CheckedCell, QuantityName, Verdict


@dataclass(frozen=True, slots=True)
class SlaveCheck:
    """One check; `number` counts from 1."""

    number: int
    t_wall_ns: int
    who: str
    pack: int  # 0..7
    quantity: QuantityName
    meter: str  # which one, in the words of whoever held it
    meter_error: float
    note: str
    verdict: Verdict


class SlaveCheckLog:
    """The file; thread-safe."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / "slave-checks.jsonl"
        self._lock = threading.Lock()

    def append(
        self,
        t_wall_ns: int,
        who: str,
        pack: int,
        quantity: QuantityName,
        meter: str,
        meter_error: float,
        note: str,
        verdict: Verdict,
    ) -> SlaveCheck:
        """Keep a check; it is on the disk when this returns.

        Raises:
            OSError: it cannot be kept.
        """
        with self._lock:
            lines = self._lines()
            check = SlaveCheck(len(lines) + 1, t_wall_ns, who, pack, quantity, meter, meter_error, note, verdict)
            with self._path.open("ab") as file:
                if lines and not lines[-1].endswith(b"\n"):  # cut while it was written
                    file.write(b"\n")
                file.write(json.dumps(asdict(check), ensure_ascii=False).encode() + b"\n")
                file.flush()
                os.fsync(file.fileno())
            return check

    def checks(self, pack: int | None = None, quantity: QuantityName | None = None) -> list[SlaveCheck]:
        """Return the checks, newest first; lines that are none are left out."""
        with self._lock:
            found = [check for line in self._lines() if (check := _parse(line)) is not None]
        return [check for check in reversed(found) if pack in (None, check.pack) and quantity in (None, check.quantity)]

    def _lines(self) -> list[bytes]:
        return self._path.read_bytes().splitlines(keepends=True) if self._path.exists() else []


def _parse(line: bytes) -> SlaveCheck | None:
    try:
        entry: dict[str, Any] = json.loads(line)
        verdict = entry.pop("verdict")
        cells = tuple(CheckedCell(**cell) for cell in verdict.pop("cells"))
        verdict["out"] = tuple(verdict["out"])
        return SlaveCheck(**entry, verdict=Verdict(cells, **verdict))
    except (ValueError, KeyError, TypeError, AttributeError):
        return None
