"""A table of another system as a battery of its own: a profile, a DBC of floating-point signals, and frames.

So its session explains itself as any other: its frames hold every number of the table as it is.
"""

import json
import struct
from collections.abc import Iterator

import numpy as np

from app.battery.battery import Battery, SignalName
from app.errors import ImportFailed
from app.estimation.arrays import FloatArray
from app.sources.dbc.frames import TimedFrame
from app.sources.loaded_battery import LoadedBattery, battery_from_files, team_battery
from app.sources.recordings.battery_log import BatteryLog
from app.words import Message
from firmware_protocol.memory_map import CAN_ID_EXTENDED

_FIRST_ID = CAN_ID_EXTENDED | 0x1E000000  # of no bus: what a log's own frames do not use
_A_FRAME = 8  # numbers of 64 bits
_PERIODS_S = (0.001, 60.0)
_PROFILE, _DBC = "table.toml", "table.dbc"


def battery_of_table(log: BatteryLog, source: str, like: LoadedBattery | None = None) -> LoadedBattery:
    """Return a battery that speaks as `frames_of_table` does.

    Args:
        log: what the table holds.
        source: name of its file.
        like: a battery whose shape, cell and limits are the table's; None: the team's for as many cells as it has,
            else one segment.

    Raises:
        ImportFailed: `like` has another number of cells.
    """
    if like is not None and like.battery.n_cells != log.n_cells:
        raise ImportFailed(source, Message("not-so-many-cells", cells=log.n_cells, expected=like.battery.n_cells))
    if like is None and log.n_cells == team_battery().battery.n_cells:
        like = team_battery()
    shape = Battery(source, (log.n_cells,)) if like is None else like.battery
    files = {_PROFILE: _profile(shape, log).encode(), _DBC: _dbc(_columns(log)).encode()}
    return battery_from_files(files)


def frames_of_table(log: BatteryLog) -> Iterator[list[TimedFrame]]:
    """Yield the frames of each row, its time in ns since the first one."""
    columns = _columns(log)
    table = np.column_stack([values for _, values in columns])
    starts = range(0, len(columns), _A_FRAME)
    for time_s, row in zip(log.time_s.tolist(), table.tolist(), strict=True):
        t_ns = round(time_s * 1e9)
        yield [
            (t_ns, _FIRST_ID + k, struct.pack(f"<{len(part)}d", *part))
            for k, part in enumerate(row[start : start + _A_FRAME] for start in starts)
        ]


def frames_a_row(log: BatteryLog) -> int:
    """Return how many frames `frames_of_table` makes of each row."""
    return -(-len(_columns(log)) // _A_FRAME)


def _columns(log: BatteryLog) -> list[tuple[str, FloatArray]]:
    found = [("Current", log.current_a)]
    if log.soc is not None:
        found.append(("Soc", log.soc))
    found += [(f"Voltage_{i + 1}", log.voltages_v[:, i]) for i in range(log.n_cells)]
    if np.isfinite(log.temperatures_degc).any():
        found += [(f"Temperature_{i + 1}", log.temperatures_degc[:, i]) for i in range(log.n_cells)]
    return found


def _dbc(columns: list[tuple[str, FloatArray]]) -> str:
    lines, types = ['VERSION ""', "NS_ :", "BS_:", "BU_: Table"], []
    for start in range(0, len(columns), _A_FRAME):
        names = [name for name, _ in columns[start : start + _A_FRAME]]
        can_id = _FIRST_ID + start // _A_FRAME
        lines.append(f"\nBO_ {can_id} Row_{start // _A_FRAME}: {8 * len(names)} Table")
        lines += [f' SG_ {name} : {64 * i}|64@1- (1,0) [0|0] "" Table' for i, name in enumerate(names)]
        types += [f"SIG_VALTYPE_ {can_id} {name} : 2;" for name in names]
    return "\n".join([*lines, "", *types, ""])


def _profile(battery: Battery, log: BatteryLog) -> str:
    steps_s = np.diff(log.time_s)
    period_s = float(np.clip(np.median(steps_s), *_PERIODS_S)) if len(steps_s) else _PERIODS_S[0]
    has_temperatures = np.isfinite(log.temperatures_degc).any()
    drawing = battery.drawing
    limits = {name: each for name, each in battery.limits.items() if not isinstance(each, SignalName)}
    return "\n".join(
        [
            "# Made of a table of another system: each row is sent as frames of 64-bit numbers.",
            "[battery]",
            f"name = {json.dumps(battery.name)}",
            f"segments = {list(battery.segments)}",
            f"parallel = {battery.parallel}",
            f"cell = {json.dumps(battery.cell)}",
            "[battery.drawing]",
            f"rows = {drawing.rows}",
            *([f"order = {[each + 1 for each in drawing.order]}"] if drawing.order else []),
            f"turned = {[each + 1 for each in drawing.turned]}",
            "[battery.temperatures]",
            f"sensors = {log.n_cells if has_temperatures else 0}",
            *_numbers("limits", limits),
            *_numbers("rules", battery.rules),
            "[source]",
            f'dbc = "{_DBC}"',
            f"period_s = {round(period_s, 6)}",
            *_cells("voltage", "Voltage", "V"),
            *(_cells("temperature", "Temperature", "degC") if has_temperatures else []),
            *_reading("current", "Current", "A"),
            *(_reading("soc", "Soc", "fraction") if log.soc is not None else []),
            "",
        ]
    )


def _numbers(table: str, values: dict[str, float]) -> list[str]:
    return [f"[battery.{table}]", *(f"{name} = {value!r}" for name, value in values.items())] if values else []


def _cells(kind: str, name: str, unit: str) -> list[str]:
    return [f"[[source.{kind}]]", f'signal = "{name}_{{cell}}"', "base = 1", f'unit = "{unit}"']


def _reading(kind: str, name: str, unit: str) -> list[str]:
    return [f"[source.{kind}]", f'signal = "{name}"', f'unit = "{unit}"']
