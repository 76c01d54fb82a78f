"""The master between a boot and a reset: its firmware in C, on the board's slaves, EEPROM and current sensor.

`measure` is one pass of it, every 20 ms. Bytes come in by `receive`, frames leave by `next_frame` when the line is
free. Nothing is decided here: what is flashed is what is simulated.
"""

import ctypes
import math
from collections.abc import Iterator
from ctypes import addressof, c_size_t, c_uint16, c_uint32

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.can_tables import bit_rate
from firmware_protocol.memory_map import FIELDS, MASTER_SIZE, STATUS_FLAGS
from firmware_protocol.messages import CommandId, Result
from simulator import firmware
from simulator.bms_state import ChargingState, RelayState
from simulator.board import Board
from simulator.can_bus import CanFrame

RESET_DELAY_S = 0.1  # so that the reply to the command leaves first
_SAMPLE_S = 0.001
_DRAWN_SAMPLES = 1000
_RELAYS = tuple(RelayState)
_FLAG = {name: 1 << bit for bit, name in enumerate(STATUS_FLAGS)}
_BRP_OFFSET = FIELDS["conf.can_brp"].offset
_FAN_DUTY_OFFSET = FIELDS["charger.fan_duty"].offset
_READ_ROWS = ("read_cells", "read_auxiliary", "read_configuration")  # as `vw_simulated_row` has them


class _Wiring:
    """What the firmware reaches its board by, each call at the time that it gives."""

    def __init__(self, board: Board, packets: NDArray[np.uint16], boot_s: float) -> None:
        self._board, self._packets, self._boot_s = board, packets, boot_s
        self._read_rows = [getattr(board.chain, name) for name in _READ_ROWS]
        self.pass_s = boot_s
        self.functions = firmware.BoardStruct(
            firmware.Transfer(self._transfer),
            firmware.ReadRow(self._read_row),
            firmware.EepromRead(self._read),
            firmware.EepromWrite(self._write),
            firmware.EepromIsBusy(self._is_busy),
        )

    def _transfer(self, at_us: int, sent: int, n_sent: int, received: int, n_received: int) -> None:
        at_s = self.pass_s + at_us * 1e-6
        if not n_sent:
            self._board.chain.wake(at_s)
            return
        answer = self._board.chain.execute(ctypes.string_at(sent, n_sent), at_s)
        if n_received:
            ctypes.memmove(received, answer.ljust(n_received, b"\xff"), n_received)

    def _read_row(self, at_us: int, row: int) -> bool:
        words = self._read_rows[row](self.pass_s + at_us * 1e-6)
        _, n_groups, n_words = words.shape
        self._packets[:, :n_groups, :n_words] = words
        return bool(n_words == self._packets.shape[2])

    def _read(self, address: int, data: int, length: int) -> None:
        ctypes.memmove(data, self._board.eeprom.read(address, length), length)

    def _write(self, now_ms: int, address: int, data: int, length: int) -> None:
        self._board.eeprom.begin_write(address, ctypes.string_at(data, length), self._boot_s + now_ms * 1e-3)

    def _is_busy(self, now_ms: int) -> bool:
        return self._board.eeprom.is_busy(self._boot_s + now_ms * 1e-3)


class _Charging:
    """How the firmware's charging stands."""

    def __init__(self, io: firmware.IoStruct) -> None:
        self._io = io

    @property
    def is_active(self) -> bool:
        """The charge relays are closed."""
        return bool(self._io.is_charging)

    @property
    def state(self) -> ChargingState:
        """Its stage."""
        return ChargingState(self._io.charging)


