"""What happened in a session, as lines of a log: its events and what people marked."""

from dataclasses import dataclass

import numpy as np

from app.sessions.export.table import SignalTable


@dataclass(frozen=True, slots=True, order=True)
class LogLine:
    """An event or a marker."""

    t_mono_ns: int
    severity: str  # of an event; "" of a marker
    name: str  # an event's code, or a marker's kind
    text: str


def log_lines(table: SignalTable) -> list[LogLine]:
    """Return what happened in the range of a table, in order of time."""
    session = table.session
    lines = [
        LogLine(each["t_mono_ns"], str(each["severity"]), str(each["code"]), str(each["text"]))
        for each in session.events()
    ]
    lines += [LogLine(each.t_mono_ns, "", each.kind, each.text) for each in session.markers()]
    first_s, last_s = table.t_from_s or 0.0, np.inf if table.t_to_s is None else table.t_to_s
    return sorted(line for line in lines if first_s <= session.unix_s(line.t_mono_ns) <= last_s)
