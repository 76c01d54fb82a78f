"""The master in C on the simulated board, in the place of the virtual master: the same car, the same tests.

Measuring is the simulator's, which is quick, or C as well, through the bytes of the slaves' pair; what the measurement
leads to, the link, the EEPROM's layout and the CAN tables are C.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Iterator

import numpy as np

from firmware_protocol.can_tables import bit_rate
from firmware_protocol.framing import encode_frame
from firmware_protocol.memory_map import CELLS_PER_PACK, FIELDS, MASTER_SIZE, N_CELLS, N_PACKS
from firmware_protocol.messages import CommandId, MessageType, Result
from simulator.board import Board
from simulator.can_bus import CanFrame
from simulator.charging import ChargingState
from simulator.master import RESET_DELAY_S, SLAVE_REFRESH_S
from simulator.measuring_task import MeasuringTask, samples_of_pass
from simulator.memory import FLAG, Config, MasterMemory
from simulator.relays import RelayState
from simulator.simulation import Simulation
from tests.c_master import CReading, library, ms

_READ = ctypes.CFUNCTYPE(None, ctypes.c_uint16, ctypes.POINTER(ctypes.c_uint8), ctypes.c_uint16)
_TRANSFER = ctypes.CFUNCTYPE(
    ctypes.c_bool, ctypes.POINTER(ctypes.c_uint8), ctypes.c_size_t, ctypes.POINTER(ctypes.c_uint8), ctypes.c_size_t
)
_WAIT = ctypes.CFUNCTYPE(None, ctypes.c_uint32)
_BYTE_S = 8e-6  # at 1 MHz
_IDLE_PAIR = b"\xff"
_LINE_LOOK_S = 0.001
_MAX_FRAME = 600


class _Inputs(ctypes.Structure):
    _fields_ = (
        ("is_ready", ctypes.c_bool),
        ("is_drive_asked", ctypes.c_bool),
        ("is_shutdown_closed", ctypes.c_bool),
        ("link_permille", ctypes.c_uint16),
        ("hardware", ctypes.c_uint32),
    )


class _State(ctypes.Structure):
    _fields_ = (
        ("relays", ctypes.c_uint8),
        ("charging", ctypes.c_uint8),
        ("has_precharge_failed", ctypes.c_bool),
        ("is_charging", ctypes.c_bool),
        ("is_open", ctypes.c_bool),
        ("is_streaming", ctypes.c_bool),
        ("is_restarting", ctypes.c_bool),
        ("has_new_cells", ctypes.c_bool),
        ("relays_since_ms", ctypes.c_uint32),
        ("cells", ctypes.c_uint16 * N_PACKS),
    )


class _Frame(ctypes.Structure):
    _fields_ = (
        ("id", ctypes.c_uint32),
        ("is_extended", ctypes.c_bool),
        ("length", ctypes.c_uint8),
        ("data", ctypes.c_uint8 * 8),
    )


class _Can:
    """The C tables as the bus sees them."""

    def __init__(self, master: CVirtualMaster) -> None:
        self._master = master
        self.is_off = False

    @property
    def bit_rate(self) -> int:
        """The bit rate of the prescaler in force, 0 in bus-off."""
        return 0 if self.is_off else bit_rate(FIELDS["conf.can_brp"].unpack(self._master.memory.image)[0])

    def received(self, frame: CanFrame, now_s: float) -> None:
        """Take a frame."""
        self._master.can_received(frame, now_s)

    def due(self, now_s: float, _pass_s: float) -> Iterator[CanFrame]:
        """Yield the frames that are due."""
        return self._master.can_due(now_s)


class _Judged:
    """What tests ask of the protection and of the charging."""

    def __init__(self, state: _State) -> None:
        self._state = state

    @property
    def is_ok(self) -> bool:
        """The OK signal."""
        return not self._state.is_open

    @property
    def is_active(self) -> bool:
        """The charge relays are closed."""
        return bool(self._state.is_charging)

    @property
    def state(self) -> ChargingState:
        """The charging's state."""
        return ChargingState(self._state.charging)


