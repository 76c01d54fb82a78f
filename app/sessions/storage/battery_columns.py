"""Measurements of a battery without our memory map, as columns: by CAN frames and a DBC, or in rows of a table.

Pure, no I/O. Each value is at its own time, and so is what all cells make together. The columns of two chunks go on in
each other: what a frame carried last is held.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.battery.battery import Battery
from app.battery.serial import SerialMapping
from app.battery.source import DbcMapping
from app.estimation.arrays import FloatArray
from app.sessions.storage.battery_fields import EXTREMES, FIELD_OF_KIND, ages_of, has_sensor_a_cell
from app.sources.dbc.assembly import LEAST_AGE_S, PERIODS_BRIDGED, UNKNOWN_AGE_S
from app.sources.dbc.battery_decoder import BatteryDecoder, ChannelValues
from app.sources.dbc.definitions import Definitions
from app.sources.dbc.frames import TimedFrame, frames_of
from app.sources.serial.decoder import SerialDecoder
from app.sources.serial.framing import StreamReader

_NEVER_US = -np.inf
Samples = tuple[NDArray[np.intp], NDArray[np.int64], FloatArray]  # (k,) elements, (n,) times [us], (n, k) values


class Holder:
    """Remembers the newest value of each element from one call to the next."""

    def __init__(self, n_elements: int, max_age_s: float | None = None) -> None:
        """`max_age_s`: from then on a value is missing; None: three of its own periods as received."""
        self._value = np.full(n_elements, np.nan)
        self._t_us = np.full(n_elements, _NEVER_US)
        self._period_us = np.full(n_elements, np.nan)
        self._max_age_s = max_age_s

    def rows(self, samples: Iterable[Samples], grid_us: NDArray[np.int64]) -> FloatArray:
        """Return (n, elements) the newest values at ascending times; samples are not older than those of before."""
        return self.rows_and_times(samples, grid_us)[0]

    def rows_and_times(self, samples: Iterable[Samples], grid_us: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
        """Return `rows`, and the (n, elements) times of the values [us]."""
        shape = (len(grid_us), len(self._value))
        latest, at_us = np.broadcast_to(self._value, shape).copy(), np.broadcast_to(self._t_us, shape).copy()
        for elements, times_us, values in samples:
            self._learn(elements, times_us)
            newest = np.searchsorted(times_us, grid_us, side="right") - 1
            is_there = np.flatnonzero(newest >= 0)
            newest = newest[is_there]
            place = np.ix_(is_there, elements)
            is_newer = times_us[newest][:, None] >= at_us[place]
            latest[place] = np.where(is_newer, values[newest], latest[place])
            at_us[place] = np.where(is_newer, times_us[newest][:, None], at_us[place])
            last = times_us[-1] >= self._t_us[elements]
            self._value[elements] = np.where(last, values[-1], self._value[elements])
            self._t_us[elements] = np.where(last, times_us[-1], self._t_us[elements])
        age_us = grid_us[:, None] - at_us
        latest[age_us > self._most_us()] = np.nan
        return latest, at_us

    def _learn(self, elements: NDArray[np.intp], times_us: NDArray[np.int64]) -> None:
        """The longest gap between two samples that is no pause."""
        before_us = self._t_us[elements[0]]
        gaps_us = np.diff(times_us, prepend=before_us) if before_us != _NEVER_US else np.diff(times_us)
        gaps_us = gaps_us[gaps_us > 0]
        if len(gaps_us):
            self._period_us[elements] = min(float(gaps_us.max()), PERIODS_BRIDGED * float(np.median(gaps_us)))

    def _most_us(self) -> FloatArray | float:
        if self._max_age_s is not None:
            return 1e6 * self._max_age_s
        most_us = np.maximum(1e6 * LEAST_AGE_S, PERIODS_BRIDGED * self._period_us)
        return np.where(np.isnan(most_us), 1e6 * UNKNOWN_AGE_S, most_us)


def grid_of(first_us: int, last_us: int, period_us: int) -> NDArray[np.int64]:
    """Return the multiples of a period within a range, ends included."""
    return np.arange(-(-first_us // period_us), last_us // period_us + 1, dtype=np.int64) * period_us


TimesAndElements = tuple[NDArray[np.int64], int, FloatArray]


@dataclass(frozen=True, slots=True)
class ColumnOfBattery:
    """Samples of consecutive elements of a field, of one time axis."""

    field: str
    first_element: int
    times_us: NDArray[np.int64]  # (n,)
    values: FloatArray  # (n, elements)


class CanFrames:
    """CAN frames into values."""

    def __init__(self, decoder: BatteryDecoder) -> None:
        self._decoder = decoder

    @property
    def bad_checksums(self) -> int:
        """Frames whose checksum does not fit."""
        return self._decoder.bad_checksums

    @property
    def absent_values(self) -> int:
        """Temperatures of sensors that are not connected."""
        return int(self._decoder.absent.sum())

    def decode(self, frames: Sequence[TimedFrame]) -> dict[str, ChannelValues]:
        """Return what the frames hold, by kind."""
        return self._decoder.decode(frames_of(frames))


class FrameBytes:
    """Bytes of a serial line into values; a frame may begin in one chunk and end in the next."""

    def __init__(self, battery: Battery, mapping: SerialMapping) -> None:
        self._reader = StreamReader(mapping)
        self._decoder = SerialDecoder(battery, mapping)

    @property
    def bad_checksums(self) -> int:
        """Frames whose checksum does not fit."""
        return self._reader.bad_frames

    @property
    def absent_values(self) -> int:
        """Temperatures of sensors that are not connected."""
        return self._decoder.absent

    def decode(self, pieces: Sequence[TimedFrame]) -> dict[str, ChannelValues]:
        """Return what the bytes hold, by kind."""
        return self._decoder.decode(frame for t_ns, _, raw in pieces for frame in self._reader.feed(raw, t_ns))


class BatteryColumns:
    """Collects frames; `build` gives the columns."""

    def __init__(self, battery: Battery, source: DbcMapping | SerialMapping, definitions: Definitions) -> None:
        self._battery = battery
        self._decoder = (
            FrameBytes(battery, source)
            if isinstance(source, SerialMapping)
            else CanFrames(BatteryDecoder(battery, source, definitions))
        )
        self._period_us = round(source.period_s * 1e6)
        self._frames: list[TimedFrame] = []
        self._is_direct = has_sensor_a_cell(battery)
        ages_s = ages_of(source)
        self._voltages = Holder(battery.n_cells, ages_s.get("v"))
        self._sensors = Holder(battery.n_sensors, ages_s["sensor"])
        self._grid_us: int | None = None  # what came last

    def __len__(self) -> int:
        return len(self._frames)

    @property
    def bad_checksums(self) -> int:
        """Frames whose checksum does not fit."""
        return self._decoder.bad_checksums

    @property
    def absent_values(self) -> int:
        """Temperatures of sensors that are not connected."""
        return self._decoder.absent_values

    def add_all(self, frames: Iterable[TimedFrame]) -> None:
        """Take frames in their order."""
        self._frames.extend(frames)

    def clear(self) -> None:
        """Forget the frames; what is held stays."""
        self._frames = []

    def build(self) -> list[ColumnOfBattery]:
        """Return what the frames tell, ordered by field and first element. To be called once before `clear`."""
        values = self._decoder.decode(self._frames)
        columns: list[ColumnOfBattery] = []
        for kind, of_kind in values.items():
            columns += _columns(self._field_of(kind), of_kind)
        return [*columns, *self._made_of(columns)]

    def _field_of(self, kind: str) -> str:
        if kind == "temperature":
            return "t" if self._is_direct else "sensor"
        return FIELD_OF_KIND.get(kind, kind)

    def _made_of(self, columns: list[ColumnOfBattery]) -> Iterator[ColumnOfBattery]:
        """Temperatures of cells out of those of sensors; extremes and means of all cells, one a period."""
        by_field: dict[str, list[ColumnOfBattery]] = defaultdict(list)
        for column in columns:
            by_field[column.field].append(column)
        times = [column.times_us for column in columns if len(column.times_us)]
        if not times:
            return
        first_us, last_us = (
            min(int(times_of_column.min()) for times_of_column in times),
            max(int(times_of_column.max()) for times_of_column in times),
        )
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
            yield from _total(voltage_v, grid_us)

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


class TableColumns:
    """Collects rows of a table; `build` gives the columns."""

    def __init__(self, battery: Battery) -> None:
        self._n_cells = battery.n_cells
        self._times_us: list[int] = []
        self._rows: list[bytes] = []

    def __len__(self) -> int:
        return len(self._rows)

    def add_all(self, rows: Iterable[tuple[int, bytes]]) -> None:
        """Take rows in their order: monotonic time [ns], the numbers of a `TableItem` as bytes."""
        for t_mono_ns, numbers in rows:
            self._times_us.append(t_mono_ns // 1000)
            self._rows.append(numbers)

    def clear(self) -> None:
        """Forget the rows."""
        self._times_us, self._rows = [], []

    def build(self) -> Iterator[ColumnOfBattery]:
        """Yield what was measured, as one column a field."""
        if not self._rows:
            return
        times_us, of = np.array(self._times_us, np.int64), 2 + self._n_cells
        rows = np.frombuffer(b"".join(self._rows), "<f8").reshape(len(times_us), -1)
        voltage_v, degc = rows[:, 2:of], rows[:, of:]
        for field, values in (("i_fs", rows[:, :1]), ("soc", rows[:, 1:2]), ("v", voltage_v), ("t", degc)):
            if np.isfinite(values).any():
                yield ColumnOfBattery(field, 0, times_us, np.ascontiguousarray(values))
        for (name, _), cells in zip(EXTREMES, (voltage_v, degc), strict=True):
            yield from _extremes(name, cells, times_us)
        yield from _total(voltage_v, times_us)


def _samples(columns: list[ColumnOfBattery]) -> Iterator[Samples]:
    for column in columns:
        yield np.arange(column.values.shape[1]) + column.first_element, column.times_us, column.values


def _columns(field: str, values: ChannelValues) -> Iterator[ColumnOfBattery]:
    """Values in the order of frames to a column for each run of elements that the same frames carry."""
    order = np.argsort(values.index, kind="stable")
    index, times_us, value = values.index[order], values.t_ns[order] // 1000, values.value[order]
    elements, starts = np.unique(index, return_index=True)
    ends = [*starts[1:].tolist(), len(index)]
    runs = (
        (times_us[start:end], element, value[start:end])
        for element, start, end in zip(elements.tolist(), starts.tolist(), ends, strict=True)
    )
    return _in_runs(field, runs)


def _in_runs(field: str, runs: Iterator[TimesAndElements]) -> Iterator[ColumnOfBattery]:
    """Consecutive elements with the same times as one column."""
    run: list[TimesAndElements] = []

    def column() -> ColumnOfBattery:
        return ColumnOfBattery(field, run[0][1], run[0][0], np.column_stack([values for _, _, values in run]))

    for times_us, element, values in runs:
        if run and (element != run[-1][1] + 1 or not np.array_equal(times_us, run[0][0])):
            yield column()
            run = []
        run.append((times_us, element, values))
    if run:
        yield column()


def _total(voltage_v: FloatArray, times_us: NDArray[np.int64]) -> Iterator[ColumnOfBattery]:
    """Sum of all cells, missing from where one is missing on: the last one would be held for the present one."""
    rows = np.isfinite(voltage_v).any(axis=1)
    if np.isfinite(voltage_v).all(axis=1).any():
        yield ColumnOfBattery("v_tot", 0, times_us[rows], voltage_v[rows].sum(axis=1)[:, None])


def _extremes(name: str, cells: FloatArray, grid_us: NDArray[np.int64]) -> Iterator[ColumnOfBattery]:
    rows = np.isfinite(cells).any(axis=1)
    if not rows.any():
        return
    measured, times_us = cells[rows], grid_us[rows]
    low, high = np.nanargmin(measured, axis=1), np.nanargmax(measured, axis=1)
    everything = np.arange(len(measured))
    for which, values in (
        ("min", measured[everything, low]),
        ("max", measured[everything, high]),
        ("avg", np.nanmean(measured, axis=1) if name == "t" else measured.mean(axis=1)),
        ("min_id", low.astype(np.float64)),
        ("max_id", high.astype(np.float64)),
    ):
        yield ColumnOfBattery(f"{name}_{which}", 0, times_us, values[:, None])
