"""Eight LTC6804-2 on one isoSPI: answers to packets, sleep and wake-up, balancing outputs.

A chip without power, one that was not woken, or noise on the pair shows as packets whose check word is wrong.
"""

import functools

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.errors import DecodeError
from firmware_protocol.ltc6804 import (
    DISCHARGE_MINUTES,
    GROUP_SIZE,
    READ_CELLS,
    Command,
    decode_command,
    decode_group,
    with_pec,
)
from firmware_protocol.memory_map import CELLS_PER_PACK
from simulator.conversion import ADCV, ADOW, REFERENCE_START_S, Conversion, decode_conversion
from simulator.converters import BoolArray, ByteArray, Converters, FloatArray
from simulator.isospi import PACKET_WORDS, WordArray, carry, damaged, flip_bits

FIRST_ADDRESS = 1  # switches on the boards: 1 to 8
THESIS_SENSOR_INPUTS = (0, 2, 4, 6, 8, 10, 1, 3, 5, 7, 9, 11)  # cell inputs of sensors 1 to 12
WATCHDOG_S = 2.0
PORT_IDLE_S = 4.3e-3  # without traffic, then the port has to be woken: the earliest of the data sheet, 4.3 to 6.7 ms
PORT_READY_S = 10e-6
CORE_WAKE_S = 300e-6  # out of sleep, which begins with the watchdog
_ADC_OPTION, _TIMER_PIN, _REFERENCE_ON = 0x01, 0x02, 0x04  # in CFGR0
_SWITCHES = 4  # CFGR from here on: the switches and their timer
_RESET_CFGR = np.array((0xF8, 0, 0, 0, 0, 0), dtype=np.uint8)  # GPIO pull-downs off, reference off
_READ_WORDS = {command: (0, 3 * i) for i, command in enumerate(READ_CELLS)} | {
    Command.RDAUXA: (1, 0),
    Command.RDAUXB: (1, 3),
    Command.RDSTATA: (2, 0),
    Command.RDSTATB: (2, 3),
}
_READS = frozenset({*_READ_WORDS, Command.RDCFG})
_CLEARS = frozenset({Command.CLRCELL, Command.CLRAUX, Command.CLRSTAT})
_IDLE_LINE = b"\xff" * 2 * PACKET_WORDS
_ALL = slice(None)
_TIME_TOLERANCE_S = 1e-9


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
    """All slaves; arrays have one row each, cells are numbered through. Addresses begin with `FIRST_ADDRESS`."""

    def __init__(
        self, n_slaves: int, rng: np.random.Generator, sensor_inputs: tuple[int, ...] = THESIS_SENSOR_INPUTS
    ) -> None:
        self._rng = rng
        self.n_slaves = n_slaves
        self.sensor_inputs = sensor_inputs  # on which cell input of its slave each cell's sensor sits
        self.converters = Converters(n_slaves, rng)
        self.is_powered: BoolArray = np.ones(n_slaves, dtype=bool)
        self._listens: BoolArray = np.zeros(n_slaves, dtype=bool)  # with power and awake
        self._all_listen = False
        self._ready_s = 0.0
        self._active_s = -np.inf
        self.bit_error_rate = 0.0
        self.cfgr: ByteArray = np.tile(_RESET_CFGR, (n_slaves, 1))
        self._reference_up_s: FloatArray = np.full(n_slaves, np.inf)
        self._references_up_s = np.inf  # the last of them
        self._option: bool | None = None  # adcopt, where all chips have the same and their reference on
        self.discharging: BoolArray = np.zeros(n_slaves * CELLS_PER_PACK, dtype=bool)
        self.is_discharging = False
        self._interrupted_s = 0.0
        self.has_timer_pin = True  # SWTEN: without it the discharge timer does not run
        self._timer_end_s: NDArray[np.float64] = np.zeros(n_slaves)

    def set_powered(self, slave: int, powered: bool) -> None:
        """Switch the power of a slave; its registers are reset and it sleeps until the next wake-up."""
        if powered == bool(self.is_powered[slave]):
            return
        self.converters.reset(slave)
        self.cfgr[slave] = _RESET_CFGR
        self.is_powered[slave] = powered
        self._listens = self._listens & (np.arange(self.n_slaves) != slave)
        self._all_listen = False
        self._references_change(np.inf, slave)
        self._update_switches()

    def watch(self, now_s: float) -> None:
        """Reset the configuration of chips that were not woken for two seconds, and end what the timer ends.

        The switches are reset with the rest, unless the discharge timer of the chip is running.
        """
        if not self.is_discharging:
            return
        if now_s - self._active_s > WATCHDOG_S:
            self._expire(now_s)
        elif self.has_timer_pin:
            over = (self._timer_end_s <= now_s) & (self.cfgr[:, 5] > 0x0F)
            self.cfgr[over, _SWITCHES:] = _RESET_CFGR[_SWITCHES:]
            self._update_switches()

    def take_bleeding(self, dt_s: float) -> FloatArray | None:
        """Return (n_cells,) for which part of the last `dt_s` each cell was bled, None where no switch is closed.

        A conversion holds all switches open while it lasts.
        """
        interrupted_s, self._interrupted_s = self._interrupted_s, 0.0
        if not self.is_discharging:
            return None
        return self.discharging.astype(np.float64) * max(1.0 - interrupted_s / dt_s, 0.0)

    def _expire(self, now_s: float) -> None:
        runs = self._timer_end_s > now_s
        self.cfgr[:, :_SWITCHES] = _RESET_CFGR[:_SWITCHES]
        self.cfgr[~runs, _SWITCHES:] = _RESET_CFGR[_SWITCHES:]
        self._references_change(np.inf, _ALL)
        self._update_switches()

    # --- the bus

    def wake(self, now_s: float) -> float:
        """Take a wake-up signal and return when every chip with power listens [s]."""
        if now_s - self._active_s > WATCHDOG_S:
            self.converters.flag(self.cfgr)
            self._expire(now_s)
            self._all_listen, self._listens = False, np.zeros(self.n_slaves, dtype=bool)
        if not self._all_listen and (self.is_powered & ~self._listens).any():
            self._all_listen = bool(self.is_powered.all())
            self._listens = self.converters.everyone if self._all_listen else self.is_powered.copy()
            self._ready_s = now_s + CORE_WAKE_S
        elif now_s - self._active_s > PORT_IDLE_S:
            self._ready_s = now_s + PORT_READY_S
        self._active_s = now_s
        return max(self._ready_s, now_s)

    def execute(self, packet: bytes, now_s: float) -> bytes:
        """Take one packet; return 8 bytes to a read, one to a poll (0 while a conversion lasts), else nothing."""
        try:
            command, address = _decoded(packet[:4])
        except DecodeError:
            return b""
        nothing = _IDLE_LINE if command in _READS else b""
        if not self._is_listening(now_s):
            return nothing
        if self.bit_error_rate:
            packet = damaged(packet, self.bit_error_rate, self._rng)
            try:
                command, address = decode_command(packet)
            except DecodeError:
                return nothing
        slave = None if address is None else address - FIRST_ADDRESS
        if slave is not None and not 0 <= slave < self.n_slaves:
            return nothing
        slaves = _ALL if slave is None else slice(slave, slave + 1)
        if command == Command.WRCFG:
            self._write_configuration(self._chips(slaves), packet[4:], now_s)
        elif command in _READS:
            return self._answer(command, slave, now_s)
        elif command == Command.PLADC:
            return b"\x00" if self.converters.is_busy(slaves) else b"\xff"
        elif command in _CLEARS:
            self.converters.clear(command, self._chips(slaves), self.cfgr)
        elif (conversion := decode_conversion(command)) is not None:
            self._start(conversion, self._chips(slaves), now_s)
        return b""

    def read_cells(self, now_s: float) -> WordArray:
        """Return the answers of all slaves to the four cell reads."""
        receives = self._is_listening(now_s)
        return self._answers(self.converters.cvr, receives=receives)

    def read_auxiliary(self, now_s: float) -> WordArray:
        """Return the answers of all slaves to both auxiliary and both status reads."""
        receives = self._is_listening(now_s)
        self.converters.flag(self.cfgr)
        answers = self._answers(np.concatenate((self.converters.avr, self.converters.str), axis=1), receives=receives)
        self.converters.status_was_read(_ALL)
        return answers

    def read_configuration(self, now_s: float) -> WordArray:
        """Return the answers of all slaves to the configuration read."""
        receives = self._is_listening(now_s)
        groups = b"".join(self._configuration_read(slave, now_s) for slave in range(self.n_slaves))
        return self._answers(np.frombuffer(groups, dtype="<u2").reshape(self.n_slaves, -1), receives=receives)

    def _is_listening(self, now_s: float) -> bool:
        """Note traffic and timeouts; an idle port wakes up by a packet and loses it."""
        if now_s - self._active_s > PORT_IDLE_S:
            self.wake(now_s)
            return False
        self._active_s = now_s
        self.converters.finish(now_s)
        return now_s >= self._ready_s - _TIME_TOLERANCE_S

    def _chips(self, slaves: slice) -> BoolArray:
        """Return (n_slaves,) which of these receive a command."""
        if slaves == _ALL:
            return self._listens
        chips = np.zeros(self.n_slaves, dtype=bool)
        chips[slaves] = self._listens[slaves]
        return chips

    def _answers(self, registers: WordArray, *, receives: bool) -> WordArray:
        silent = None if receives and self._all_listen else ~(self._listens & receives)
        return carry(registers, silent, self.bit_error_rate, self._rng)

    def _answer(self, command: int, slave: int | None, now_s: float) -> bytes:
        if slave is None or not self._listens[slave]:
            return _IDLE_LINE
        if command == Command.RDCFG:
            group = self._configuration_read(slave, now_s)
        else:
            self.converters.flag(self.cfgr)
            kind, start = _READ_WORDS[Command(command)]
            registers = (self.converters.cvr, self.converters.avr, self.converters.str)[kind]
            group = registers[slave, start : start + 3].tobytes()
            if command == Command.RDSTATB:
                self.converters.status_was_read(slice(slave, slave + 1))
        packet = np.frombuffer(with_pec(group), dtype="<u2").copy()
        if self.bit_error_rate:
            flip_bits(packet, self.bit_error_rate, self._rng)
        return packet.tobytes()

    def _configuration_read(self, slave: int, now_s: float) -> bytes:
        """Return CFGR as a chip gives it: the timer's code is that of the time left."""
        group = self.cfgr[slave].copy()
        left_minutes = (self._timer_end_s[slave] - now_s) / 60
        code = np.searchsorted(DISCHARGE_MINUTES, left_minutes) if left_minutes > 0 else 0
        group[5] = group[5] & 0x0F | int(code) << 4
        group[0] |= _TIMER_PIN * self.has_timer_pin
        return bytes(group)

    # --- configuration, switches, conversions

    def _write_configuration(self, chips: BoolArray, body: bytes, now_s: float) -> None:
        group = _decoded_configuration(body)
        if group is None:
            return
        before = self.cfgr
        self.cfgr = np.where(chips[:, None], group, before)
        old, new = before.tobytes(), self.cfgr.tobytes()
        changed = [old[at::GROUP_SIZE] != new[at::GROUP_SIZE] for at in range(GROUP_SIZE)]
        if any(changed[1:_SWITCHES]):
            self.converters.flag(before)  # by the thresholds of the conversion
        if changed[0]:
            if not group[0] & _REFERENCE_ON:
                self._references_change(np.inf, chips)
            else:
                self._references_change(now_s + REFERENCE_START_S, chips & (before[:, 0] & _REFERENCE_ON == 0))
        if self.has_timer_pin:
            self._timer_end_s[chips] = now_s + 60 * DISCHARGE_MINUTES[group[5] >> 4]
        if any(changed[_SWITCHES:]):
            self._update_switches()

    def _references_change(self, up_s: float, chips: BoolArray | slice | int) -> None:
        self._reference_up_s[chips] = up_s
        self._references_up_s = float(self._reference_up_s.max())
        flags = set((self.cfgr[:, 0] & (_REFERENCE_ON | _ADC_OPTION)).tolist())
        common = flags.pop() if len(flags) == 1 else 0
        self._option = bool(common & _ADC_OPTION) if common & _REFERENCE_ON else None

    def _update_switches(self) -> None:
        bits = np.unpackbits(self.cfgr[:, _SWITCHES:], axis=1, bitorder="little")[:, :CELLS_PER_PACK]
        if not self._all_listen:
            bits = bits & self.is_powered[:, None]
        self.discharging = bits.reshape(-1).view(bool)
        self.is_discharging = int(np.count_nonzero(self.discharging)) > 0

    def _start(self, conversion: Conversion, chips: BoolArray, now_s: float) -> None:
        """Start a conversion; its time differs between chips by adcopt and by references that are not ready yet."""
        took_s = 0.0
        if self._option is not None and self._references_up_s <= now_s:
            took_s = conversion.times_s[self._option]
            self.converters.start(conversion, chips, now_s + took_s, self.discharging, adc_option=self._option)
        else:
            options = (self.cfgr[:, 0] & _ADC_OPTION).astype(bool)
            wait_s = np.clip(self._reference_up_s - now_s, 0.0, REFERENCE_START_S)
            for option, group_wait_s in {(bool(o), float(w)) for o, w in zip(options, wait_s, strict=True)}:
                group = chips & (options == option) & (wait_s == group_wait_s)
                group_s = conversion.time_s(adc_option=option) + group_wait_s
                self.converters.start(conversion, group, now_s + group_s, self.discharging, adc_option=option)
                took_s = max(took_s, group_s)
        if conversion.kind in (ADCV, ADOW):
            self._interrupted_s += took_s
