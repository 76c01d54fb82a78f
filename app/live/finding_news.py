"""Events of cells' findings: one when a finding is made, one when evidence has ended it. Every cell is named."""

from app.telemetry import Event, Severity, Snapshot
from app.telemetry.cell_findings import Finding
from app.words import Message


class FindingNews:
    """Compares every snapshot's findings with those of the one before."""

    def __init__(self) -> None:
        self._standing: dict[tuple[str, int], Finding] = {}
        self._last: tuple[Finding, ...] = ()

    def step(self, snapshot: Snapshot) -> list[Event]:
        """Return what is new in a snapshot."""
        if snapshot.findings is self._last:
            return []
        self._last = snapshot.findings
        now: dict[tuple[str, int], Finding] = {(each.code, each.cell): each for each in snapshot.findings}
        made = [
            _event(snapshot, each, each.message, ended=False) for key, each in now.items() if key not in self._standing
        ]
        ended = [
            _event(snapshot, each, Message("finding-ended", finding=each.message), ended=True)
            for key, each in self._standing.items()
            if key not in now
        ]
        self._standing = now
        return made + ended


def _event(snapshot: Snapshot, found: Finding, message: Message, *, ended: bool) -> Event:
    code = "finding-ended" if ended else f"finding-{found.code}"
    severity: Severity = "info" if ended else "warning"
    return Event(snapshot.t_wall_ns, severity, code, message, found.cell, found.size, None, found.unit)
