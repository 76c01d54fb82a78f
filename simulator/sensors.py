"""The measuring hardware with its errors: true values in, readings of the converters out.

Figures: HAL 400-S and its divider, LTC6804 total measurement error, the module's temperature sensor.
"""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

ADC_MAX = 4095  # 12 bit at 3.3 V
AMPERES_PER_COUNT = 0.2424
ZERO_COUNT = 2049.0
ADC_NOISE_COUNTS = 0.663  # 0.534 mV rms at 3.3 V / 4096
UNPLUGGED_A = 308.0  # where the amplifier drifts without the sensor
UNPLUGGED_COUNT = round(ZERO_COUNT + UNPLUGGED_A / AMPERES_PER_COUNT)
UNPLUGGED_WIDTH = 4  # counts either side, six times the converter's noise
CELL_ERROR_LIMIT_V = 1.2e-3
CELL_ERROR_STD_V = 4e-4
CELL_NOISE_V = 1e-4
TEMPERATURE_NOISE_V = 5e-4
_NOISE_POOL = 1 << 16
_STRIDE = 97
_NOISE_ROWS = 1 << 10
_NOISE_COUNTS = 10.0  # further from its mean no sample of the pool is


class NoisePool:
    """Normal noise from a table that is drawn once: new numbers every 20 ms would cost more than the physics."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._table = rng.standard_normal(_NOISE_POOL)
        self._at = 0

    def draw(self, n: int) -> FloatArray:
        """Return the next n standard normal numbers, a view that is not to be written."""
        if self._at + n > _NOISE_POOL:
            self._at = (self._at + n) % _STRIDE  # another phase than in the last round
        start = self._at
        self._at += n
        return self._table[start : start + n]


class CurrentSensor:
    """Hall sensor, amplifier and 12-bit converter; current is positive on discharge."""

    def __init__(self, rng: np.random.Generator, noise: NoisePool) -> None:
        self._noise = noise
        self._gain = 1 + float(np.clip(rng.normal(0, 0.003), -0.01, 0.01))
        self._zero_a = float(np.clip(rng.normal(0, 0.15), -0.5, 0.5))
        self.extra_offset_a = 0.0
        self.is_unplugged = False

    def sample(self, current_a: float, n: int) -> FloatArray:
        """Return n converter readings of one true current, whole counts."""
        sensed_a = current_a * self._gain + self._zero_a + self.extra_offset_a
        seen_a = UNPLUGGED_A if self.is_unplugged else sensed_a
        counts = self._noise.draw(n) * ADC_NOISE_COUNTS
        mean_count = seen_a / AMPERES_PER_COUNT + ZERO_COUNT
        counts += mean_count
        np.rint(counts, out=counts)
        if not _NOISE_COUNTS < mean_count < ADC_MAX - _NOISE_COUNTS:
            np.minimum(counts, ADC_MAX, out=counts)
            np.maximum(counts, 0, out=counts)
        return counts


class CellInputs:
    """The voltages at the slaves' cell inputs: fixed error of each channel, noise, and wiring faults."""

    def __init__(self, n_cells: int, rng: np.random.Generator, noise: NoisePool) -> None:
        self._noise = noise
        self._n_cells = n_cells
        fixed_v = np.clip(rng.normal(0, CELL_ERROR_STD_V, n_cells), -CELL_ERROR_LIMIT_V, CELL_ERROR_LIMIT_V)
        self._errors_v = fixed_v + CELL_NOISE_V * rng.standard_normal((_NOISE_ROWS, n_cells))
        self._row = 0
        self.extra_noise_v: FloatArray = np.zeros(n_cells)
        self.stuck_v: FloatArray = np.full(n_cells, np.nan)
        self.temperature_stuck_degc: FloatArray = np.full(n_cells, np.nan)
        self.temperature_unplugged: NDArray[np.bool_] = np.zeros(n_cells, dtype=bool)
        self._is_disturbed = False

    def faults_changed(self) -> None:
        """Note that a fault array was written; without faults `read` is quicker."""
        self._is_disturbed = bool(self.extra_noise_v.any() or np.isfinite(self.stuck_v).any())

    def read(self, true_v: FloatArray) -> FloatArray:
        """Return (n_cells,) what stands at the inputs [V]."""
        self._row = (self._row + 1) % len(self._errors_v)
        seen_v: FloatArray = self._errors_v[self._row] + true_v
        if self._is_disturbed:
            seen_v += self.extra_noise_v * self._noise.draw(self._n_cells)
            seen_v = np.where(np.isfinite(self.stuck_v), self.stuck_v, seen_v)
        return seen_v

    def read_temperature(self, true_degc: FloatArray) -> FloatArray:
        """Return (n_cells,) temperatures that the sensors stand at [degC], before their curve."""
        return np.where(np.isfinite(self.temperature_stuck_degc), self.temperature_stuck_degc, true_degc)
