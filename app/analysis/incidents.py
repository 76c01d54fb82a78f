"""Incidents: events that deserve a black box, grouped where they belong together."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Final

from app.telemetry import Severity
from app.words import Text, message_or_text

BEFORE_S: Final = 10.0
AFTER_S: Final = 5.0
LONGEST_S: Final = 15.0  # from the first trigger to the last that still belongs to it
FOLLOWS_S: Final = 90.0  # within it a finding of the cell that tripped comes from the verdict on the trip
FAULTS: Final = (
    "cell-voltage-missing",
    "slave-lost",
    "joint-resistance-high",
    "charger-",
)  # warnings of the battery itself


@dataclass(frozen=True)
class Trigger:
    """An event that is worth a black box."""

    at_s: float  # unix time, as logged
    mono_s: float  # time on the recording machine's monotonic clock
    code: str
    severity: Severity
    message: Text
    cell: int | None = None
    value: float | None = None
    limit: float | None = None
    unit: str = ""


def trigger_of_event(row: Mapping[str, Any], at_s: float, mono_s: float) -> Trigger:
    """Return an event of a session, a row of its table `events`, as what may have triggered a black box."""
    about = (row[name] for name in ("cell", "value", "limit_value", "unit"))
    message = message_or_text(row["text"], row.get("message"))
    return Trigger(at_s, mono_s, row["code"], row["severity"], message, *about)


def is_trigger(severity: str, code: str) -> bool:
    """True for trips, and for warnings that tell of a fault in the battery."""
    return severity == "trip" or (severity == "warning" and code.startswith(FAULTS))


def incidents(triggers: Sequence[Trigger]) -> list[list[Trigger]]:
    """Return the triggers in groups: what follows within AFTER_S belongs to what was first, findings of it too."""
    groups: list[list[Trigger]] = []
    trips = [trigger for trigger in triggers if trigger.severity == "trip"]
    for trigger in sorted(triggers, key=lambda trigger: trigger.mono_s):
        group = groups[-1] if groups else None
        if group and trigger.mono_s - group[-1].mono_s <= AFTER_S and trigger.mono_s - group[0].mono_s <= LONGEST_S:
            group.append(trigger)
        elif not follows(trigger, trips):
            groups.append([trigger])
    return groups


def follows(trigger: Trigger, trips: Iterable[Trigger]) -> bool:
    """True for a warning about a cell that has just tripped: it is no incident of its own."""
    return trigger.severity == "warning" and any(
        trip.cell is not None and trip.cell == trigger.cell and 0.0 <= trigger.mono_s - trip.mono_s <= FOLLOWS_S
        for trip in trips
    )


def main_trigger(group: Sequence[Trigger]) -> Trigger:
    """Return the first that names a cell or a limit, a trip before a warning; the very first where none does."""
    trips = [trigger for trigger in group if trigger.severity == "trip"] or list(group)
    return next((trip for trip in trips if trip.limit is not None), trips[0])


def incident_id(trigger: Trigger) -> str:
    """Return a name that is the same whoever makes the black box: UTC time and what tripped."""
    at = datetime.fromtimestamp(round(trigger.at_s, 3), UTC)
    return f"{at.strftime('%Y%m%dT%H%M%S')}.{at.microsecond // 1000:03}Z-{trigger.code}"
