"""Conditions with memory: raised after they persist, ended with hysteresis, kept until acknowledged."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import get_args

from app.estimation.health.cell_finding import FindingCode
from app.live.alarm_rules import AlarmCondition, conditions, is_reason_lost
from app.live.alarm_visibility import is_judged
from app.telemetry import Alarm, Event, Severity, Snapshot, TripCause
from app.telemetry.cell_findings import Finding
from app.words import Message, Quantity
from app.words import condition as condition_message

RAISE_AFTER_NS: dict[Severity, int] = {
    "info": 0,
    "watch": 2_000_000_000,
    "warning": 1_000_000_000,
    "trip": 300_000_000,
}
END_AFTER_NS = 2_000_000_000
INCIDENT_NS = 5_000_000_000  # nearer than the next incident's trips: see `incidents`


@dataclass
class _Pending:
    first_ns: int
    last_ns: int
    wall_ns: int


class AlarmTracker:
    """Feeds on snapshots; returns the alarms to show and the events to log."""

    def __init__(self, alarms: Iterable[Alarm] = ()) -> None:
        """Start, or go on with the alarms that were open when the service ended."""
        self._pending: dict[str, _Pending] = {}
        self._alarms = {alarm.code: alarm for alarm in alarms}
        self._seen_ns: dict[str, int] = {}
        self._raised_ns: dict[str, int] = {}
        self._named: tuple[TripCause, ...] | None = None  # None: nothing recorded was looked at yet
        self._past: dict[int, TripCause] = {}  # causes of trips that are over and acknowledged, by cell
        self._next_id = 1 + max((alarm.id for alarm in self._alarms.values()), default=0)

    def step(self, snapshot: Snapshot) -> tuple[tuple[Alarm, ...], list[Event]]:
        """Judge one snapshot. A single sample raises nothing: a condition has to persist over at least two."""
        now_ns = snapshot.t_mono_ns
        events: list[Event] = []
        causes: dict[str, list[TripCause]] = {}
        for cause in self._without_trip():
            causes.setdefault(cause.code, []).append(cause)
        named = {code: _condition(alike) for code, alike in causes.items()}
        raised = named | {condition.code: condition for condition in conditions(snapshot)}
        held = named | {condition.code: condition for condition in conditions(snapshot, slack=1.0)}
        for key, condition in raised.items():
            pending = self._pending.setdefault(key, _Pending(now_ns, now_ns, snapshot.t_wall_ns))
            pending.last_ns = now_ns
            alarm = self._alarms.get(key)
            persisted = now_ns - pending.first_ns >= RAISE_AFTER_NS[condition.severity] and now_ns > pending.first_ns
            if persisted and (alarm is None or not alarm.active):
                self._alarms[key] = self._raise(condition, pending.wall_ns)
                self._raised_ns[key] = pending.first_ns
                events.append(_event(condition, snapshot.t_wall_ns, condition.message))
        for key in set(self._pending) - set(raised):
            del self._pending[key]
        for key, alarm in list(self._alarms.items()):
            raised_ns = self._raised_ns.setdefault(key, now_ns - max(snapshot.t_wall_ns - alarm.since_ns, 0))
            seen_ns = self._seen_ns.setdefault(key, now_ns)
            now_held = held.get(key) or raised.get(key)
            if now_held is not None:
                self._seen_ns[key] = now_ns
                if alarm.active and not (alarm.message != now_held.message and is_reason_lost(now_held)):
                    self._alarms[key] = replace(
                        alarm,
                        value=now_held.value,
                        cell=now_held.cell,
                        limit=now_held.limit,
                        unit=now_held.unit,
                        message=now_held.message,
                        cells=now_held.cells,
                    )
            elif not is_judged(alarm, snapshot) or (self._named is None and _is_named(alarm)):
                self._seen_ns[key] = now_ns  # what cannot be seen has not ended
            elif alarm.active and now_ns - seen_ns >= END_AFTER_NS:
                self._alarms[key] = replace(alarm, active=False, ended_ns=snapshot.t_wall_ns - (now_ns - seen_ns))
                seconds = (now_ns - raised_ns) / 1e9
                ended = Message("alarm-ended", after=Quantity(seconds, "s", 1), alarm=alarm.message)
                events.append(_event(alarm, snapshot.t_wall_ns, ended, severity="info"))
        for key in named.keys() & self._alarms.keys():
            if self._alarms[key].active and self._alarms[key].severity == "warning":
                self._alarms[key] = replace(self._alarms[key], cause=causes[key][0])
        self._drop_finished()
        order = {"trip": 0, "warning": 1, "watch": 2, "info": 3}
        alarms = sorted(self._alarms.values(), key=lambda a: (not a.active, order[a.severity], -a.since_ns))
        return tuple(alarms), events

    def acknowledge(self, alarm_id: int, who: str) -> bool:
        """Mark an alarm as seen; it leaves when its condition has ended. False where there is no such alarm."""
        for key, alarm in self._alarms.items():
            if alarm.id == alarm_id:
                self._alarms[key] = replace(alarm, acknowledged_by=who)
                return True
        return False

    def explain(self, cause: TripCause, at_ns: int | None = None) -> None:
        """Set the cause of the trips that hold, with the time of an incident of its own, ended or not."""
        for key, alarm in self._alarms.items():
            is_of_it = alarm.active if at_ns is None else abs(alarm.since_ns - at_ns) <= INCIDENT_NS
            if alarm.severity == "trip" and (is_of_it or (alarm.active and alarm.cause is None)):
                self._alarms[key] = replace(alarm, cause=cause)

    def name(self, causes: tuple[TripCause, ...]) -> None:
        """Set what is wrong without having tripped anything; what a trip left and a look since does not show, ends."""
        self._named, self._past = causes, {}

    def causes(self, findings: Iterable[Finding] = ()) -> list[TripCause]:
        """Return the verdicts on the trips that are listed; else, of a cell, on what is wrong without one.

        `findings` are those of the cells' judge: what a trip left goes on in them.
        """
        for finding in findings:
            self._past.pop(finding.cell, None)
        trips = [alarm for alarm in self._alarms.values() if alarm.severity == "trip"]
        causes = [alarm.cause for alarm in trips if alarm.cause is not None]
        cells = {cause.cell for cause in causes}
        return [*causes, *(cause for cause in self._without_trip() if cause.cell not in cells)]

    def _without_trip(self) -> list[TripCause]:
        named = self._named or ()
        cells = {cause.cell for cause in named}
        return [*named, *(cause for cell, cause in self._past.items() if cell not in cells)]

    def _raise(self, condition: AlarmCondition, since_ns: int) -> Alarm:
        self._next_id += 1
        return Alarm(
            self._next_id - 1,
            condition.code,
            condition.severity,
            condition.message,
            since_ns,
            True,
            condition.cell,
            condition.value,
            condition.limit,
            condition.unit,
            cells=condition.cells,
        )

    def _drop_finished(self) -> None:
        for key, alarm in list(self._alarms.items()):
            if not alarm.active and (alarm.acknowledged_by is not None or alarm.severity == "watch"):
                cause = alarm.cause if alarm.severity == "trip" else None
                if cause is not None and cause.cell is not None and cause.code in get_args(FindingCode):
                    self._past[cause.cell] = cause  # the trip is over, what is wrong with the cell is not
                del self._alarms[key]
                self._seen_ns.pop(key, None)
                self._raised_ns.pop(key, None)


def _condition(alike: Sequence[TripCause]) -> AlarmCondition:
    """What is wrong by what was recorded, as an alarm is about it: one for all cells of a kind."""
    first = alike[0]
    cells = tuple(cause.cell for cause in alike if cause.cell is not None)
    message = first.message if len(cells) < 2 else condition_message(first.code, len(cells))
    return AlarmCondition(
        "warning", message, first.cell, first.size, None, first.unit, cells[1:] and cells, of=first.code
    )


def _is_named(alarm: Alarm) -> bool:
    """It is not by a snapshot, but by what was recorded."""
    return alarm.severity == "warning" and alarm.cause is not None


def _event(source: AlarmCondition | Alarm, wall_ns: int, message: Message, severity: Severity | None = None) -> Event:
    return Event(
        wall_ns, severity or source.severity, source.code, message, source.cell, source.value, source.limit, source.unit
    )


class FindingChanges:
    """Compares every snapshot's findings with those of the one before."""

    def __init__(self) -> None:
        self._standing: dict[tuple[str, int], Finding] = {}
        self._last: tuple[Finding, ...] = ()

    def step(self, snapshot: Snapshot) -> list[Event]:
        """Return what is new in a snapshot."""
        if snapshot.findings is self._last:
            return []
        self._last = snapshot.findings
        now: dict[tuple[str, int], Finding] = {(finding.code, finding.cell): finding for finding in snapshot.findings}
        made = [
            _finding_event(snapshot, finding, finding.message, ended=False)
            for key, finding in now.items()
            if key not in self._standing
        ]
        ended = [
            _finding_event(snapshot, finding, Message("finding-ended", finding=finding.message), ended=True)
            for key, finding in self._standing.items()
            if key not in now
        ]
        self._standing = now
        return made + ended


def _finding_event(snapshot: Snapshot, finding: Finding, message: Message, *, ended: bool) -> Event:
    code = "finding-ended" if ended else f"finding-{finding.code}"
    severity: Severity = "info" if ended else "warning"
    return Event(snapshot.t_wall_ns, severity, code, message, finding.cell, finding.size, None, finding.unit)
