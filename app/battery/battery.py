"""A battery as a value: packs and their cells, temperature sensors, drawing, limits. Frozen; read from a profile."""

from dataclasses import dataclass, field

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.cell_model.default_cell import DEFAULT_CELL

LIMITS = (  # name of a limit, in a profile and here
    "cell_voltage_min_v",
    "cell_voltage_max_v",
    "temperature_min_degc",
    "temperature_max_degc",
    "discharge_current_max_a",
    "charge_current_max_a",
    "pack_voltage_max_v",
    "segment_voltage_max_v",
)


@dataclass(frozen=True, slots=True)
class Drawing:
    """Positions of the packs on the map."""

    rows: int = 1
    order: tuple[int, ...] = ()  # packs from left to right, row by row, from 0; empty: as they count
    turned: tuple[int, ...] = ()  # packs whose cells count from right to left


@dataclass(frozen=True, slots=True)
class SignalName:
    """A signal of the DBC; `message` is empty where one message only has one of this name."""

    message: str
    signal: str

    def __str__(self) -> str:
        return f"{self.message}.{self.signal}" if self.message else self.signal


Limit = float | SignalName


@dataclass(frozen=True, slots=True)
class Battery:
    """Cells count through the packs in order, from 0; `segments` are their numbers of cells."""

    name: str
    segments: tuple[int, ...]  # cells of each, >= 1
    parallel: int = 1  # cells in parallel that are measured as one
    cell: str = DEFAULT_CELL  # cell file, or name of a bundled one
    bleed_ohm: float | None = None  # balancing resistor of a cell [ohm]; None: unknown
    drawing: Drawing = Drawing()
    sensors: tuple[tuple[int, ...], ...] = ()  # cells of each temperature sensor
    limits: dict[str, Limit] = field(default_factory=dict, hash=False)  # by a name of LIMITS
    rules: dict[str, float] = field(default_factory=dict, hash=False)  # what the competition's rules say, likewise

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return sum(self.segments)

    @property
    def n_packs(self) -> int:
        """Number of packs."""
        return len(self.segments)

    @property
    def n_sensors(self) -> int:
        """Number of temperature sensors."""
        return len(self.sensors)

    @property
    def starts(self) -> tuple[int, ...]:
        """Index of the first cell of each pack."""
        starts, at = [], 0
        for cells in self.segments:
            starts.append(at)
            at += cells
        return tuple(starts)

    def place(self, cell: int) -> tuple[int, int]:
        """Return the pack of a cell and its place in it, both from 0.

        Raises:
            IndexError: the battery has no such cell.
        """
        if not 0 <= cell < self.n_cells:
            raise IndexError(cell)
        pack = max(i for i, start in enumerate(self.starts) if start <= cell)
        return pack, cell - self.starts[pack]

    def cell_at(self, pack: int, place: int) -> int | None:
        """Return the index of a cell by its pack and its place in it, both from 0; None where there is none."""
        if not (0 <= pack < self.n_packs and 0 <= place < self.segments[pack]):
            return None
        return self.starts[pack] + place

    def cell_temperatures(self, sensors_degc: FloatArray) -> FloatArray:
        """Return (..., n_cells) the highest reading of each cell's sensors; NaN where it has none.

        Args:
            sensors_degc: (..., n_sensors) readings, NaN where missing.
        """
        cells = np.full((*sensors_degc.shape[:-1], self.n_cells), np.nan)
        for sensor, stands_for in enumerate(self.sensors):
            for cell in stands_for:
                cells[..., cell] = np.fmax(cells[..., cell], sensors_degc[..., sensor])
        return cells


def each_cell(n_cells: int) -> tuple[tuple[int, ...], ...]:
    """One sensor a cell."""
    return tuple((cell,) for cell in range(n_cells))


def spread(n_sensors: int, cells: range) -> tuple[tuple[int, ...], ...]:
    """Sensors evenly over cells; more sensors than cells share a cell, fewer stand for several."""
    n = len(cells)
    return tuple(
        tuple(cells[i * n // n_sensors : max(i * n // n_sensors + 1, (i + 1) * n // n_sensors)])
        for i in range(n_sensors)
    )


def spread_in_packs(n_sensors: int, segments: tuple[int, ...]) -> tuple[tuple[int, ...], ...]:
    """Return as many sensors for each pack, evenly over its cells; `n_sensors` is a multiple of the number of packs."""
    groups: list[tuple[int, ...]] = []
    at = 0
    for cells in segments:
        groups += spread(n_sensors // len(segments), range(at, at + cells))
        at += cells
    return tuple(groups)
