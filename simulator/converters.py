"""The converters of eight LTC6804 and the registers that they fill, each when its conversion is over.

Volts at the inputs come in, register words are there to be read; commands, packets and power are `simulator.slave`'s.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.ltc6804 import Command
from firmware_protocol.memory_map import CELLS_PER_PACK, CHIP_MISSING
from simulator.conversion import ADAX, ADCV, ADOW, N_AUXILIARY, N_STATUS, Conversion

ByteArray = NDArray[np.uint8]
Words = NDArray[np.uint16]
FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

CELL_INPUT_MAX_V = 5.75  # the converter's end
REFERENCE_V = 3.0
SUPPLY_V = 5.0
DIGITAL_V = 3.2
GPIO_V = (2.0, 2.0, 2.0, 0.0, 0.0)
_COUNTS_PER_V = 1e4
_FLAGS, _LAST = 4, 5  # status words: flags of cells 1..8; flags of cells 9..12 and the chip's own
_CELL_FLAGS = np.array([0xFFFF, 0x00FF], dtype=np.uint16)
_MULTIPLEXER_FAILED, _THERMAL_SHUTDOWN = np.array([0x0200, 0x0100], dtype=np.uint16)  # in the last status word
_AFTER_CLEAR = np.array([CHIP_MISSING] * 5 + [0x03FF], dtype=np.uint16)  # all flags set, revision 0
_THRESHOLD_COUNTS = 16  # 1.6 mV
_TIME_TOLERANCE_S = 1e-9
_ALL = slice(None)


@dataclass(slots=True)
class _Running:
    """A conversion under way: until when, in which chips, and what stood at the cell inputs when it began."""

    ready_s: float
    chips: BoolArray  # (n_slaves,)
    conversion: Conversion
    inputs_v: FloatArray | None
    adc_option: bool


class Converters:
    """Arrays have one row a slave; cells and sensors are numbered through."""

    def __init__(self, n_slaves: int, rng: np.random.Generator) -> None:
        self._rng = rng
        self.n_slaves = n_slaves
        n_cells = n_slaves * CELLS_PER_PACK
        self.cell_v: FloatArray = np.zeros(n_cells)
        self.sensor_v: FloatArray = np.zeros(n_cells)
        self.board_degc = 25.0
        self.open_wires: set[int] = set()  # cell whose upper wire is off
        self.multiplexer_failed: BoolArray = np.zeros(n_slaves, dtype=bool)
        self.cvr: Words = np.full((n_slaves, CELLS_PER_PACK), CHIP_MISSING, dtype="<u2")
        self.avr: Words = np.full((n_slaves, N_AUXILIARY), CHIP_MISSING, dtype="<u2")
        self.str: Words = np.tile(_AFTER_CLEAR, (n_slaves, 1))
        self.stuck_bits: Words = np.zeros(n_slaves, dtype=np.uint16)  # set by `stick`
        self.reference_factor: FloatArray = np.ones(n_slaves)  # set by `drift`
        self._has_faults = False
        self.everyone: BoolArray = np.ones(n_slaves, dtype=bool)  # given as `chips`, conversions are stored faster
        self.everyone.flags.writeable = False
        self._counts_per_v: FloatArray = np.full(n_cells, _COUNTS_PER_V)
        self._counts_max: FloatArray = np.full(n_cells, CELL_INPUT_MAX_V * _COUNTS_PER_V)
        self._counts_min: FloatArray = np.zeros(n_cells)
        self._auxiliary_v: FloatArray = np.tile((*GPIO_V, REFERENCE_V), (n_slaves, 1))
        self._status_v: FloatArray = np.tile((0.0, 0.0, SUPPLY_V, DIGITAL_V), (n_slaves, 1))
        self._flagged_by: bytes | None = None  # the configuration that the next two are of
        self._under_counts: FloatArray = np.zeros((n_slaves, 1))
        self._over_counts: FloatArray = np.zeros((n_slaves, 1))
        self._running: list[_Running] = []
        self._next_ready_s = math.inf
        self._compared: FloatArray = np.zeros((n_slaves, CELLS_PER_PACK))  # counts of the last conversion of cells
        self._unflagged: BoolArray | None = None  # chips whose conversion was not compared with the thresholds yet

    # --- faults

    def stick(self, slave: int, bits: int) -> None:
        """Set the bits of a slave's converter that are stuck at 1; 0 without a fault."""
        self.stuck_bits[slave] = bits
        self._has_faults = bool(self.stuck_bits.any() or (self.reference_factor != 1).any())

    def drift(self, slave: int, factor: float) -> None:
        """Set the reference of a slave's converter to this part of its nominal voltage; 1 without a fault."""
        self.reference_factor[slave] = factor
        self._has_faults = bool(self.stuck_bits.any() or (self.reference_factor != 1).any())

    def reset(self, slave: int) -> None:
        """Forget everything, as after a loss of power."""
        self.cvr[slave] = self.avr[slave] = CHIP_MISSING
        self.str[slave] = _AFTER_CLEAR
        self._unflagged = None
        for running in self._running:
            running.chips = running.chips & (np.arange(self.n_slaves) != slave)

    # --- conversions

    def start(
        self,
        conversion: Conversion,
        chips: BoolArray,
        ready_s: float,
        discharging: BoolArray,
        *,
        adc_option: bool = False,
    ) -> None:
        """Start a conversion; one that is running in the same chips is aborted.

        Args:
            conversion: which.
            chips: (n_slaves,) which chips take part.
            ready_s: when its results are there [s].
            discharging: (n_cells,) the switches, which put the sensors onto the inputs where discharge is permitted.
            adc_option: CFGR's adcopt in these chips.
        """
        if self._running:
            for running in self._running:
                running.chips = running.chips & ~chips
            self._running = [running for running in self._running if running.chips.any()]
        self._running.append(_Running(ready_s, chips, conversion, self._inputs(conversion, discharging), adc_option))
        if ready_s < self._next_ready_s:
            self._next_ready_s = ready_s

    def finish(self, now_s: float) -> None:
        """Put the results of conversions that are over into the registers."""
        limit_s = now_s + _TIME_TOLERANCE_S
        if self._next_ready_s > limit_s:
            return
        over, self._running = self._running, []
        self._next_ready_s = math.inf
        for running in over:
            if running.ready_s <= limit_s:
                self._store(running)
            else:
                self._running.append(running)
                self._next_ready_s = min(self._next_ready_s, running.ready_s)

    def is_busy(self, slaves: slice) -> bool:
        """Return whether any of these chips converts."""
        return any(running.chips[slaves].any() for running in self._running)

    def clear(self, command: int, chips: BoolArray, cfgr: ByteArray) -> None:
        """Carry out CLRCELL, CLRAUX or CLRSTAT."""
        self.flag(cfgr)
        if command == Command.CLRCELL:
            self.cvr[chips] = CHIP_MISSING
        elif command == Command.CLRAUX:
            self.avr[chips] = CHIP_MISSING
        else:
            self.str[chips] = _AFTER_CLEAR

    def status_was_read(self, slaves: slice) -> None:
        """Clear what a read of the second status group clears."""
        self.str[slaves, _LAST] &= ~_THERMAL_SHUTDOWN

    def flag(self, cfgr: ByteArray) -> None:
        """Compare the converted cells with the thresholds: two status bits a cell, under voltage first.

        Left until somebody looks or the thresholds change, because it costs more than the conversion.

        Args:
            cfgr: (n_slaves, 6) the configuration during the conversion.
        """
        chips = self._unflagged
        if chips is None:
            return
        self._unflagged = None
        under, over = self._thresholds(cfgr)
        pairs = np.empty((self.n_slaves, CELLS_PER_PACK, 2), dtype=bool)
        np.less(self._compared, under, out=pairs[..., 0])
        np.greater(self._compared, over, out=pairs[..., 1])
        words = np.zeros((self.n_slaves, 2), dtype="<u2")
        words.view(np.uint8)[:, :3] = np.packbits(pairs.reshape(self.n_slaves, -1), axis=1, bitorder="little")
        words |= self.str[:, _FLAGS:] & ~_CELL_FLAGS
        np.copyto(self.str[:, _FLAGS:], words, where=chips[:, None])

    def _thresholds(self, cfgr: ByteArray) -> tuple[FloatArray, FloatArray]:
        """Return (n_slaves, 1) the counts below and above which a cell is flagged."""
        written = cfgr.tobytes()
        if written != self._flagged_by:
            self._flagged_by = written
            group = cfgr.astype(np.uint32)
            under = ((group[:, 2] & 0x0F) << 8 | group[:, 1]) + 1
            over = group[:, 3] << 4 | group[:, 2] >> 4
            self._under_counts = _THRESHOLD_COUNTS * under[:, None].astype(np.float64)
            self._over_counts = _THRESHOLD_COUNTS * over[:, None].astype(np.float64)
        return self._under_counts, self._over_counts

    # --- what they see

    def _inputs(self, conversion: Conversion, discharging: BoolArray) -> FloatArray | None:
        """Return (n_cells,) voltages at the cell inputs [V], None for other conversions."""
        if conversion.self_test is not None or conversion.kind not in (ADCV, ADOW):
            return None
        if conversion.kind == ADOW:
            return self._with_open_wires(self.cell_v, 1.0 if conversion.pull_up else 0.0)
        inputs_v = self.cell_v
        if conversion.discharge_permitted:
            inputs_v = np.where(discharging, self.sensor_v, inputs_v)
        if self.open_wires:
            inputs_v = self._with_open_wires(inputs_v, float(self._rng.uniform(0.3, 0.7)))
        return inputs_v

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

    def _store(self, running: _Running) -> None:
        conversion, chips = running.conversion, running.chips
        if conversion.self_test is not None:
            code = conversion.self_test.code(adc_option=running.adc_option)
            registers = {ADCV: self.cvr, ADAX: self.avr}.get(conversion.kind, self.str[:, :N_STATUS])
            np.copyto(registers, (self.stuck_bits | np.uint16(code))[:, None], where=chips[:, None])
        elif running.inputs_v is not None:
            self._store_cells(running.inputs_v, running)
        elif conversion.kind == Command.DIAGN:
            self.str[chips, _LAST] &= ~_MULTIPLEXER_FAILED
            self.str[chips & self.multiplexer_failed, _LAST] |= _MULTIPLEXER_FAILED
        elif conversion.kind == ADAX:
            self._store_columns(self.avr, self._auxiliary_v, conversion.columns, chips)
        else:
            self._status_v[:, 0] = self.cell_v.reshape(self.n_slaves, -1).sum(axis=1) / 20
            self._status_v[:, 1] = (self.board_degc + 273) * 7.5e-3
            self._store_columns(self.str[:, :N_STATUS], self._status_v, conversion.columns, chips)

    def _store_columns(self, registers: Words, volts: FloatArray, columns: slice, chips: BoolArray) -> None:
        codes = np.rint(volts * _COUNTS_PER_V / self.reference_factor[:, None]).astype(np.uint16)
        codes |= self.stuck_bits[:, None]
        np.copyto(registers[:, columns], codes[:, columns], where=chips[:, None])

    def _store_cells(self, inputs_v: FloatArray, running: _Running) -> None:
        counts = inputs_v * self._counts_per_v
        if self._has_faults:
            counts /= np.repeat(self.reference_factor, CELLS_PER_PACK)
        np.rint(counts, out=counts)
        np.minimum(counts, self._counts_max, out=counts)
        np.maximum(counts, self._counts_min, out=counts)
        rows = counts.reshape(self.n_slaves, CELLS_PER_PACK)
        columns, chips = running.conversion.columns, running.chips
        if chips is self.everyone and columns == _ALL and not self._has_faults:
            self.cvr[:] = rows
            compared = rows
        else:
            codes = rows.astype(np.uint16) | self.stuck_bits[:, None]
            np.copyto(self.cvr[:, columns], codes[:, columns], where=chips[:, None])
            compared = self.cvr.astype(np.float64)
        if running.conversion.kind == ADCV:
            self._compared = compared
            self._unflagged = chips if self._unflagged is None else self._unflagged | chips
