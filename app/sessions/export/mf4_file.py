"""ASAM MDF 4, by asammdf: one group of channels over the time since the session's start, NaN where not sampled."""

from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path
from typing import Any

from app.sessions.errors import ExportUnavailable
from app.sessions.export.table import Rows, SignalTable


def write_mf4(table: SignalTable, path: Path) -> None:
    """Write the file.

    Raises:
        ExportUnavailable: asammdf is not installed.
    """
    try:
        asammdf = import_module("asammdf")
    except ImportError as error:
        raise ExportUnavailable("mf4", "asammdf", "mf4") from error
    with asammdf.MDF(version="4.10") as file:
        file.start_time = datetime.fromtimestamp(table.info.started_wall_ns / 1e9, UTC)
        group: int | None = None
        for rows in table.rows():
            if group is None:
                group = _append(file, asammdf.Signal, table, rows)
            else:
                columns = [rows.uptime_s, *rows.values.T]
                file.extend(group, [(rows.elapsed_s, None), *((column, None) for column in columns)])
        file.save(path, overwrite=True)


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
