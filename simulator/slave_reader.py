"""The master's side of the slaves: wake, convert, wait, read, check, keep; temperatures in two phases; open wires.

A packet with a wrong check word keeps the old registers. A slave without one good packet in a pass counts as silent.
Everything takes its time on the bus: `busy_until_s` says when the last thing asked for is over.
"""

import functools
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.ltc6804 import (
    AdcMode,
    Command,
    Configuration,
    adax,
    adcv,
    adstat,
    command_packet,
    decode_command,
    write_packet,
)
from firmware_protocol.memory_map import CELLS_PER_PACK, CHIP_MISSING, T_MISSING
from firmware_protocol.temperature_sensor import FIRST_DEGC, MARGIN_V, POINTS_V, STEP_DEGC
from simulator.conversion import ADOW, decode_conversion
from simulator.converters import BoolArray
from simulator.isospi import DATA_WORDS, Answers, WordArray
from simulator.memory import MasterMemory
from simulator.self_test import AXST, CVST, PATTERNS, STATST, SelfTest
from simulator.slave import SlaveChain
from simulator.slave_setup import (
    CELLS_MODE,
    CELLS_WAIT_S,
    DEFAULT_CFGR,
    FIRST_ADDRESS,
    QUIET_S,
    SENSORS_MODE,
    SENSORS_WAIT_S,
    SWITCH_WAIT_S,
    WAKE_WAIT_S,
)

STATUS_ABSENT, STATUS_ACTIVE, STATUS_FAULT = 0, 1, 255
_CONVERT = command_packet(adcv(CELLS_MODE))
_CONVERT_SENSORS = command_packet(adcv(SENSORS_MODE, discharge_permitted=True))
# what ADCOPT makes of the fastest mode leaves room for a stage of the self-check in a pass
_CHECK_MODE = AdcMode.FAST
_CONVERT_PULLED_UP = command_packet(ADOW | _CHECK_MODE << 7 | 0x40)
_CONVERT_PULLED_DOWN = command_packet(ADOW | _CHECK_MODE << 7)
_CONVERT_AUX = command_packet(adax(_CHECK_MODE))
_CONVERT_STATUS = command_packet(adstat(_CHECK_MODE))
_TEST_MULTIPLEXER = command_packet(Command.DIAGN)
_SELF_TESTS = tuple(
    tuple(SelfTest(kind, _CHECK_MODE, pattern) for kind in (CVST, AXST, STATST)) for pattern in PATTERNS
)
_TEST_PACKETS = tuple(tuple(command_packet(test.command) for test in tests) for tests in _SELF_TESTS)
_WAIT_S = {_CONVERT: CELLS_WAIT_S, _CONVERT_SENSORS: SENSORS_WAIT_S} | {
    packet: conversion.time_s(adc_option=True)
    for packet in (
        *(_CONVERT_PULLED_UP, _CONVERT_PULLED_DOWN, _CONVERT_AUX, _CONVERT_STATUS, _TEST_MULTIPLEXER),
        *(packet for packets in _TEST_PACKETS for packet in packets),
    )
    if (conversion := decode_conversion(decode_command(packet)[0])) is not None
}
_CLEAR_CELLS = command_packet(Command.CLRCELL)
_POLL = command_packet(Command.PLADC)
_BUSY = b"\x00"
_TRIES = 3
_WATCHFUL_S = 60.0  # after a damaged packet
_SWITCHES = 4  # of the configuration, from this byte on
_BYTE_S = 8e-6  # at 1 MHz
_COMMAND_S, _GROUP_S = 4 * _BYTE_S, 12 * _BYTE_S
CHECK_STAGES = 4  # of the self-check: a pattern each, references and multiplexer, wires
CHECK_STAGE_S = 10e-3  # the longest of them
_CELLS_FAILED, _AUXILIARY_FAILED, _STATUS_FAILED, _MULTIPLEXER_FAILED, _REFERENCE_FAILED = np.array(
    (1, 2, 4, 8, 16), dtype=np.uint16
)
_REFERENCE_COUNTS = (29850, 30150)  # the second reference of a sound chip, 2.985 to 3.015 V
_MULTIPLEXER_FLAG = 0x0200  # in the last status word
_NO_CELLS = np.zeros(CELLS_PER_PACK, dtype=bool)
_OPEN_WIRE_COUNTS = 4000  # the data sheet's 400 mV
_U16 = 0xFFFF
_PHASES = tuple(np.arange(CELLS_PER_PACK) % 2 == phase for phase in range(2))
_SENSOR_RISING_V = np.array(POINTS_V[::-1])
_ROUNDING_V = 1e-9
_SENSOR_DEGC = FIRST_DEGC + STEP_DEGC * np.arange(len(POINTS_V) - 1, -1, -1, dtype=np.float64)
_READ_US = round(_GROUP_S * 1e6)
_CELLS_US, _SENSORS_US, _AUX_US, _STATUS_US = (
    round(_WAIT_S[packet] * 1e6) for packet in (_CONVERT, _CONVERT_SENSORS, _CONVERT_AUX, _CONVERT_STATUS)
)
# time of each step of one reading [us]: conversion, four cell groups, aux, status, then the two temperature phases
_STEP_TIMES_US = (
    *(_CELLS_US, *[_READ_US] * 4, _AUX_US, *[_READ_US] * 2, _STATUS_US, *[_READ_US] * 2),
    *(_SENSORS_US, *[_READ_US] * 4, _SENSORS_US, 4 * _READ_US),
)


