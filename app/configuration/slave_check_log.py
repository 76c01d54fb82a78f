"""Every check of a slave against a meter, in a file that only grows: one line of JSON each, `slave-checks.jsonl`."""

import threading
from dataclasses import asdict, dataclass
from pathlib import Path

from app.configuration.json_lines import JsonLines
from app.configuration.slave_check import CheckedCell, QuantityName, Verdict
from app.sources.data_file import checked, parse_object


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
        self._file = JsonLines(folder / "slave-checks.jsonl")
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
            lines = self._file.lines()
            check = SlaveCheck(len(lines) + 1, t_wall_ns, who, pack, quantity, meter, meter_error, note, verdict)
            self._file.append(asdict(check), after=lines)
            return check

    def checks(self, pack: int | None = None, quantity: QuantityName | None = None) -> list[SlaveCheck]:
        """Return the checks, newest first; lines that are none are left out."""
        with self._lock:
            found = [check for line in self._file.lines() if (check := _parse(line)) is not None]
        return [check for check in reversed(found) if pack in (None, check.pack) and quantity in (None, check.quantity)]


def _parse(line: bytes) -> SlaveCheck | None:
    try:
        entry = parse_object(line)
        verdict = entry.pop("verdict")
        cells = tuple(CheckedCell(**cell) for cell in verdict.pop("cells"))
        verdict["out"] = tuple(verdict["out"])
        return checked(SlaveCheck(**entry, verdict=Verdict(cells, **verdict)))
    except (ValueError, KeyError, TypeError, AttributeError):
        return None
