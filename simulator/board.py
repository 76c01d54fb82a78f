"""The hardware around the master that is not reset with it: sensors, slaves, EEPROM, the latch, the count of boots."""

import numpy as np

from firmware_protocol.ltc6804 import SENSOR_FIRST_DEGC, SENSOR_POINTS_V, SENSOR_STEP_DEGC
from firmware_protocol.memory_map import CELLS_PER_PACK, N_CELLS, N_PACKS
from simulator.accumulator import Accumulator
from simulator.bms_state import Latch
from simulator.eeprom import Eeprom
from simulator.sensors import TEMPERATURE_NOISE_V, CellInputs, CurrentSensor, NoisePool
from simulator.slave import THESIS_SENSOR_INPUTS, SlaveChain

_CURVE_DEGC = SENSOR_FIRST_DEGC + SENSOR_STEP_DEGC * np.arange(len(SENSOR_POINTS_V), dtype=np.float64)
_CURVE_V = np.array(SENSOR_POINTS_V)


class Board:
    """The sensors, slaves and EEPROM that the firmware uses."""

    def __init__(
        self, eeprom: Eeprom, rng: np.random.Generator, sensor_inputs: tuple[int, ...] = THESIS_SENSOR_INPUTS
    ) -> None:
        self.rng = rng
        self.noise = NoisePool(rng)
        self.eeprom = eeprom
        self.chain = SlaveChain(N_PACKS, rng, sensor_inputs)
        first = CELLS_PER_PACK * np.arange(N_PACKS)[:, None]
        self._cell_of_input = (first + np.argsort(sensor_inputs)).reshape(-1)
        self.current_sensor = CurrentSensor(rng, self.noise)
        self.cell_inputs = CellInputs(N_CELLS, rng, self.noise)
        self.latch = Latch()
        self.link_share = 0.0  # the link's voltage over the accumulator's, compared by the pre-charge board
        self.boots = 0

    @property
    def open_wires(self) -> set[int]:
        """Cells whose upper wire is off."""
        return self.chain.converters.open_wires

    def set_powered(self, pack: int, is_powered: bool) -> None:
        """Connect or lose the slave of a pack."""
        self.chain.set_powered(pack, is_powered)

    def drift(self, pack: int, factor: float) -> None:
        """Set what the voltages of a pack read, over the true ones."""
        self.chain.converters.drift(pack, factor)

    def sense_voltages(self, accumulator: Accumulator) -> None:
        """Put the accumulator's voltages at the slaves' inputs."""
        self.chain.converters.cell_v = self.cell_inputs.read(accumulator.terminal_voltage_v)

    def sense_temperatures(self, accumulator: Accumulator) -> None:
        """Put the temperature sensors' voltages at the slaves' inputs."""
        degc = self.cell_inputs.read_temperature(accumulator.temperature_degc)
        sensor_v = np.interp(degc, _CURVE_DEGC, _CURVE_V) + self.noise.draw(N_CELLS) * TEMPERATURE_NOISE_V
        sensor_v = np.where(self.cell_inputs.temperature_unplugged, 0.0, sensor_v)
        self.chain.converters.sensor_v = sensor_v.take(self._cell_of_input)
        self.chain.converters.board_degc = float(accumulator.board_temperature_degc.mean())
