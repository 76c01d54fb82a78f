"""The C driver of the slaves on the simulated slaves, packet by packet."""

import ctypes
from ctypes import POINTER, Structure, byref, c_bool, c_size_t, c_uint8, c_uint16, c_uint32, c_void_p
from pathlib import Path

import numpy as np

from firmware_protocol.ltc6804 import READ_CELLS, Command, decode_command
from firmware_protocol.memory_map import N_PACKS, SLAVE_OFFSET, SLAVE_SIZE
from simulator.slave import THESIS_SENSOR_INPUTS, SlaveChain
from tests.master_memory import MasterMemory

BYTE_S = 8e-6
_OTHER = (Command.RDAUXA, Command.RDAUXB, Command.RDSTATA, Command.RDSTATB)
_KINDS = (READ_CELLS, _OTHER, (Command.RDCFG,))
PACKETS = tuple(
    (kind, slave, at) for kind, n in ((0, 4), (1, 4), (2, 1)) for slave in range(N_PACKS) for at in range(n)
)
_PER_PACK16, _PER_PACK32 = c_uint16 * N_PACKS, c_uint32 * N_PACKS
_TRANSFER = ctypes.CFUNCTYPE(c_bool, c_void_p, POINTER(c_uint8), c_size_t, POINTER(c_uint8), c_size_t)
_WAIT = ctypes.CFUNCTYPE(None, c_void_p, c_uint32)


class Bus(Structure):
    _fields_ = (("context", c_void_p), ("transfer", _TRANSFER), ("wait_us", _WAIT))


class Slaves(Structure):
    _fields_ = (
        ("bus", POINTER(Bus)),
        ("slave", c_void_p),
        ("sensor_inputs", POINTER(c_uint8)),
        ("bleed", _PER_PACK16),
        ("open_wires", _PER_PACK16),
        ("failures", _PER_PACK16),
        ("is_silent", c_bool * N_PACKS),
        ("is_whole", c_bool),
        ("has_returned", c_bool),
        ("packets", c_uint32),
        ("packet_errors", c_uint32),
        ("failures_so_far", _PER_PACK16),
        ("bad_packets", _PER_PACK32),
        ("bad_before", _PER_PACK32),
        ("noisy_ms_left", c_uint32),
        ("phase", c_uint8),
        ("stage", c_uint8),
    )


class Balance(Structure):
    _fields_ = (
        ("cells", _PER_PACK16),
        ("is_active", c_bool),
        ("is_by_hand", c_bool),
        ("by_hand_until_ms", c_uint32),
    )


def load(path: Path) -> ctypes.CDLL:
    """Return the library, with what ctypes cannot know."""
    library = ctypes.CDLL(str(path))
    for name in ("pec15", "self_test_code", "adcv", "adow", "adax", "adstat", "cvst", "axst", "statst"):
        getattr(library, f"vw_ltc_{name}").restype = c_uint16
    library.vw_slaves_valid_cells.restype = c_uint16
    library.vw_slaves_cell_degc.restype = library.vw_slaves_sensor_degc.restype = ctypes.c_int8
    library.vw_slaves_start.restype = library.vw_slaves_read_voltages.restype = c_uint8
    library.vw_slaves_self_check.restype = library.vw_balance_choose.restype = c_bool
    library.size_of_slaves.restype = library.size_of_balance.restype = c_size_t
    assert (library.size_of_slaves(), library.size_of_balance()) == (ctypes.sizeof(Slaves), ctypes.sizeof(Balance))
    return library


class DamagedChain(SlaveChain):
    """Eight slaves; the answers named in `damaged` (kind, slave, group) lose a bit on their way."""

    def __init__(self, inputs: tuple[int, ...]) -> None:
        super().__init__(N_PACKS, np.random.default_rng(1), inputs)
        self.damaged: frozenset[tuple[int, int, int]] = frozenset()
        self.converters.cell_v = 3.0 + 0.01 * np.arange(96)
        self.converters.sensor_v = np.linspace(1.29, 2.46, 96)

    def execute(self, packet: bytes, now_s: float) -> bytes:
        answer = super().execute(packet, now_s)
        command, address = decode_command(packet[:4])
        for kind, commands in enumerate(_KINDS):
            if command in commands and (kind, (address or 0) - 1, commands.index(command)) in self.damaged:
                return bytes((answer[0] ^ 0x10, *answer[1:]))
        return answer


class CReader:
    """The C driver, with the struct of a master of its own."""

    def __init__(self, library: ctypes.CDLL, chain: SlaveChain) -> None:
        self.library, self.chain, self.now_s = library, chain, 0.0
        self.memory = MasterMemory()
        self.spi_works = True
        self.log: list[tuple[float, bytes]] = []
        self.bus = Bus(None, _TRANSFER(self._transfer), _WAIT(self._wait))
        self.slaves = Slaves()
        self._struct = (c_uint8 * (N_PACKS * SLAVE_SIZE)).from_buffer(self.memory.image, SLAVE_OFFSET)
        library.vw_slaves_init(byref(self.slaves), byref(self.bus), self._struct)
        self._inputs = (c_uint8 * 12)(*chain.sensor_inputs)
        self.slaves.sensor_inputs = self._inputs

    def _transfer(self, _: object, tx: object, tx_length: int, rx: object, rx_length: int) -> bool:
        self.now_s += BYTE_S * tx_length
        sent = bytes(tx[:tx_length])
        self.log.append((self.now_s, sent))
        answer = self.chain.execute(sent, self.now_s) if sent else self.chain.wake(self.now_s) and b""
        self.now_s += BYTE_S * rx_length
        for at, byte in enumerate(answer[:rx_length].ljust(rx_length, b"\xff")):
            rx[at] = byte
        return self.spi_works

    def _wait(self, _: object, time_us: int) -> None:
        self.now_s += time_us * 1e-6

    def start(self, now_s: float) -> int:
        self.now_s = now_s
        return self.library.vw_slaves_start(byref(self.slaves))

    def begin(self, now_s: float, pass_ms: int = 20) -> None:
        self.now_s = now_s
        self.library.vw_slaves_begin(byref(self.slaves), c_uint32(pass_ms))

    def configure(self, bled: np.ndarray) -> None:
        masks = [sum(1 << at for at in np.flatnonzero(row)) for row in bled.reshape(N_PACKS, 12)]
        self.library.vw_slaves_configure(byref(self.slaves), _PER_PACK16(*masks))

    def read_voltages(self) -> int:
        return self.library.vw_slaves_read_voltages(byref(self.slaves))

    def read_temperatures(self) -> None:
        self.library.vw_slaves_read_temperatures(byref(self.slaves))

    def self_check(self) -> bool:
        return self.library.vw_slaves_self_check(byref(self.slaves))

    def temperatures_degc(self) -> list[int]:
        degc = self.library.vw_slaves_cell_degc
        return [degc(byref(self.slaves), c_uint8(pack), c_uint8(cell)) for pack in range(8) for cell in range(12)]

    def known(self) -> list[bool]:
        masks = [self.library.vw_slaves_valid_cells(byref(self.slaves), c_uint8(pack)) for pack in range(N_PACKS)]
        return cells_of(masks)


def cells_of(masks: object) -> list[bool]:
    """Return (96,) the cells of eight masks."""
    return [bool(mask >> cell & 1) for mask in masks for cell in range(12)]


def started(library: ctypes.CDLL, inputs: tuple[int, ...] = THESIS_SENSOR_INPUTS) -> CReader:
    """Return a driver whose slaves are configured."""
    reader = CReader(library, DamagedChain(inputs))
    reader.start(0.0)
    return reader
