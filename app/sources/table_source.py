"""A table of another system as a battery: its rows are measurements, each at its own time; nothing is decoded."""

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from app.battery.battery import Battery, SignalName
from app.errors import ImportFailed
from app.estimation.arrays import FloatArray
from app.estimation.recording.cell_recording import GAP_STEPS
from app.estimation.recording.current_means import step_means
from app.sources.dbc.assembly import NewestValues
from app.sources.dbc.battery_decoder import ChannelValues
from app.sources.dbc.source import UpdateInterval, measurement_of
from app.sources.items import Item, TableItem
from app.sources.links.monitor import LinkMonitor
from app.sources.loaded_battery import LoadedBattery, battery_from_files, team_battery
from app.sources.recordings.battery_log import BatteryLog
from app.sources.source import NOTHING_RECEIVED, Received
from app.telemetry import Identity, Links, Source
from app.telemetry.measurement import Measurement
from app.words import Message

_NEVER_NS = -(1 << 62)


def battery_of_table(log: BatteryLog, source: str, like: LoadedBattery | None = None) -> LoadedBattery:
    """Return the battery of a table, as its session keeps it.

    Args:
        log: what the table holds.
        source: name of its file.
        like: a battery whose shape, cell and limits are the table's; None: the team's for as many cells as it has,
            else one pack.

    Raises:
        ImportFailed: `like` has another number of cells.
    """
    if like is not None and like.battery.n_cells != log.n_cells:
        raise ImportFailed(source, Message("not-so-many-cells", cells=log.n_cells, expected=like.battery.n_cells))
    if like is None and log.n_cells == team_battery().battery.n_cells:
        like = team_battery()
    battery = Battery(source, (log.n_cells,)) if like is None else like.battery
    drawing = battery.drawing
    limits = {name: limit for name, limit in battery.limits.items() if not isinstance(limit, SignalName)}
    lines = [
        "# The battery of an imported table.",
        "[battery]",
        f"name = {json.dumps(battery.name)}",
        f"packs = {list(battery.segments)}",
        f"parallel = {battery.parallel}",
        f"cell = {json.dumps(battery.cell)}",
        "[battery.drawing]",
        f"rows = {drawing.rows}",
        *([f"order = {[segment + 1 for segment in drawing.order]}"] if drawing.order else []),
        f"turned = {[segment + 1 for segment in drawing.turned]}",
        "[battery.temperatures]",
        f"sensors = {log.n_cells if np.isfinite(log.temperatures_degc).any() else 0}",
    ]
    for table, values in (("limits", limits), ("rules", battery.rules)):
        lines += [f"[battery.{table}]", *(f"{name} = {value!r}" for name, value in values.items())] if values else []
    lines += ["[source]", 'kind = "table"', *([f"means_s = {log.means_s!r}"] if log.means_s else []), ""]
    return battery_from_files({"table.toml": "\n".join(lines).encode()})


def numbers_of_rows(log: BatteryLog, battery: Battery) -> FloatArray:
    """Return the (n, 2 + n_cells + n_sensors) numbers of all rows: what a `TableItem` holds."""
    soc = np.full(len(log.time_s), np.nan) if log.soc is None else log.soc
    return np.column_stack([log.current_a, soc, log.voltages_v, log.temperatures_degc[:, : battery.n_sensors]])


class TableSource:
    """Rows of a table in, measurements out. Called from one thread; time comes with the rows."""

    identity: Identity | None = None
    due_ns: int | None = None

    def __init__(self, battery: Battery, name: Source = "replay", means_s: float = 0.0) -> None:
        """Each current is a mean over so long; 0: of the instant."""
        self.name: Source = name
        self._means_s = means_s
        self.battery = battery
        self._rs232, self._can = LinkMonitor(None), LinkMonitor(None)
        self._rhythm = UpdateInterval()
        self._sampled_ns: int | None = None
        self._values = NewestValues(battery, {})
        self._newest = self._values.measure(_NEVER_NS)
        self._row_v = np.full(battery.n_cells, np.nan)  # voltages of the row before, with its holes
        counts = {"current": 1, "soc": 1, "voltage": battery.n_cells, "temperature": battery.n_sensors}
        ends = np.cumsum(list(counts.values())).tolist()
        self._places = {kind: slice(end - n, end) for (kind, n), end in zip(counts.items(), ends, strict=True)}

    def accept_replies_for(self, is_asked: Callable[[Any], bool]) -> None:
        """A table answers nothing."""

    def feed(self, item: Item) -> Received:
        """Take a row; a measurement follows each. What a row does not hold stays, with its age."""
        if not isinstance(item, TableItem) or len(item.numbers) != 2 + self.battery.n_cells + self.battery.n_sensors:
            return NOTHING_RECEIVED
        before_v, self._row_v = self._row_v, item.numbers[self._places["voltage"]]
        new: dict[str, int] = {}
        for kind, place in self._places.items():
            numbers = item.numbers[place]
            index = np.flatnonzero(np.isfinite(numbers))
            if len(index):
                times_ns = np.full(len(index), item.t_mono_ns, np.int64)
                new[kind] = self._values.take(kind, ChannelValues(times_ns, index, numbers[index]))
        measurement = self._newest = self._values.measure(item.t_mono_ns, new)
        self._rhythm.see(measurement)
        before_ns = self._sampled_ns
        if measurement.is_sample:
            self._sampled_ns = item.t_mono_ns
        dt_s = None if before_ns is None or not measurement.is_sample else (item.t_mono_ns - before_ns) / 1e9
        measured = self._measurement(item.t_mono_ns, item.t_wall_ns, dt_s, is_fresh=True)
        if self._means_s and dt_s is not None:
            means_v = step_means(before_v, self._row_v, dt_s <= GAP_STEPS * self._means_s)
            measured = replace(measured, step_voltage_v=means_v)
        return Received(measured)

    def measure(self, t_mono_ns: int, t_wall_ns: int) -> Measurement:
        """Return a measurement in which nothing is new but the ages."""
        return self._measurement(t_mono_ns, t_wall_ns, None, is_fresh=False)

    def _measurement(self, t_mono_ns: int, t_wall_ns: int, dt_s: float | None, *, is_fresh: bool) -> Measurement:
        return measurement_of(
            self.battery,
            self._newest,
            t_mono_ns,
            t_wall_ns,
            dt_s=dt_s,
            is_sample=is_fresh and self._newest.is_sample,
            is_fresh=is_fresh,
            links=Links(self._rs232.status(t_mono_ns), self._can.status(t_mono_ns)),
            live_s=self._rhythm.live_s(),
        )