class VirtualMaster:
    """The firmware between a boot and a reset.

    Raises:
        FirmwareError: its library has not been built.
    """

    def __init__(self, board: Board, now_s: float, reset_cause: int = 0) -> None:
        board.boots += 1
        self.board = board
        self._boot_s = now_s
        self._c = firmware.load()
        self._memory = ctypes.create_string_buffer(self._c.vw_simulated_size())
        self._io = io = firmware.IoStruct.from_buffer(self._memory)
        self.image = memoryview(self._memory).cast("B")[:MASTER_SIZE]  # the struct, which the firmware changes
        self._samples = np.frombuffer(io.samples, dtype="<u2")
        self._frame = addressof(io.frame)
        packets = np.frombuffer(io.packets, dtype="<u2").reshape(firmware.PACKETS)
        self._wiring = _Wiring(board, packets, now_s)
        self.charging = _Charging(io)
        self.is_can_off = False
        self.drive_requested = False
        self.is_shutdown_closed = True  # the rest of the circuit: buttons, insulation monitor, interlocks
        self.reset_due_s: float | None = None
        io.is_open = board.latch.is_open
        inputs = firmware.SensorInputs(*board.chain.sensor_inputs)
        functions = ctypes.byref(self._wiring.functions)
        self._c.vw_simulated_boot(self._memory, functions, inputs, reset_cause, c_uint32(board.boots))

    def _ms(self, now_s: float) -> c_uint32:
        return c_uint32(round((now_s - self._boot_s) * 1000))

    # --- outputs

    @property
    def relay_state(self) -> RelayState:
        """Return the side that the relays connect the accumulator to."""
        return _RELAYS[int(self._io.relays)]

    @property
    def relays_since_s(self) -> float:
        """Return since when they are there [s]."""
        return self._boot_s + float(self._io.relays_since_ms) / 1000

    @property
    def has_precharge_failed(self) -> bool:
        """The vehicle's link did not reach its voltage in time."""
        return bool(self._io.has_precharge_failed)

    @property
    def fan_duty(self) -> float:
        """Duty of the fans, 0..1."""
        return self.image[_FAN_DUTY_OFFSET] / 255

    @property
    def is_ok(self) -> bool:
        """The OK signal."""
        return not self._io.is_open

    # --- one pass

    def measure(self, now_s: float, dt_s: float, true_current_a: float) -> None:
        """Run one pass: measure, protect, charge, balance, set relays and fans."""
        board, io = self.board, self._io
        n = min(max(round(dt_s / _SAMPLE_S), 1), firmware.MAX_SAMPLES)
        counts = board.current_sensor.sample(true_current_a, min(n, _DRAWN_SAMPLES))
        # a simulation in long passes: the same samples again, so that no charge is lost
        self._samples[:n] = counts if n <= _DRAWN_SAMPLES else np.resize(counts, n)
        io.is_drive_asked = self.drive_requested
        io.is_shutdown_closed = self.is_shutdown_closed
        io.link_permille = min(max(int(board.link_share * 1000), 0), 0xFFFF)
        io.hardware = _FLAG["i2c1"] * (not board.eeprom.worn_pages) | _FLAG["can1"] * (self.bit_rate > 0)
        board.eeprom.is_busy(now_s)  # a page under way is over
        self._wiring.pass_s = now_s
        self._c.vw_simulated_pass(self._memory, self._ms(now_s), c_uint32(round(dt_s * 1000)), c_uint16(n))
        board.latch.is_open = bool(io.is_open)

    # --- commands of the operator

    def command(self, command: CommandId, argument: int, now_s: float) -> bool:
        """Carry out a command with a checked argument; return False where the state forbids it."""
        is_done = bool(self._c.vw_simulated_command(self._memory, self._ms(now_s), command, argument) == Result.DONE)
        self.board.latch.is_open = bool(self._io.is_open)
        if is_done and command == CommandId.RESET:
            self.reset_due_s = now_s + RESET_DELAY_S
        return is_done

    def store_config(self, now_s: float) -> bool:
        """Store the configuration in force; return whether it began."""
        return bool(self._c.vw_simulated_store(self._memory, self._ms(now_s)) == Result.DONE)

    def lose_power(self, rng: np.random.Generator) -> None:
        """Lose power; a page that is being written stays written in part."""
        self.board.eeprom.lose_power(rng)

    # --- RS232

    def receive(self, data: bytes, now_s: float) -> None:
        """Take bytes from the line."""
        self._c.vw_simulated_received(self._memory, self._ms(now_s), data, c_size_t(len(data)))
        self.board.latch.is_open = bool(self._io.is_open)

    def next_frame(self, now_s: float) -> bytes | None:
        """Return the next frame for the free line, None where there is none."""
        length = self._c.vw_simulated_next(self._memory, self._ms(now_s))
        if self._io.is_restarting and self.reset_due_s is None:
            self.reset_due_s = now_s + RESET_DELAY_S
        return ctypes.string_at(self._frame, length) if length else None

    def next_due_s(self, now_s: float) -> float:
        """Return the earliest time at which there may be a frame to send."""
        return self._boot_s + self._io.line_due_ms * 1e-3 if self._io.has_line_due else math.inf

    # --- CAN

    @property
    def bit_rate(self) -> int:
        """The bit rate of the prescaler in force, 0 in bus-off."""
        return 0 if self.is_can_off else bit_rate(self.image[_BRP_OFFSET])

    def can_received(self, frame: CanFrame, now_s: float) -> None:
        """Take a frame from the bus."""
        length = len(frame.data)
        data = (ctypes.c_uint8 * 8)(*frame.data[:8])
        given = firmware.CanFrameStruct(frame.can_id, frame.is_extended, length, data)
        self._c.vw_simulated_can_received(self._memory, self._ms(now_s), ctypes.byref(given))

    def can_sent(self) -> Iterator[CanFrame]:
        """Yield the frames that the last pass sends."""
        for frame in self._io.can[: self._io.n_can]:
            yield CanFrame(frame.id, frame.is_extended, bytes(frame.data[: frame.length]))
