"""Eight LTC6804-2 as register machines on one isoSPI: what they answer to packets, and what their switches do.

Cell inputs and sensors are given as volts; conversions happen at once. A chip without power, or noise on the pair,
shows as packets whose check word is wrong.
"""

import functools

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.errors import DecodeError
from firmware_protocol.ltc6804 import (
    DISCHARGE_MINUTES,
    READ_CELLS,
    Command,
    Configuration,
    decode_command,
    decode_group,
    with_pec,
)
from firmware_protocol.memory_map import CELLS_PER_PACK, CHIP_MISSING
from simulator.isospi import DATA_WORDS, PACKET_WORDS, WordArray, to_packets
from simulator.self_test import AXST, CVST, SelfTest, decode_self_test

ByteArray = NDArray[np.uint8]
FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

WATCHDOG_S = 2.0
ADCV = 0x260
ADOW = 0x228
ADAX = 0x460
ADSTAT = 0x468
_MODE_BITS = 0x180
_CHANNEL_BITS = 0x007
_PULL_UP = 0x040
_DISCHARGE_PERMITTED = 0x010
_ADC_OPTION, _TIMER_PIN = 0x01, 0x02  # in CFGR0
_SWITCHES = 4  # CFGR from here on: the switches and their timer
_MULTIPLEXER_FAILED = 0x0200  # in the last status word
_SUPPLY_WORDS = 4  # status words that a conversion fills
CELL_INPUT_MAX_V = 5.75  # the converter's end
REFERENCE_V = 3.0
SUPPLY_V = 5.0
DIGITAL_V = 3.2
_RESET_CFGR = np.frombuffer(Configuration(reference_on=False).to_bytes(), dtype=np.uint8)
_READ_WORDS = {command: (0, 3 * i) for i, command in enumerate(READ_CELLS)} | {
    Command.RDAUXA: (1, 0),
    Command.RDAUXB: (1, 3),
    Command.RDSTATA: (2, 0),
    Command.RDSTATB: (2, 3),
}


@functools.lru_cache(maxsize=256)
def _decoded(packet: bytes) -> tuple[int, int | None]:
    return decode_command(packet)


@functools.lru_cache(maxsize=256)
def _decoded_configuration(body: bytes) -> ByteArray | None:
    try:
        return np.frombuffer(decode_group(body), dtype=np.uint8)
    except DecodeError:
        return None


