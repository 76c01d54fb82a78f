"""The C master's pass of measuring on slaves of its own, beside the virtual master's task on others."""

import ctypes
from ctypes import POINTER, Structure, byref, c_bool, c_int32, c_size_t, c_uint8, c_uint16, c_uint32
from types import SimpleNamespace

import numpy as np

from firmware_protocol.memory_map import MASTER_SIZE, N_PACKS
from simulator.master import SLAVE_REFRESH_S
from simulator.measuring_task import MeasuringTask
from simulator.memory import Config, MasterMemory
from simulator.protection import Reading
from tests.c_master import DUE_S, CReading, image_of, ms
from tests.c_slaves import CReader, DamagedChain


class Inputs(Structure):
    """`vw_inputs_t`."""

    _fields_ = (
        ("reading", CReading),
        ("means", POINTER(c_int32)),
        ("n_means", c_uint8),
        ("is_ready", c_bool),
        ("is_drive_asked", c_bool),
        ("is_shutdown_closed", c_bool),
        ("link_permille", c_uint16),
        ("hardware", c_uint32),
    )


class Samples:
    """A current's converter that gives what it is told."""

    def __init__(self) -> None:
        self.counts = np.zeros(0)

    def sample(self, _current_a: float, n: int) -> np.ndarray:
        """Return the samples of a pass."""
        assert n == len(self.counts)
        return self.counts


class CMeasuring:
    """`vw_measuring` on simulated slaves, with the struct of a master of its own."""

    def __init__(self, library: ctypes.CDLL, chain: DamagedChain, config: Config, start_ms: int = 0) -> None:
        self._library, self.reader, self._start_ms = library, CReader(library, chain), start_ms
        self.reader.reads_at_once = True
        self.memory = self.reader.memory
        self.memory.config = image_of(config)
        self._image = (ctypes.c_char * MASTER_SIZE).from_buffer(self.memory.image)
        for name in ("inputs", "measuring"):
            getattr(library, f"size_of_{name}").restype = c_size_t
        library.vw_measuring_samples.restype, library.vw_measuring_bleed.restype = c_uint16, c_bool
        assert library.size_of_inputs() == ctypes.sizeof(Inputs)
        self._state = ctypes.create_string_buffer(library.size_of_measuring())
        self.inputs = Inputs()
        self.reader.start(0.0)
        library.vw_measuring_init(self._state, byref(self.reader.slaves), self._image, c_uint32(start_ms))

    def samples(self, counts: np.ndarray) -> int:
        """Give samples of the current; return how many were taken."""
        given = (c_uint16 * len(counts))(*map(int, counts))
        return self._library.vw_measuring_samples(self._state, given, c_uint16(len(counts)))

    def run(self, now_s: float, pass_ms: int) -> tuple[CReading, list[int], bool]:
        """Run a pass; return what it found: the reading, the new means, whether it has settled."""
        self.reader.now_s = now_s
        self._library.vw_measuring_run(self._state, byref(self.inputs), c_uint32(pass_ms), self._ms(now_s))
        return self.inputs.reading, self.inputs.means[: self.inputs.n_means], self.inputs.is_ready

    def bleed(self, cells: np.ndarray, now_s: float, *, is_now: bool) -> bool:
        """Have the cells' switches written, now or when it is time; return whether they were."""
        masks = [sum(1 << at for at in np.flatnonzero(row)) for row in cells.reshape(N_PACKS, 12)]
        of_packs = (c_uint16 * N_PACKS)(*masks)
        return self._library.vw_measuring_bleed(self._state, of_packs, c_bool(is_now), self._ms(now_s))

    def _ms(self, now_s: float) -> c_uint32:
        return c_uint32(ms(now_s) + self._start_ms & 0xFFFFFFFF)


class BothMeasuring:
    """The two, each with slaves to which the same happens."""

    def __init__(self, library: ctypes.CDLL, inputs: tuple[int, ...], config: Config, start_ms: int = 0) -> None:
        self.chains = (DamagedChain(inputs), DamagedChain(inputs))
        for chain in self.chains:
            chain.converters.sensor_v = np.linspace(1.35, 2.4, 96)
        self.converter = Samples()
        self.memory = MasterMemory()
        self.memory.config = image_of(config)
        board = SimpleNamespace(chain=self.chains[0], current_sensor=self.converter)
        self.python = MeasuringTask(self.memory, board, 0.0)  # type: ignore[arg-type]
        self.c = CMeasuring(library, self.chains[1], config, start_ms)
        self.config = config
        self._now_ms = self._passes = 0

    def use(self, config: Config) -> None:
        """Put a configuration in force."""
        self.config = config
        for memory in (self.memory, self.c.memory):
            memory.config = image_of(config)

    def bleed(self, cells: np.ndarray) -> None:
        """Write the cells' switches."""
        self.python.reader.configure(cells)
        assert self.c.bleed(cells, self._now_s, is_now=True)

    @property
    def _now_s(self) -> float:
        return self._now_ms / 1000 + self._passes * DUE_S

    def run(self, pass_ms: int, counts: np.ndarray) -> Reading:
        """Run a pass of both; everything that either knows is the same."""
        self._now_ms += pass_ms
        self._passes += 1
        now_s = self._now_s
        self.converter.counts = counts
        reading = self.python.run(self.config, now_s, pass_ms / 1000, 0.0, is_charging=False)
        assert self.c.samples(counts) == len(counts)
        found, means, is_ready = self.c.run(now_s, pass_ms)
        expected = CReading.of(reading)
        for name, _ in CReading._fields_:
            assert getattr(found, name) == getattr(expected, name), name
        assert means == self.python.new_means
        assert is_ready == self.python.is_ready
        assert self.c.memory.image == self.memory.image
        return reading


REFRESH_MS = round(SLAVE_REFRESH_S * 1000)
