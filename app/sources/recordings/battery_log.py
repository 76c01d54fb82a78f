"""A battery's recording in our units, out of a table and a profile. Pure numbers; no file, no clock."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.battery.fields import MOST_CELLS
from app.errors import ImportFailed
from app.estimation.arrays import FloatArray
from app.sources.recordings.import_mapping import LONGEST_S, ImportMapping, parse_cells
from app.sources.recordings.quantities import in_our_unit, signed
from app.sources.recordings.table import Table
from app.words import Message, Quantity

UNIX_FROM_S = 9.0e8  # a time beyond it, in 1998, is since 1970; before it, since a start
DEFAULT_PERIOD_S = 0.1
MAX_DAYS = round(LONGEST_S / 86_400)


@dataclass(frozen=True, slots=True)
class BatteryLog:
    """n rows; NaN is not measured."""

    time_s: FloatArray  # (n,) from the first row, ascending
    started_unix_s: float | None  # None: the file does not say
    current_a: FloatArray  # (n,) positive on discharge
    voltages_v: FloatArray  # (n, n_cells)
    temperatures_degc: FloatArray  # (n, n_cells)
    soc: FloatArray | None  # (n,) fraction
    n_cells: int
    notes: tuple[Message, ...]


def battery_log(table: Table, profile: ImportMapping) -> BatteryLog:
    """Return the recording that a table holds.

    Raises:
        ImportFailed: a column is missing, there are more cells than a battery may have, or no row can be used.
    """
    profile.check_complete(table.source, table.columns)
    notes = list(table.notes)
    current_a = in_our_unit(table.column("current", profile.current), "current", profile.current_unit)
    current_a, direction = signed(current_a, table.columns)
    voltages_v = in_our_unit(table.matrix("voltages", profile.voltages), "voltage", profile.voltage_unit)
    if profile.cells_in_series > 1.0:
        voltages_v = voltages_v / profile.cells_in_series
        notes.append(Message("cells-in-series", column=profile.voltages, cells=profile.cells_in_series))
    chosen = _chosen(table.source, profile.cells, voltages_v.shape[1])
    n_cells = len(chosen)
    if n_cells > MOST_CELLS:
        raise ImportFailed(
            table.source, Message("too-many-cells", pattern=repr(profile.voltages), cells=n_cells, most=MOST_CELLS)
        )
    temperatures = np.full((len(current_a), n_cells), np.nan)
    turns = profile.charge_positive and direction is None
    if direction is not None:
        notes.append(Message("current-no-sign", column=profile.current, direction=direction))
    if turns:
        notes.append(Message("sign-turned", column=profile.current))
    if n_cells < voltages_v.shape[1]:
        notes.append(Message("cells-taken", taken=n_cells, cells=voltages_v.shape[1], chosen=profile.cells))
    if n_cells == 1 and profile.cells_in_series == 1.0:
        notes.append(Message("test-of-one-cell"))
    if profile.temperatures:
        sensors = table.matrix("temperatures", profile.temperatures)
        temperatures = _spread(
            in_our_unit(sensors, "temperature", profile.temperature_unit), voltages_v.shape[1], notes
        )
        temperatures = temperatures[:, chosen]
    soc = in_our_unit(table.column("soc", profile.soc), "soc", profile.soc_unit) if profile.soc else None
    time_s: FloatArray = (
        in_our_unit(table.column("time", profile.time), "time", profile.time_unit)
        if profile.time
        else np.arange(len(current_a), dtype=np.float64) * DEFAULT_PERIOD_S
    )
    if not profile.time:
        notes.append(Message("no-time-column", period=Quantity(DEFAULT_PERIOD_S, "s")))
    rows = _rows(table.source, time_s, profile.max_rate_hz, notes)
    time_s = time_s[rows]
    taken_v = voltages_v[rows][:, chosen]
    full_v = np.where((taken_v > 0.5) & (taken_v < 6.0), taken_v, np.nan)
    if np.isnan(full_v).all():
        raise ImportFailed(table.source, Message("no-cell-voltage", unit=profile.voltage_unit))
    return BatteryLog(
        time_s - time_s[0],
        float(time_s[0]) if time_s[0] > UNIX_FROM_S else None,
        -current_a[rows] if turns else current_a[rows],
        full_v,
        temperatures[rows],
        None if soc is None else soc[rows],
        n_cells,
        tuple(notes),
    )


def _chosen(source: str, cells: str, count: int) -> list[int]:
    """Return the indices of the cells to take, in order; all of `count` where none is named.

    Raises:
        ImportFailed: one of them is beyond the last.
    """
    spans = parse_cells(cells)
    if spans and (most := max(last for _, last in spans)) > count:
        raise ImportFailed(source, Message("no-such-cell-column", cell=most, count=count))
    taken = {index for first, last in spans for index in range(first - 1, last)}
    return sorted(taken) if spans else list(range(count))


def _spread(sensors: FloatArray, n_cells: int, notes: list[Message]) -> FloatArray:
    """Sensors in order over the cells in order; with fewer sensors than cells each stands for its neighbours."""
    count = sensors.shape[1]
    if count > n_cells:
        notes.append(Message("more-temperatures", count=count, cells=n_cells))
    elif count < n_cells:
        notes.append(Message("fewer-temperatures", count=count, cells=n_cells))
    index = np.arange(n_cells) if count >= n_cells else np.arange(n_cells) * count // n_cells
    return sensors[:, index]


def _rows(source: str, time_s: FloatArray, max_rate_hz: float, notes: list[Message]) -> NDArray[np.intp]:
    """Indices of the rows to take, ascending in time."""
    order: NDArray[np.intp] = np.flatnonzero(np.isfinite(time_s))
    if np.any(np.diff(time_s[order]) < 0):
        order = order[np.argsort(time_s[order], kind="stable")]
        notes.append(Message("rows-sorted"))
    if not len(order):
        raise ImportFailed(source, Message("no-row-has-time"))
    keep = np.append(True, np.diff(time_s[order]) > 0)
    if max_rate_hz > 0:
        bucket = np.floor((time_s[order] - time_s[order[0]]) * max_rate_hz + 1e-6)
        keep &= np.append(True, np.diff(bucket) > 0)
    if left_out := int(np.sum(~keep)) + int(np.sum(~np.isfinite(time_s))):
        notes.append(Message("rows-left-out", left=left_out, rows=len(time_s)))
    order = np.asarray(order[keep], np.intp)
    days = (time_s[order[-1]] - time_s[order[0]]) / 86_400
    if days > MAX_DAYS:
        raise ImportFailed(source, Message("days-too-long", days=f"{days:.0f}", most=MAX_DAYS))
    return order