class SlaveChain:
    """All slaves; arrays have one row each, cells are numbered through."""

    def __init__(self, n_slaves: int, rng: np.random.Generator) -> None:
        self._rng = rng
        self.n_slaves = n_slaves
        n_cells = n_slaves * CELLS_PER_PACK
        self.cell_v: FloatArray = np.zeros(n_cells)
        self.sensor_v: FloatArray = np.zeros(n_cells)
        self.board_degc = 25.0
        self.is_powered: BoolArray = np.ones(n_slaves, dtype=bool)
        self._all_powered = True
        self.bit_error_rate = 0.0
        self.open_wires: set[int] = set()  # cell whose upper wire is off
        self.stuck_bits: NDArray[np.uint16] = np.zeros(n_slaves, dtype=np.uint16)  # of each slave's converter
        self._has_stuck_bits = False
        self.multiplexer_failed: BoolArray = np.zeros(n_slaves, dtype=bool)
        self.cfgr: ByteArray = np.tile(_RESET_CFGR, (n_slaves, 1))
        self.cvr: NDArray[np.uint16] = np.full((n_slaves, CELLS_PER_PACK), CHIP_MISSING, dtype="<u2")
        self.avr: NDArray[np.uint16] = np.full((n_slaves, 6), CHIP_MISSING, dtype="<u2")
        self.str: NDArray[np.uint16] = np.full((n_slaves, 6), CHIP_MISSING, dtype="<u2")
        self.discharging: BoolArray = np.zeros(n_cells, dtype=bool)
        self.is_discharging = False
        self.has_timer_pin = False  # SWTEN: without it the discharge timer does not run
        self._timer_end_s: FloatArray = np.zeros(n_slaves)
        self._last_command_s = 0.0

    def set_powered(self, slave: int, powered: bool) -> None:
        """Take a slave's power, or give it back: it wakes with its registers reset."""
        if powered and not self.is_powered[slave]:
            self.cvr[slave] = self.avr[slave] = self.str[slave] = CHIP_MISSING
            self.cfgr[slave] = _RESET_CFGR
        self.is_powered[slave] = powered
        self._all_powered = bool(self.is_powered.all())
        self._update_switches()

    def stick(self, slave: int, bits: int) -> None:
        """Let these bits of a slave's converter always be set; 0 for a sound one."""
        self.stuck_bits[slave] = bits
        self._has_stuck_bits = bool(self.stuck_bits.any())

    def watch(self, now_s: float) -> None:
        """Reset the configuration of chips that heard nothing for two seconds, and end what the timer ends.

        The switches are reset with the rest, unless the discharge timer of the chip is running.
        """
        if not self.is_discharging:
            return
        runs = self._timer_end_s > now_s
        if now_s - self._last_command_s > WATCHDOG_S:
            self.cfgr[:, :_SWITCHES] = _RESET_CFGR[:_SWITCHES]
            self.cfgr[~runs, _SWITCHES:] = _RESET_CFGR[_SWITCHES:]
            self._update_switches()
        elif self.has_timer_pin:
            over = ~runs & (self.cfgr[:, 5] > 0x0F)
            self.cfgr[over, _SWITCHES:] = _RESET_CFGR[_SWITCHES:]
            self._update_switches()

    def execute(self, packet: bytes, now_s: float) -> bytes:
        """Take one packet and return what comes back: 8 bytes from an addressed read, else nothing."""
        try:
            command, address = _decoded(packet[:4])
        except DecodeError:
            return b""
        self._last_command_s = now_s
        slaves = slice(None) if address is None else slice(address, address + 1)
        if command == Command.WRCFG:
            self._write_configuration(slaves, packet[4:], now_s)
        elif command in _READ_WORDS or command == Command.RDCFG:
            return self._answer(command, address, now_s)
        elif command == Command.CLRCELL:
            self.cvr[slaves] = CHIP_MISSING
        elif command == Command.CLRAUX:
            self.avr[slaves] = CHIP_MISSING
        elif command == Command.CLRSTAT:
            self.str[slaves] = CHIP_MISSING
        elif command == Command.DIAGN:
            self.str[self.is_powered & self.multiplexer_failed, -1] |= _MULTIPLEXER_FAILED
        elif (self_test := decode_self_test(command)) is not None:
            self._test_itself(self_test)
        else:
            self._convert(command)
        return b""

    def read_cells(self) -> WordArray:
        """Return the answers of all slaves to the four cell reads, (n_slaves, 4, 4), as they arrive."""
        return self._answers(self.cvr)

    def read_auxiliary(self) -> WordArray:
        """Return the answers of all slaves to both auxiliary and both status reads, (n_slaves, 4, 4)."""
        return self._answers(np.concatenate((self.avr, self.str), axis=1))

    def read_configuration(self) -> WordArray:
        """Return the answers of all slaves to the configuration read, (n_slaves, 1, 4), timers as they were set."""
        return self._answers(self.cfgr.view("<u2"))

    def _answers(self, registers: WordArray) -> WordArray:
        packets = to_packets(registers.reshape(self.n_slaves, -1, DATA_WORDS))
        if not self._all_powered:
            packets[~self.is_powered] = 0xFFFF
        return self._disturbed(packets)

    def _answer(self, command: int, address: int | None, now_s: float) -> bytes:
        if address is None or address >= self.n_slaves or not self.is_powered[address]:
            return b"\xff" * 2 * PACKET_WORDS
        if command == Command.RDCFG:
            group = self._configuration_read(address, now_s)
        else:
            kind, start = _READ_WORDS[Command(command)]
            words = (self.cvr, self.avr, self.str)[kind][address]
            group = words[start : start + 3].tobytes()
        return self._disturbed(np.frombuffer(with_pec(group), dtype="<u2").copy()).tobytes()

    def _configuration_read(self, address: int, now_s: float) -> bytes:
        """Return CFGR as a chip gives it: the timer's code is that of the time left."""
        group = self.cfgr[address].copy()
        left_minutes = (self._timer_end_s[address] - now_s) / 60
        code = np.searchsorted(DISCHARGE_MINUTES, left_minutes) if left_minutes > 0 else 0
        group[5] = group[5] & 0x0F | int(code) << 4
        return bytes(group)

    def _disturbed(self, packets: WordArray) -> WordArray:
        if self.bit_error_rate:
            flat = packets.view(np.uint8).reshape(-1)
            hits = np.flatnonzero(self._rng.random(flat.size) < 8 * self.bit_error_rate)
            flat[hits] ^= np.left_shift(1, self._rng.integers(0, 8, hits.size)).astype(np.uint8)
        return packets

    def _write_configuration(self, slaves: slice, body: bytes, now_s: float) -> None:
        group = _decoded_configuration(body)
        if group is None:
            return
        rows = self.is_powered
        if slaves != slice(None):
            rows = np.zeros(self.n_slaves, dtype=bool)
            rows[slaves] = self.is_powered[slaves]
        self.cfgr[rows] = group
        if self.has_timer_pin:
            self.cfgr[rows, 0] |= _TIMER_PIN
            self._timer_end_s[rows] = now_s + 60 * DISCHARGE_MINUTES[group[5] >> 4]
        self._update_switches()

    def _update_switches(self) -> None:
        bits = np.unpackbits(self.cfgr[:, _SWITCHES:], axis=1, bitorder="little")[:, :CELLS_PER_PACK]
        if not self._all_powered:
            bits = bits & self.is_powered[:, None]
        self.discharging = bits.reshape(-1).view(bool)
        self.is_discharging = bool(self.discharging.any())

    def _convert(self, command: int) -> None:
        kind = command & ~(_MODE_BITS | _CHANNEL_BITS | _DISCHARGE_PERMITTED)
        if kind == ADCV:
            inputs_v = self.cell_v
            if command & _DISCHARGE_PERMITTED:
                inputs_v = np.where(self.discharging, self.sensor_v, inputs_v)
            if self.open_wires:
                inputs_v = self._with_open_wires(inputs_v, float(self._rng.uniform(0.3, 0.7)))
            self._store_cells(inputs_v)
        elif kind & ~_PULL_UP == ADOW:
            self._store_cells(self._with_open_wires(self.cell_v, 1.0 if command & _PULL_UP else 0.0))
        elif kind == ADAX:
            self.avr[self.is_powered] = np.array([20000, 20000, 20000, 0, 0, REFERENCE_V * 1e4], dtype=np.uint16)
        elif kind == ADSTAT:
            total_v = self.cell_v.reshape(self.n_slaves, -1).sum(axis=1)
            self.str[:, 0] = np.where(self.is_powered, np.rint(total_v * 1e4 / 20), self.str[:, 0])
            die = round((self.board_degc + 273) * 75)
            self.str[self.is_powered, 1:4] = np.array([die, SUPPLY_V * 1e4, DIGITAL_V * 1e4], dtype=np.uint16)
            self.str[self.is_powered, 4:6] = 0

    def _test_itself(self, test: SelfTest) -> None:
        has_option = (self.cfgr[:, 0] & _ADC_OPTION).astype(bool)
        codes = np.where(has_option, test.code(adc_option=True), test.code()).astype(np.uint16) | self.stuck_bits
        registers = {CVST: self.cvr, AXST: self.avr}.get(test.kind, self.str[:, :_SUPPLY_WORDS])
        registers[self.is_powered] = codes[self.is_powered, None]

    def _store_cells(self, inputs_v: FloatArray) -> None:
        counts = inputs_v * 1e4
        np.rint(counts, out=counts)
        np.minimum(counts, CELL_INPUT_MAX_V * 1e4, out=counts)
        np.maximum(counts, 0, out=counts)
        rows = counts.reshape(self.n_slaves, CELLS_PER_PACK)
        if self._all_powered:
            self.cvr[:] = rows
        else:
            self.cvr[self.is_powered] = rows[self.is_powered].astype(np.uint16)
        if self._has_stuck_bits:
            self.cvr[self.is_powered] |= self.stuck_bits[self.is_powered, None]

    def _with_open_wires(self, inputs_v: FloatArray, share: float) -> FloatArray:
        """Return the inputs where each open node floats at `share` of the two cells that it should divide."""
        seen_v = inputs_v.copy()
        for cell in self.open_wires:
            if cell % CELLS_PER_PACK == CELLS_PER_PACK - 1:
                seen_v[cell] *= share
                continue
            both_v = seen_v[cell] + seen_v[cell + 1]
            seen_v[cell], seen_v[cell + 1] = share * both_v, (1 - share) * both_v
        return seen_v