class CVirtualMaster:
    """As `simulator.master.VirtualMaster`, from a boot to a reset."""

    def __init__(self, board: Board, now_s: float, reset_cause: int = 0) -> None:
        board.boots += 1
        self.board, self._boot_s = board, now_s
        self._c = library()
        self._c.port_new.restype = ctypes.c_void_p
        self._c.port_next.restype = ctypes.c_size_t
        self._c.port_can_next.restype = ctypes.c_bool
        self._c.port_command.restype = ctypes.c_uint8
        self.memory = MasterMemory()
        self._image = (ctypes.c_char * MASTER_SIZE).from_buffer(self.memory.image)
        self._read, self._write = _READ(self._read_eeprom), _READ(self._write_eeprom)
        self._port = ctypes.c_void_p(
            self._c.port_new(
                ctypes.byref(self._image), self._read, self._write, reset_cause, board.boots, board.latch.is_open
            )
        )
        self._config_image, self.config = b"", Config.from_image(self.memory.image)
        self._start_measuring(now_s)
        self._out = (ctypes.c_uint8 * _MAX_FRAME)()
        self._state = _State()
        self._slave_refresh_s = now_s
        self.can = _Can(self)
        self.protection = self.charging = _Judged(self._state)
        self.drive_requested = False
        self.is_shutdown_closed = True
        self.reset_due_s: float | None = None
        self._requests = 0
        self._read_state(now_s)

    def __del__(self) -> None:
        self._c.port_free(self._port)

    def _read_eeprom(self, address: int, data: ctypes.Array, length: int) -> None:
        ctypes.memmove(data, self.board.eeprom.read(address, length), length)

    def _write_eeprom(self, address: int, data: ctypes.Array, length: int) -> None:
        self.board.eeprom.write(address, bytes(data[:length]))

    def _ms(self, now_s: float) -> int:
        return ms(now_s - self._boot_s)

    def _read_state(self, now_s: float) -> None:
        had_new_cells = self._state.has_new_cells
        self._c.port_state(self._port, ctypes.byref(self._state))
        self._state.has_new_cells |= had_new_cells
        self.board.latch.is_open = self._state.is_open
        if self._state.is_restarting and self.reset_due_s is None:
            self.reset_due_s = now_s + RESET_DELAY_S

    # --- a pass

    def _start_measuring(self, now_s: float) -> None:
        self._measurement = MeasuringTask(self.memory, self.board, now_s)

    def _read_config(self) -> None:
        if self.memory.config != self._config_image:
            self._config_image, self.config = self.memory.config, Config.from_image(self.memory.image)

    def _inputs(self, *, is_ready: bool = False) -> _Inputs:
        return _Inputs(
            is_ready,
            self.drive_requested,
            self.is_shutdown_closed,
            min(max(int(self.board.link_share * 1000), 0), 0xFFFF),
            FLAG["i2c1"] * (not self.board.eeprom.worn_pages) | FLAG["can1"] * (self.can.bit_rate > 0),
        )

    def measure(self, now_s: float, dt_s: float, true_current_a: float) -> None:
        """Measure with the simulator's task, and let the C master do the rest of the pass."""
        self._read_config()
        reading = self._measurement.run(self.config, now_s, dt_s, true_current_a, self.charging.is_active)
        means = (ctypes.c_int32 * 255)(*self._measurement.new_means)
        inputs = self._inputs(is_ready=self._measurement.is_ready)
        self._c.port_step(
            self._port, self._ms(now_s), ctypes.byref(CReading.of(reading)), means,
            len(self._measurement.new_means), ctypes.byref(inputs),
        )  # fmt: skip
        self._read_state(now_s)
        if self._state.has_new_cells or now_s >= self._slave_refresh_s:
            self._slave_refresh_s, self._state.has_new_cells = now_s + SLAVE_REFRESH_S, False
            cells = [self._state.cells[k // CELLS_PER_PACK] >> k % CELLS_PER_PACK & 1 for k in range(N_CELLS)]
            self._measurement.reader.configure(np.array(cells, dtype=bool))

    # --- what is asked of a master

    @property
    def relay_state(self) -> RelayState:
        """Which side the relays connect the accumulator to."""
        return list(RelayState)[self._state.relays]

    @property
    def relays_since_s(self) -> float:
        """When they came to that."""
        return float(self._state.relays_since_ms) / 1000 + self._boot_s

    @property
    def has_precharge_failed(self) -> bool:
        """The vehicle's link did not reach its voltage in time."""
        return bool(self._state.has_precharge_failed)

    @property
    def fan_duty(self) -> float:
        """Duty of the fans, 0..1."""
        return self.memory.charger("fan_duty") / 255

    @property
    def is_streaming(self) -> bool:
        """The host has asked for telemetry."""
        return bool(self._state.is_streaming)

    def command(self, command: CommandId, argument: int, now_s: float) -> bool:
        """Carry out a command with a checked argument."""
        result = self._c.port_command(self._port, command, argument)
        self._read_state(now_s)
        return bool(result == Result.DONE)

    def store_config(self, now_s: float) -> bool:
        """Store the configuration in force, as a request on the line asks for it."""
        self._requests += 1
        self.receive(encode_frame(MessageType.STORE, self._requests, 0, b""), now_s)
        return True

    def lose_power(self, rng: np.random.Generator) -> None:
        """Lose power; the bytes of a page under way are on the chip already."""

    # --- the lines

    def receive(self, data: bytes, now_s: float) -> None:
        """Take bytes from the line."""
        self._c.port_received(self._port, self._ms(now_s), data, ctypes.c_size_t(len(data)))
        self._read_state(now_s)

    def next_frame(self, now_s: float) -> bytes | None:
        """Return the next frame for the free line."""
        length = self._c.port_next(self._port, self._ms(now_s), self._out)
        self._read_state(now_s)
        return bytes(self._out[:length]) if length else None

    def next_due_s(self, now_s: float) -> float:
        """Return when to ask again."""
        return math.inf if self._state.is_restarting else now_s + _LINE_LOOK_S

    def can_received(self, frame: CanFrame, now_s: float) -> None:
        """Take a frame from the bus."""
        data = (ctypes.c_uint8 * 8)(*frame.data)
        taken = _Frame(frame.can_id, frame.is_extended, len(frame.data), data)
        self._c.port_can_received(self._port, self._ms(now_s), ctypes.byref(taken))

    def can_due(self, now_s: float) -> Iterator[CanFrame]:
        """Yield the frames that the tables send now."""
        frame = _Frame()
        while self._c.port_can_next(self._port, self._ms(now_s), ctypes.byref(frame)):
            yield CanFrame(frame.id, frame.is_extended, bytes(frame.data[: frame.length]))


class CarWithCMaster(Simulation):
    """The team's own car with the master in C."""

    def _boot(self) -> None:
        self.master = CVirtualMaster(self.board, self.now_s, self._boot_cause)  # type: ignore[assignment]


class CWholeMaster(CVirtualMaster):
    """Nothing of the firmware is Python: the slaves are read in C, byte for byte over their pair."""

    def _start_measuring(self, now_s: float) -> None:
        self._bus_s = now_s
        self._transfer_bytes, self._wait_us = _TRANSFER(self._transfer), _WAIT(self._wait)
        inputs = (ctypes.c_uint8 * 12)(*self.board.chain.sensor_inputs)
        self._c.port_start_slaves(self._port, self._ms(now_s), inputs, self._transfer_bytes, self._wait_us)

    def _transfer(self, tx: ctypes.Array, tx_length: int, rx: ctypes.Array, rx_length: int) -> bool:
        self._bus_s += _BYTE_S * tx_length
        if tx_length:
            answer = self.board.chain.execute(bytes(tx[:tx_length]), self._bus_s)
        else:
            self.board.chain.wake(self._bus_s)
            answer = b""
        self._bus_s += _BYTE_S * rx_length
        if rx_length:
            ctypes.memmove(rx, answer[:rx_length].ljust(rx_length, _IDLE_PAIR), rx_length)
        return True

    def _wait(self, time_us: int) -> None:
        self._bus_s += time_us * 1e-6

    def measure(self, now_s: float, dt_s: float, true_current_a: float) -> None:
        """Give the samples of the current and the pair to C, which does the pass."""
        self._read_config()
        counts = samples_of_pass(self.board, dt_s, true_current_a).astype(np.uint16)
        samples = (ctypes.c_uint16 * len(counts)).from_buffer(counts)
        self._bus_s = now_s
        inputs = self._inputs()
        self._c.port_pass(
            self._port, self._ms(now_s), ms(dt_s), samples, ctypes.c_uint16(len(counts)), ctypes.byref(inputs)
        )
        self._read_state(now_s)


class CarWithWholeCMaster(Simulation):
    """The team's own car with a master of which everything is C."""

    def _boot(self) -> None:
        self.master = CWholeMaster(self.board, self.now_s, self._boot_cause)  # type: ignore[assignment]
