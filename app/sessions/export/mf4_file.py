"""ASAM MDF 4, by asammdf: one group of channels over the time since the session's start, NaN where not sampled.

Events, markers and laps are event blocks (EVBLOCK) of the file; its header tells car, driver and session.
"""

from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape, quoteattr

from app.sessions.errors import ExportUnavailable
from app.sessions.export.table import Rows, SignalTable, log_lines

_PROPERTIES = {"driver": "author", "vehicle": "subject", "event": "project"}  # what ASAM calls them
_SAME_NS = 1_000_000  # a lap's time is a float


def write_mf4(table: SignalTable, path: Path) -> None:
    """Write the file.

    Raises:
        ExportUnavailable: asammdf is not installed.
    """
    try:
        asammdf = import_module("asammdf")
        blocks, constants = (import_module(f"asammdf.blocks.v4_{name}") for name in ("blocks", "constants"))
    except ImportError as error:
        raise ExportUnavailable("mf4", "asammdf", "mf4") from error
    with asammdf.MDF(version="4.10") as file:
        file.start_time = datetime.fromtimestamp(table.info.started_wall_ns / 1e9, UTC)
        file.header.comment = _header(table)
        for at_ns, name, text, is_marked in _happened(table):
            event = blocks.EventBlock(
                event_type=constants.EVENT_TYPE_MARKER,
                cause=constants.EVENT_CAUSE_USER if is_marked else constants.EVENT_CAUSE_TOOL,
                sync_base=at_ns,
                sync_factor=1e-9,
                flags=0,
            )
            event.name, event.comment = name, text
            file.events.append(event)
        group: int | None = None
        for rows in table.rows():
            if group is None:
                group = _append(file, asammdf.Signal, table, rows)
            else:
                columns = [rows.uptime_s, *rows.values.T]
                file.extend(group, [(rows.elapsed_s, None), *((column, None) for column in columns)])
        file.save(path, overwrite=True)


def _header(table: SignalTable) -> str:
    """The header's comment: car, driver and session, each by our name and by that of ASAM's where it has one."""
    info = table.info
    facts = {"session": info.id, "name": info.name} | {
        key: str(info.metadata[key])
        for key in ("driver", "vehicle", "venue", "event", "source")
        if info.metadata.get(key)
    }
    facts |= {theirs: facts[ours] for ours, theirs in _PROPERTIES.items() if ours in facts}
    properties = "".join(f"<e name={quoteattr(name)}>{escape(value)}</e>" for name, value in facts.items())
    text = escape(f"voltwall {info.voltwall}, session {info.id}, {info.name}")
    return f"<HDcomment><TX>{text}</TX><common_properties>{properties}</common_properties></HDcomment>"


def _happened(table: SignalTable) -> list[tuple[int, str, str, bool]]:
    """Time since the start [ns], name, text, and whether a person marked it; a lap without a marker is named `lap`."""
    start_ns = table.info.started_mono_ns
    entries = [(line.t_mono_ns - start_ns, line.name, line.text, not line.severity) for line in log_lines(table)]
    marked = [at_ns for at_ns, name, _, is_marked in entries if is_marked and name in ("lap", "laps")]
    for time_s in table.lap_times_s or ():
        at_ns = table.session.mono_us(time_s) * 1000 - start_ns
        is_inside = (table.t_from_s or 0.0) <= time_s <= (time_s if table.t_to_s is None else table.t_to_s)
        if is_inside and not any(abs(at_ns - mark_ns) <= _SAME_NS for mark_ns in marked):
            entries.append((at_ns, "lap", "lap", False))
    return sorted(entries)


def _append(file: Any, signal_type: Any, table: SignalTable, rows: Rows) -> int:
    channels = [("uptime_s", "s", rows.uptime_s)]
    channels += [(table.names[i], s.unit, rows.values[:, i]) for i, s in enumerate(table.signals)]
    signals = [
        signal_type(samples=samples, timestamps=rows.elapsed_s, name=name, unit=unit)
        for name, unit, samples in channels
    ]
    car = "simulated car, " if table.is_simulated else ""
    file.append(signals, comment=f"{car}voltwall session {table.info.id}, {table.info.name}")
    return len(file.groups) - 1