def degc_from_sensor(volts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the temperatures of sensor voltages [degC]; NaN where no working sensor gives that voltage."""
    margin_v = MARGIN_V + _ROUNDING_V
    inside = (volts >= _SENSOR_RISING_V[0] - margin_v) & (volts <= _SENSOR_RISING_V[-1] + margin_v)
    return np.where(inside, np.interp(volts, _SENSOR_RISING_V, _SENSOR_DEGC), np.nan)


def _whole_degc_by_count() -> NDArray[np.int8]:
    degc = degc_from_sensor(np.arange(_U16 + 1, dtype=np.float64) * 1e-4)
    known = np.isfinite(degc)
    exact = np.round(np.where(known, degc, 0), 9)  # half a degree is half a degree
    return np.where(known, np.rint(exact), T_MISSING).astype(np.int8)


_DEGC_BY_COUNT = _whole_degc_by_count()


class SlaveReader:
    """Reads all slaves into the struct and drives their balancing outputs."""

    def __init__(self, memory: MasterMemory, chain: SlaveChain) -> None:
        self._memory = memory
        self._chain = chain
        n_cells = chain.n_slaves * CELLS_PER_PACK
        self._balance: BoolArray = np.zeros(n_cells, dtype=bool)
        self._is_balancing = False
        # of the two phases, where the temperature of each cell stands
        self._phase_columns = np.array([at + CELLS_PER_PACK * (at % 2) for at in chain.sensor_inputs])
        self._sensor_inputs = np.array(chain.sensor_inputs)
        self.packets = 0
        self.packet_errors = 0
        self._bad_packets: NDArray[np.int64] = np.zeros(chain.n_slaves, dtype=np.int64)
        self._bad_a_second_ago = self._bad_packets.copy()
        self._none_silent: BoolArray = np.zeros(chain.n_slaves, dtype=bool)
        self.silent = self._none_silent
        self.has_returned = False  # a slave answers again: it is configured anew, its reference is not up yet
        self.is_whole = False  # every voltage of the last pass arrived intact
        self.has_doubts = False  # some voltages arrive intact and still are not to be believed
        self.open_wire_cells: BoolArray = np.zeros(n_cells, dtype=bool)
        self.failed_self_test: BoolArray = np.zeros(chain.n_slaves, dtype=bool)
        self._phase = 0
        self._stage = 0
        self._is_noisy = False  # packets arrived damaged lately: commands may have as well
        self._quiet_from_s = 0.0
        self._failures: NDArray[np.uint16] = np.zeros(chain.n_slaves, dtype=np.uint16)  # of the check under way
        self.busy_until_s = 0.0
        memory.slave_cvr[:] = memory.slave_temp[:] = CHIP_MISSING
        memory.slave_status[:] = STATUS_ABSENT
        memory.slave_time[:] = _STEP_TIMES_US

    def start(self, now_s: float) -> None:
        """Forget what the chips measured, configure them, and say in the struct which hold what was written."""
        self.begin(now_s)
        self.busy_until_s += _COMMAND_S
        self._chain.execute(_CLEAR_CELLS, self.busy_until_s)
        self._write(_NO_CELLS, None)
        groups, whole = self._configurations()
        is_set = whole & (groups[:, 1:] == np.frombuffer(DEFAULT_CFGR, dtype=np.uint8)[1:]).all(axis=1)
        self._memory.slave_cfgr[whole] = groups[whole]
        self._memory.slave_status[:] = np.where(is_set, STATUS_ACTIVE, STATUS_FAULT)

    def begin(self, now_s: float) -> None:
        """Wake the chips and wait until they are ready."""
        self.busy_until_s = max(self._chain.wake(now_s), now_s + WAKE_WAIT_S)

    def configure(self, balance: BoolArray) -> None:
        """Write the chips' configuration with the cells to bleed, and read it back."""
        self._balance = balance.copy()
        self._is_balancing = bool(balance.any())
        self._write_balance()
        self._read_configuration()

    def read_voltages(self) -> BoolArray:
        """Convert and read all cells into the struct; return (n_slaves,) which slaves gave no good packet."""
        errors_before, silent_before = self.packet_errors, self.silent
        self._convert(_CONVERT)
        self._read_cells_into(self._memory.slave_cvr)
        self.is_whole = self.packet_errors == errors_before
        self.has_returned = silent_before is not self.silent and bool((silent_before & ~self.silent).any())
        if self.has_returned:
            self._write_balance()
        return self.silent

    def read_temperatures(self) -> None:
        """Read one phase: every other cell's sensor, switched in by its balancing output."""
        selected = _PHASES[self._phase]
        for _ in range(_TRIES):
            self._write(selected, None)
            if not self._is_noisy or self._has_arrived(selected):
                break
        self.busy_until_s += SWITCH_WAIT_S
        self._convert(_CONVERT_SENSORS)
        half = self._memory.slave_temp[:, self._phase * CELLS_PER_PACK : (self._phase + 1) * CELLS_PER_PACK]
        self._read_cells_into(half)
        self._write_balance()
        self._phase = 1 - self._phase

    def temperatures_degc(self) -> NDArray[np.int8]:
        """Return (n_cells,) temperatures out of both phases [degC], T_MISSING without a measurement.

        An input beside an open wire floats between its sensor and the cell next to it: what it gives is no temperature.
        """
        counts = self._memory.slave_temp.take(self._phase_columns, axis=1)
        if self.has_doubts:
            beside = self.open_wire_cells.reshape(-1, CELLS_PER_PACK).take(self._sensor_inputs, axis=1)
            counts[beside] = CHIP_MISSING
        if self.silent is not self._none_silent:
            counts[self.silent] = CHIP_MISSING
        return _DEGC_BY_COUNT.take(counts.reshape(-1))

    def self_check(self) -> bool:
        """Run the next stage of the check; return whether that was the last, and its result is in the struct."""
        stage, self._stage = self._stage, (self._stage + 1) % CHECK_STAGES
        if stage < len(_SELF_TESTS):
            self._failures |= self._test_converters(stage)
        elif stage == len(_SELF_TESTS):
            self._test_references()
        else:
            self._find_open_wires()
            self._conclude()
        return self._stage == 0

    def _conclude(self) -> None:
        self._memory.slave_com[:, 2] = self._failures
        self.failed_self_test[:] = self._failures != 0
        self._failures[:] = 0
        self._memory.slave_com[:, 1] = np.minimum(self._bad_packets - self._bad_a_second_ago, _U16)
        self._bad_a_second_ago[:] = self._bad_packets
        self.has_doubts = bool(self.open_wire_cells.any() or self.failed_self_test.any())

    def _test_references(self) -> None:
        """Convert references and supplies into the struct, and test the multiplexer."""
        for packet in (_CONVERT_AUX, _CONVERT_STATUS, _TEST_MULTIPLEXER):
            self._convert(packet)
        words, whole = self._read_auxiliary()
        n_aux = self._memory.slave_avr.shape[1]
        self._memory.slave_avr[whole] = words[whole, :n_aux]
        self._memory.slave_str[whole] = words[whole, -self._memory.slave_str.shape[1] :]
        self._failures |= _MULTIPLEXER_FAILED * ((words[:, -1] & _MULTIPLEXER_FLAG != 0) & whole)
        lowest, highest = _REFERENCE_COUNTS
        second_reference = words[:, 5]
        is_off = (second_reference < lowest) | (second_reference > highest)
        self._failures |= _REFERENCE_FAILED * (is_off & whole)

    def _test_converters(self, index: int) -> WordArray:
        """Return (n_slaves,) which self-tests failed, as bits; a packet that is damaged proves nothing."""
        for packet in _TEST_PACKETS[index]:
            self._convert(packet)
        code = _SELF_TESTS[index][0].code(adc_option=True)
        cells = self._read_cells()
        wrong = np.logical_and.reduce(cells.intact, axis=1)
        wrong &= np.logical_or.reduce(cells.words.reshape(len(wrong), -1) != code, axis=1)
        failures: WordArray = _CELLS_FAILED * wrong
        words, whole = self._read_auxiliary()
        failures |= _AUXILIARY_FAILED * (np.logical_or.reduce(words[:, :6] != code, axis=1) & whole)
        failures |= _STATUS_FAILED * (np.logical_or.reduce(words[:, 6:10] != code, axis=1) & whole)
        return failures

    def _find_open_wires(self) -> None:
        """Mark the cells on both sides of each open wire: pulled up minus pulled down is far below zero above it."""
        shape = (self._chain.n_slaves, CELLS_PER_PACK)
        up = np.zeros(shape, dtype="<u2")
        down = np.zeros(shape, dtype="<u2")
        self._convert(_CONVERT_PULLED_UP)
        intact = self._read_cells_into(up)
        self._convert(_CONVERT_PULLED_DOWN)
        intact = intact & self._read_cells_into(down)
        difference = up.astype(np.int32) - down
        is_open = np.zeros(shape, dtype=bool)
        lower = difference[:, 1:] < -_OPEN_WIRE_COUNTS
        is_open[:, :-1] |= lower
        is_open[:, 1:] |= lower
        is_open[:, -1] |= (down[:, -1] == 0) & (up[:, -1] != 0)
        whole = intact.all(axis=1)
        self.open_wire_cells.reshape(shape)[whole] = is_open[whole]

    def _convert(self, packet: bytes) -> None:
        """Start a conversion and wait until it is over; on a noisy pair ask whether it has begun, if not once more."""
        for _ in range(_TRIES):
            self.busy_until_s += _COMMAND_S
            self._chain.execute(packet, self.busy_until_s)
            if not self._is_noisy:
                break
            self.busy_until_s += _COMMAND_S + _BYTE_S
            if self._chain.execute(_POLL, self.busy_until_s) == _BUSY:
                break
        self.busy_until_s += _WAIT_S[packet]
        if _WAIT_S[packet] > QUIET_S:
            self.busy_until_s = self._chain.wake(self.busy_until_s)

    def _read_cells(self) -> Answers:
        return self._received(self._chain.read_cells(self.busy_until_s + _COMMAND_S))

    def _read_auxiliary(self) -> tuple[WordArray, BoolArray]:
        """Return (n_slaves, 12) auxiliary and status words, and which slaves' packets are all intact."""
        answers = self._received(self._chain.read_auxiliary(self.busy_until_s + _COMMAND_S))
        whole: BoolArray = np.logical_and.reduce(answers.intact, axis=1)
        return answers.words.reshape(self._chain.n_slaves, -1), whole

    def _read_cells_into(self, target: NDArray[np.uint16]) -> BoolArray:
        answers = self._read_cells()
        words = answers.words.reshape(target.shape)
        if answers.is_whole:
            target[:] = words
            self.silent = self._none_silent
        else:
            np.copyto(target, words, where=np.repeat(answers.intact, DATA_WORDS, axis=1))
            self.silent = np.logical_not(answers.intact.any(axis=1))
        return answers.intact

    def _received(self, answers: Answers) -> Answers:
        """Count packets, and those that are not intact into the struct as well."""
        n = answers.intact.size
        self.busy_until_s += _GROUP_S * n
        self.packets += n
        if answers.is_whole:
            self._is_noisy = self._is_noisy and self.busy_until_s < self._quiet_from_s
        else:
            self._is_noisy, self._quiet_from_s = True, self.busy_until_s + _WATCHFUL_S
            self.packet_errors += n - int(np.count_nonzero(answers.intact))
            self._bad_packets += np.count_nonzero(~answers.intact, axis=1)
            self._memory.slave_com[:, 0] = np.minimum(self._bad_packets, _U16)
        return answers

    def _write(self, discharging: BoolArray, address: int | None) -> None:
        self.busy_until_s += _GROUP_S
        packet = _configuration_packet(discharging.tobytes(), address)
        self._chain.execute(packet, self.busy_until_s)

    def _write_balance(self) -> None:
        if not self._is_balancing:
            self._write(_NO_CELLS, None)
            return
        for slave, row in enumerate(self._balance.reshape(self._chain.n_slaves, CELLS_PER_PACK)):
            self._write(row, FIRST_ADDRESS + slave)

    def _read_configuration(self) -> None:
        groups, whole = self._configurations()
        self._memory.slave_cfgr[whole] = groups[whole]

    def _configurations(self) -> tuple[NDArray[np.uint8], BoolArray]:
        """Return (n_slaves, 6) what the chips hold, and which of it arrived intact."""
        answers = self._received(self._chain.read_configuration(self.busy_until_s + _COMMAND_S))
        return answers.words[:, 0].copy().view(np.uint8), answers.intact[:, 0]

    def _has_arrived(self, discharging: BoolArray) -> bool:
        """Return whether the chips that can be read back hold these switches, and there are such."""
        groups, whole = self._configurations()
        bits = np.unpackbits(groups[whole, _SWITCHES:], axis=1, bitorder="little")[:, :CELLS_PER_PACK]
        return bool(whole.any() and (bits == discharging).all())


@functools.lru_cache(maxsize=1024)
def _configuration_packet(discharging: bytes, address: int | None) -> bytes:
    cells = tuple(map(bool, discharging))
    configuration = replace(Configuration.from_bytes(DEFAULT_CFGR), discharging=cells)
    return write_packet(Command.WRCFG, configuration.to_bytes(), address)
