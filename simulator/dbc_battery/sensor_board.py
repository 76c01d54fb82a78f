"""The sensors of an ordinary BMS: cell inputs, temperature sensors that stand for some cells, current."""

import numpy as np

from simulator.accumulator import Accumulator
from simulator.bms_state import Latch
from simulator.cell_data import BoolArray, FloatArray
from simulator.dbc_battery.battery import DbcBattery
from simulator.sensors import AMPERES_PER_COUNT, ZERO_COUNT, CellInputs, CurrentSensor, NoisePool

_TEMPERATURE_NOISE_K = 0.05
_SAMPLES = 20  # current samples in a mean


class SensorBoard:
    """Faults of sensors and wires are in force here. A value that its wire or board has lost is NaN."""

    def __init__(self, battery: DbcBattery, rng: np.random.Generator) -> None:
        self._shape = battery.shape
        self._sensors = battery.sensors
        n = battery.shape.n_cells
        self._share = np.zeros((len(battery.sensors), n))  # share of each cell in a sensor's reading
        for sensor, cells in enumerate(battery.sensors):
            self._share[sensor, list(cells)] = 1.0 / max(len(cells), 1)
        self._pack = np.repeat(np.arange(battery.shape.n_packs), battery.shape.packs)
        self._noise = NoisePool(rng)
        self.current_sensor = CurrentSensor(rng, self._noise)
        self.cell_inputs = CellInputs(n, rng, self._noise)
        self.latch = Latch()
        self.link_share = 0.0  # the link's voltage over the battery's
        self.open_wires: set[int] = set()  # cells whose upper wire is off
        self._is_powered: BoolArray = np.ones(battery.shape.n_packs, dtype=bool)
        self._factor = np.ones(n)
        self._range = max(battery.size, 1.0)  # range of the current sensor over that of the team's
        self.voltage_v: FloatArray = np.full(n, np.nan)
        self.temperature_degc: FloatArray = np.full(len(battery.sensors), np.nan)

    def set_powered(self, pack: int, is_powered: bool) -> None:
        """Connect or lose the board of a pack."""
        self._is_powered[pack] = is_powered

    def drift(self, pack: int, factor: float) -> None:
        """Set what the voltages of a pack read, over the true ones."""
        self._factor[self._shape.cells(pack)] = factor

    def sense_voltages(self, accumulator: Accumulator) -> None:
        """Measure the cells; an open wire takes both its neighbours' voltages."""
        volts = self.cell_inputs.read(accumulator.terminal_voltage_v) * self._factor
        for cell in self.open_wires:
            last = self._shape.cells(int(self._pack[cell])).stop - 1
            volts[cell : min(cell, last - 1) + 2] = np.nan
        if not self._is_powered.all():
            volts[~self._is_powered[self._pack]] = np.nan
        self.voltage_v = volts

    def sense_temperatures(self, accumulator: Accumulator) -> None:
        """Measure what the sensors stand at: the mean of their cells; one that is stuck shows what it is stuck at."""
        inputs, n = self.cell_inputs, len(self._sensors)
        degc = self._share @ accumulator.temperature_degc + self._noise.draw(n) * _TEMPERATURE_NOISE_K
        stuck = np.isfinite(inputs.temperature_stuck_degc)
        for sensor in np.flatnonzero(self._share @ stuck):
            cells = self._sensors[sensor]
            degc[sensor] = np.nanmax(inputs.temperature_stuck_degc[list(cells)])
        lost = inputs.temperature_unplugged | ~self._is_powered[self._pack]
        degc[self._share @ lost > 0.0] = np.nan
        degc[self._share.sum(axis=1) == 0.0] = accumulator.ambient_degc
        self.temperature_degc = degc

    def sense_current_a(self, true_a: float) -> float:
        """Measure the current [A]."""
        counts = self.current_sensor.sample(true_a / self._range, _SAMPLES)
        return (float(counts.mean()) - ZERO_COUNT) * AMPERES_PER_COUNT * self._range
