"""One pass of measuring: slaves and converter into the struct, filtered, with minima, maxima, means and totals."""

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.memory_map import CELLS_PER_PACK, CHIP_MISSING, N_CELLS, T_MISSING, V_MISSING
from simulator.board import Board
from simulator.converters import BoolArray
from simulator.memory import Config, MasterMemory
from simulator.protection import Reading
from simulator.sensors import ADC_MAX, UNPLUGGED_COUNT, UNPLUGGED_WIDTH
from simulator.slave_reader import CHECK_STAGE_S, CHECK_STAGES, STATUS_ACTIVE, STATUS_FAULT, SlaveReader

READY_S = 0.5  # both temperature phases read, the voltage filter settled
TEMPERATURE_PERIOD_S = 0.2  # of one phase
SELF_CHECK_PERIOD_S = 1.0  # of all its stages
HIGH_PRECISION_TIME_S = 1.0
SAMPLE_S = 0.001
_U16 = 0xFFFF
_NO_TEMPERATURES = (127, 0, -128, 0)  # coldest above, hottest below every limit
_MAX_SAMPLES = 1000  # the longest average that the configuration allows


class CurrentMeans:
    """The converter's buffer: `ts` samples fill it, their mean is taken, and the next one fills meanwhile."""

    def __init__(self) -> None:
        self._sum = 0.0
        self._n = 0
        self._means: list[float] = []  # the newest, enough for the longest average

    def take(self, config: Config, counts: NDArray[np.float64]) -> list[float]:
        """Take samples; return the means of the buffers that they filled, oldest first."""
        found, at = [], 0
        while at < len(counts):
            part = counts[at : at + max(config.ts - self._n, 1)]  # a `ts` made shorter ends the buffer
            at += len(part)
            self._sum += float(np.add.reduce(part))
            self._n += len(part)
            if self._n >= config.ts:
                found.append(self._sum / self._n)
                self._sum, self._n = 0.0, 0
        if found:
            self._means = [*self._means, *found][-_MAX_SAMPLES:]
        return found

    def over(self, n_samples: int, ts: int) -> float:
        """Return the mean of the newest buffers that hold so many samples, at least of one."""
        newest = self._means[-max(-(-n_samples // ts), 1) :]
        return sum(newest) / len(newest)


class MeasuringTask:
    """Fills the measured fields of the struct."""

    def __init__(self, memory: MasterMemory, board: Board, now_s: float) -> None:
        self._memory = memory
        self._board = board
        self.reader = SlaveReader(memory, board.chain)
        self.reader.start(now_s)
        self._start_s = now_s
        self._temperature_due_s = now_s
        self._self_check_due_s = now_s
        self._current = CurrentMeans()
        self._i_fc = 0
        self._i_fc_hp = 0.0
        self.new_means: list[int] = []  # of the current, that this pass has completed [10 mA]
        self._filtered = np.zeros(N_CELLS)
        self._raw = np.empty(N_CELLS)
        self._raw_by_slave = self._raw.reshape(memory.slave_cvr.shape)
        self._rounded = np.empty(N_CELLS)
        self._alpha = np.empty(N_CELLS)
        self._alpha_raw: int | None = None  # of which `_alpha` is full
        self._known: BoolArray = np.zeros(N_CELLS, dtype=bool)
        self._all_known = False
        self._voltages = (_U16, 0, 0, 0)
        self._temperatures = _NO_TEMPERATURES
        self._lost_temperature: int | None = None
        self.v_avg = 0
        self.is_ready = False

    def run(self, config: Config, now_s: float, dt_s: float, true_current_a: float, is_charging: bool) -> Reading:
        """Measure everything that is due and return what the protection judges."""
        self.reader.begin(now_s)
        silent = self.reader.read_voltages()
        if now_s >= self._temperature_due_s and not self.reader.has_returned:
            self._temperature_due_s = now_s + TEMPERATURE_PERIOD_S
            self._read_temperatures()
        self._check(config, now_s, now_s + dt_s)
        i_fc, lost_current = self._measure_current(config, dt_s, true_current_a)
        lost_cell = self._filter_voltages(config, silent)
        self.is_ready = self.is_ready or now_s - self._start_s >= READY_S
        return Reading(
            *self._voltages,
            *self._temperatures,
            i_fc=i_fc,
            is_charging=is_charging,
            lost_cell=lost_cell,
            lost_temperature=self._lost_temperature,
            lost_slave=None if self.reader.is_whole or not silent.any() else int(silent.argmax()),
            lost_current=lost_current,
        )

    def _check(self, config: Config, now_s: float, end_s: float) -> None:
        """Run the stages of the self-check that are due, as far as the pass has time for them."""
        if self.reader.has_returned:
            return
        while now_s >= self._self_check_due_s and self.reader.busy_until_s + CHECK_STAGE_S <= end_s:
            self._self_check_due_s += SELF_CHECK_PERIOD_S / CHECK_STAGES
            if self.reader.self_check():
                self._fill_slow_fields(config)

    def _measure_current(self, config: Config, dt_s: float, true_current_a: float) -> tuple[int, bool]:
        """Take the samples of a pass; return `i_fc` as it stands, and whether the sensor is lost."""
        counts = samples_of_pass(self._board, dt_s, true_current_a)
        means = self._current.take(config, counts)
        self.new_means = [_amperes_raw(config, mean) for mean in means]
        if means:
            self._i_fc = _amperes_raw(config, self._current.over(config.fc_avg, config.ts))
            share = min(len(means) * config.ts * SAMPLE_S / HIGH_PRECISION_TIME_S, 1.0)
            self._i_fc_hp += (self._i_fc - self._i_fc_hp) * share
            self._memory.set_currents(self.new_means[-1], self._i_fc, round(self._i_fc_hp))
        # an open input stands still there; a current does not for as long as it takes to trip
        latest = int(counts[-1])
        is_open = abs(latest - UNPLUGGED_COUNT) <= UNPLUGGED_WIDTH
        return self._i_fc, is_open or latest in (0, ADC_MAX)

    def _filter_voltages(self, config: Config, silent: BoolArray) -> int | None:
        """Filter and summarise; return the first cell without a voltage although its slave answers."""
        memory, filtered, raw = self._memory, self._filtered, self._raw
        self._raw_by_slave[:] = memory.slave_cvr
        lost = self._find_known(raw, silent)
        if config.v_alpha != self._alpha_raw:
            self._alpha_raw = config.v_alpha
            self._alpha[:] = config.v_alpha * 1e-3
        # v' = v + alpha (sample - v)
        np.subtract(raw, filtered, raw)
        np.multiply(raw, self._alpha, raw)
        np.add(filtered, raw, filtered)
        rounded = np.rint(filtered, self._rounded)
        n_known, lowest = N_CELLS, rounded
        if not self._all_known:
            n_known = int(np.count_nonzero(self._known))
            lowest = np.where(self._known, rounded, CHIP_MISSING)
            rounded = np.where(self._known, rounded, V_MISSING)
        memory.v[:] = rounded
        total = float(np.add.reduce(rounded))
        min_id, max_id = int(lowest.argmin()), int(rounded.argmax())
        self.v_avg = round(total / n_known) if n_known else V_MISSING
        self._voltages = (int(lowest[min_id]), min_id, int(rounded[max_id]), max_id)
        v_min = self._voltages[0] if n_known else V_MISSING
        memory.set_voltage_summary(v_min, self._voltages[2], self.v_avg, min_id, max_id, min(round(total / 100), _U16))
        return lost

    def _find_known(self, raw: NDArray[np.float64], silent: BoolArray) -> int | None:
        """Update which cells have a voltage, and what the struct says of the slaves."""
        is_undisturbed = self.reader.is_whole and not self.reader.has_doubts and raw[raw.argmax()] != CHIP_MISSING
        if is_undisturbed and self._all_known:
            return None
        answered = np.repeat(~silent, CELLS_PER_PACK)
        tested = np.repeat(~self.reader.failed_self_test, CELLS_PER_PACK)
        known = answered & tested & ~self.reader.open_wire_cells & (raw != CHIP_MISSING)
        fresh = known & ~self._known
        self._filtered[fresh] = raw[fresh]
        self._known, self._all_known = known, bool(known.all())
        self._memory.slave_status[:] = np.where(silent | self.reader.failed_self_test, STATUS_FAULT, STATUS_ACTIVE)
        self._memory.set_slave_count(int(np.count_nonzero(~silent)))
        missing = answered & ~known
        return int(missing.argmax()) if missing.any() else None

    def _read_temperatures(self) -> None:
        """Read one phase of sensors; summarise the whole degrees of the cells that have one."""
        self.reader.read_temperatures()
        whole = self.reader.temperatures_degc()
        self._memory.t[:] = whole
        ids = np.flatnonzero(whole != T_MISSING)
        if not len(ids):
            self._temperatures = _NO_TEMPERATURES
            self._memory.set_temperature_summary(T_MISSING, T_MISSING, T_MISSING, 0, 0)
        else:
            degc = whole[ids]
            min_id, max_id = int(ids[degc.argmin()]), int(ids[degc.argmax()])
            self._temperatures = (int(whole[min_id]), min_id, int(whole[max_id]), max_id)
            mean = round(float(np.add.reduce(degc, dtype=np.float64)) / len(ids))
            self._memory.set_temperature_summary(int(whole[min_id]), int(whole[max_id]), mean, min_id, max_id)
        if len(ids) == N_CELLS:
            self._lost_temperature = None
        else:
            missing = (whole == T_MISSING) & np.repeat(~self.reader.silent, CELLS_PER_PACK)
            self._lost_temperature = int(missing.argmax()) if missing.any() else None

    def _fill_slow_fields(self, config: Config) -> None:
        """Write what this firmware takes from its configuration: capacities, resistances, and the OCV they imply."""
        memory = self._memory
        memory.c[:] = config.c_avg
        memory.set_capacity_summary(config.c_avg)
        memory.r_fs[:] = config.r_fs_avg
        memory.r_fc[:] = config.r_fc_avg
        # v + R i in 100 uV: 10 uohm times 10 mA is 0.1 uV
        ocv = self._filtered + config.r_fs_avg * self._i_fc_hp * 1e-3
        memory.ocv[:] = np.where(self._known, np.clip(np.rint(ocv), 0, _U16), V_MISSING)


def samples_of_pass(board: Board, dt_s: float, true_current_a: float) -> NDArray[np.float64]:
    """Return what the current's converter gives in a pass, whole counts."""
    n = max(round(dt_s / SAMPLE_S), 1)
    counts = board.current_sensor.sample(true_current_a, min(n, _MAX_SAMPLES))
    # a simulation in long passes: the same samples again, so that no charge is lost
    return counts if n <= _MAX_SAMPLES else np.resize(counts, n)


def _amperes_raw(config: Config, mean_count: float) -> int:
    return round((10 * mean_count - config.i_offset) * config.i_gain / 5000)
