"""CAN frames of a battery with a DBC to columns: each value at the time of its frame, and what all cells make together.

Pure, no I/O. The columns of two chunks go on in each other: what was heard last is held.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.battery.battery import Battery
from app.battery.source import SpeaksDbc
from app.estimation.arrays import FloatArray
from app.sessions.storage.battery_fields import EXTREMES, FIELD_OF_KIND, ages_of, has_sensor_a_cell
from app.sessions.storage.holding import Holder, Samples, grid_of
from app.sources.dbc.battery_decoder import BatteryDecoder, Values
from app.sources.dbc.definitions import Definitions
from app.sources.dbc.frames import TimedFrame, frames_of

TimesAndElements = tuple[NDArray[np.int64], int, FloatArray]


@dataclass(frozen=True, slots=True)
class ColumnOfBattery:
    """Samples of consecutive elements of a field, of one time axis."""

    field: str
    first_element: int
    times_us: NDArray[np.int64]  # (n,)
    values: FloatArray  # (n, elements)


class BatteryColumns:
    """Collects frames; `build` gives the columns."""

    def __init__(self, battery: Battery, source: SpeaksDbc, definitions: Definitions) -> None:
        self._battery = battery
        self._decoder = BatteryDecoder(battery, source, definitions)
        self._period_us = round(source.period_s * 1e6)
        self._frames: list[TimedFrame] = []
        self._is_direct = has_sensor_a_cell(battery)
        ages_s = ages_of(source)
        self._voltages = Holder(battery.n_cells, ages_s.get("v"))
        self._sensors = Holder(battery.n_sensors, ages_s["sensor"])
        self._grid_us: int | None = None  # what came last

    def __len__(self) -> int:
        return len(self._frames)

    def add(self, t_mono_ns: int, can_id: int, data: bytes) -> None:
        """Take a frame."""
        self._frames.append((t_mono_ns, can_id, data))

    def add_all(self, frames: Iterable[TimedFrame]) -> None:
        """Take frames in their order."""
        self._frames.extend(frames)

    def clear(self) -> None:
        """Forget the frames; what is held stays."""
        self._frames = []

    def build(self) -> list[ColumnOfBattery]:
        """Return what the frames tell, ordered by field and first element. To be called once before `clear`."""
        values = self._decoder.decode(frames_of(self._frames))
        found: list[ColumnOfBattery] = []
        for kind, of_kind in values.items():
            found += _columns(self._field_of(kind), of_kind)
        return [*found, *self._made_of(found)]

    def _field_of(self, kind: str) -> str:
        if kind == "temperature":
            return "t" if self._is_direct else "sensor"
        return FIELD_OF_KIND.get(kind, kind)

    def _made_of(self, found: list[ColumnOfBattery]) -> Iterator[ColumnOfBattery]:
        """Temperatures of cells out of those of sensors; extremes and means of all cells, one a period."""
        by_field: dict[str, list[ColumnOfBattery]] = defaultdict(list)
        for column in found:
            by_field[column.field].append(column)
        times = [each.times_us for each in found if len(each.times_us)]
        if not times:
            return
        first_us, last_us = min(int(each.min()) for each in times), max(int(each.max()) for each in times)
        first_us = first_us if self._grid_us is None else max(first_us, self._grid_us + 1)
        grid_us = grid_of(first_us, last_us, self._period_us)
        if not len(grid_us):
            return
        self._grid_us = int(grid_us[-1])
        voltage_v = self._voltages.rows(_samples(by_field["v"]), grid_us)
        sensors = by_field["t" if self._is_direct else "sensor"]
        sensors_degc = self._sensors.rows(_samples(sensors), grid_us)
        degc = self._battery.cell_temperatures(sensors_degc)
        if not self._is_direct:
            yield from _in_runs("t", self._of_sensors(sensors, degc, grid_us))
        for (name, _), cells in zip(EXTREMES, (voltage_v, degc), strict=True):
            yield from _extremes(name, cells, grid_us)
        if not by_field["v_tot"]:
            rows = np.isfinite(voltage_v).all(axis=1)
            if rows.any():
                yield ColumnOfBattery("v_tot", 0, grid_us[rows], voltage_v[rows].sum(axis=1)[:, None])

    def _of_sensors(
        self, sensors: list[ColumnOfBattery], degc: FloatArray, grid_us: NDArray[np.int64]
    ) -> Iterator[TimesAndElements]:
        """A cell with one sensor has its samples; one with several their highest at every period."""
        one: dict[int, tuple[NDArray[np.int64], FloatArray]] = {
            column.first_element + i: (column.times_us, column.values[:, i])
            for column in sensors
            for i in range(column.values.shape[1])
        }
        of_cell: dict[int, list[int]] = defaultdict(list)
        for sensor, cells in enumerate(self._battery.sensors):
            for cell in cells:
                of_cell[cell].append(sensor)
        for cell in sorted(of_cell):
            if len(of_cell[cell]) > 1:
                rows = np.isfinite(degc[:, cell])
                if rows.any():
                    yield grid_us[rows], cell, degc[rows, cell]
            elif of_cell[cell][0] in one:
                times_us, values = one[of_cell[cell][0]]
                yield times_us, cell, values


def _samples(columns: list[ColumnOfBattery]) -> Iterator[Samples]:
    for column in columns:
        yield np.arange(column.values.shape[1]) + column.first_element, column.times_us, column.values


def _columns(field: str, values: Values) -> Iterator[ColumnOfBattery]:
    """Values in the order of frames to a column for each run of elements that are told by the same frames."""
    order = np.argsort(values.index, kind="stable")
    index, times_us, value = values.index[order], values.t_ns[order] // 1000, values.value[order]
    elements, starts = np.unique(index, return_index=True)
    ends = [*starts[1:].tolist(), len(index)]
    each = (
        (times_us[start:end], element, value[start:end])
        for element, start, end in zip(elements.tolist(), starts.tolist(), ends, strict=True)
    )
    return _in_runs(field, each)


def _in_runs(field: str, each: Iterator[TimesAndElements]) -> Iterator[ColumnOfBattery]:
    """Consecutive elements with the same times as one column."""
    run: list[TimesAndElements] = []

    def column() -> ColumnOfBattery:
        return ColumnOfBattery(field, run[0][1], run[0][0], np.column_stack([values for _, _, values in run]))

    for times_us, element, values in each:
        if run and (element != run[-1][1] + 1 or not np.array_equal(times_us, run[0][0])):
            yield column()
            run = []
        run.append((times_us, element, values))
    if run:
        yield column()


def _extremes(name: str, cells: FloatArray, grid_us: NDArray[np.int64]) -> Iterator[ColumnOfBattery]:
    rows = np.isfinite(cells).any(axis=1)
    if not rows.any():
        return
    known, times_us = cells[rows], grid_us[rows]
    low, high = np.nanargmin(known, axis=1), np.nanargmax(known, axis=1)
    everything = np.arange(len(known))
    for which, values in (
        ("min", known[everything, low]),
        ("max", known[everything, high]),
        ("avg", np.nanmean(known, axis=1)),
        ("min_id", low.astype(np.float64)),
        ("max_id", high.astype(np.float64)),
    ):
        yield ColumnOfBattery(f"{name}_{which}", 0, times_us, values[:, None])
