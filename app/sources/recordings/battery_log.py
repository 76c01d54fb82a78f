"""A battery's recording in our units, out of a table and a profile. Pure numbers; no file, no clock."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.battery.fields import MOST_CELLS
from app.errors import ImportFailed
from app.estimation.arrays import FloatArray
from app.estimation.recording.cell_recording import Recording
from app.estimation.recording.current_means import takes_means
from app.sources.recordings.clock import own_times, rows_in_time
from app.sources.recordings.import_mapping import ImportMapping, parse_cells
from app.sources.recordings.impossible import CELL_V, cell_voltages, measured_currents, measured_temperatures
from app.sources.recordings.quantities import flows_both_ways_unsigned, in_our_unit, signed
from app.sources.recordings.table import Table
from app.words import Message, Quantity

DEFAULT_PERIOD_S = 0.1


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
    first_s: float  # time of the first row by the file's clock
    means_s: float = 0.0  # over which each current is a mean; 0: instants


def battery_log(table: Table, mapping: ImportMapping) -> BatteryLog:
    """Return the recording that a table holds.

    Raises:
        ImportFailed: a column is missing, there are more cells than a battery may have, or no row can be used.
    """
    mapping.check_complete(table.source, table.columns)
    notes = list(table.notes)
    current_a = in_our_unit(table.column("current", mapping.current), "current", mapping.current_unit)
    current_a, direction = signed(measured_currents(current_a, notes), table.columns)
    voltages_v = in_our_unit(table.matrix("voltages", mapping.voltages), "voltage", mapping.voltage_unit)
    if mapping.cells_in_series > 1.0:
        voltages_v = voltages_v / mapping.cells_in_series
        notes.append(Message("cells-in-series", column=mapping.voltages, cells=mapping.cells_in_series))
    voltages_v = cell_voltages(voltages_v, notes)
    chosen = _chosen(table.source, mapping.cells, voltages_v.shape[1])
    n_cells = len(chosen)
    if n_cells > MOST_CELLS:
        raise ImportFailed(
            table.source, Message("too-many-cells", pattern=repr(mapping.voltages), cells=n_cells, most=MOST_CELLS)
        )
    temperatures = np.full((len(current_a), n_cells), np.nan)
    turns = mapping.charge_positive and direction is None
    if direction is not None:
        notes.append(Message("current-no-sign", column=mapping.current, direction=direction))
    mean_v = np.mean(voltages_v, axis=1)
    is_finite = np.isfinite(current_a) & np.isfinite(mean_v)
    if direction is None and flows_both_ways_unsigned(current_a[is_finite], mean_v[is_finite]):
        notes.append(Message("current-unsigned", column=mapping.current))
    if turns:
        notes.append(Message("sign-turned", column=mapping.current))
    if n_cells < voltages_v.shape[1]:
        notes.append(Message("cells-taken", taken=n_cells, cells=voltages_v.shape[1], chosen=mapping.cells))
    if n_cells == 1 and mapping.cells_in_series == 1.0:
        notes.append(Message("test-of-one-cell"))
    if mapping.temperatures:
        sensors = table.matrix("temperatures", mapping.temperatures)
        sensors = measured_temperatures(in_our_unit(sensors, "temperature", mapping.temperature_unit), notes)
        temperatures = _spread(sensors, voltages_v.shape[1], notes)
        temperatures = temperatures[:, chosen]
    soc = in_our_unit(table.column("soc", mapping.soc), "soc", mapping.soc_unit) if mapping.soc else None
    if mapping.time and not mapping.time_unit:
        raise ImportFailed(table.source, Message("time-unit-unclear", column=mapping.time))
    time_s: FloatArray = (
        in_our_unit(table.column("time", mapping.time), "time", mapping.time_unit)
        if mapping.time
        else np.arange(len(current_a), dtype=np.float64) * DEFAULT_PERIOD_S
    )
    if not mapping.time:
        notes.append(Message("no-time-column", period=Quantity(DEFAULT_PERIOD_S, "s")))
    rows, time_s, started_unix_s = rows_in_time(table.source, time_s, notes)
    time_s = own_times(time_s, notes)
    keep = _kept(time_s, mapping.max_rate_hz, notes)
    rows, time_s = rows[keep], time_s[keep]
    taken_v = voltages_v[rows][:, chosen]
    full_v = np.where((taken_v > CELL_V[0]) & (taken_v < CELL_V[1]), taken_v, np.nan)
    if np.isnan(full_v).all():
        raise ImportFailed(table.source, Message("no-cell-voltage", unit=mapping.voltage_unit))
    current_a = -current_a[rows] if turns else current_a[rows]
    means_s = _means_s(mapping.current_means, time_s, current_a, full_v)
    if means_s:
        notes.append(Message("current-means", column=mapping.current))
    return BatteryLog(
        time_s - time_s[0],
        started_unix_s if started_unix_s is not None else table.started_unix_s(int(rows[0])),
        current_a,
        full_v,
        temperatures[rows],
        None if soc is None else soc[rows],
        n_cells,
        tuple(notes),
        float(time_s[0]),
        means_s,
    )


def _means_s(choice: str, time_s: FloatArray, current_a: FloatArray, voltages_v: FloatArray) -> float:
    """Return the usual step where currents are means over it, else 0; judged by the mean cell."""
    seen = np.isfinite(current_a) & np.isfinite(voltages_v).any(axis=1)
    unknown = np.full(np.count_nonzero(seen), np.nan)
    cell_v = np.nanmean(voltages_v[seen], axis=1)
    mean_cell = Recording("", time_s[seen], current_a[seen], cell_v, unknown, unknown, ())
    return mean_cell.usual_step_s if takes_means(choice, mean_cell) else 0.0


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


def _kept(time_s: FloatArray, max_rate_hz: float, notes: list[Message]) -> NDArray[np.bool_]:
    """Return which of (n,) ascending times are kept: every one, or no more a second than is wanted."""
    if max_rate_hz <= 0:
        return np.ones(len(time_s), np.bool_)
    bucket = np.floor((time_s - time_s[0]) * max_rate_hz + 1e-6)
    keep = np.append(True, np.diff(bucket) > 0)
    if left_out := int(np.sum(~keep)):
        notes.append(Message("rows-left-out", left=left_out, rows=len(time_s)))
    return keep
