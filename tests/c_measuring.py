"""The C master's pass of measuring on simulated slaves."""

import ctypes
from ctypes import POINTER, Structure, byref, c_bool, c_int32, c_size_t, c_uint8, c_uint16, c_uint32

import numpy as np

from firmware_protocol.memory_map import MASTER_SIZE, N_CELLS, N_PACKS
from simulator.slave import THESIS_SENSOR_INPUTS as INPUTS
from tests.c_master import CReading, image_of, ms
from tests.c_slaves import CReader, DamagedChain, cells_of
from tests.master_memory import Config


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


class CMeasuring:
    """`vw_measuring` on simulated slaves, with the struct of a master of its own."""

    def __init__(self, library: ctypes.CDLL, chain: DamagedChain, config: Config, start_ms: int = 0) -> None:
        self._library, self.reader, self._start_ms = library, CReader(library, chain), start_ms
        self.memory = self.reader.memory
        self.memory.config = image_of(config)
        self._image = (ctypes.c_char * MASTER_SIZE).from_buffer(self.memory.image)
        for name in ("inputs", "measuring"):
            getattr(library, f"size_of_{name}").restype = c_size_t
        library.vw_measuring_add_samples.restype, library.vw_measuring_write_bleeding.restype = c_uint16, c_bool
        assert library.size_of_inputs() == ctypes.sizeof(Inputs)
        self._state = ctypes.create_string_buffer(library.size_of_measuring())
        self.inputs = Inputs()
        self.reader.start(0.0)
        library.vw_measuring_init(self._state, byref(self.reader.slaves), self._image, c_uint32(start_ms))

    def samples(self, counts: np.ndarray) -> int:
        """Give samples of the current; return how many were taken."""
        given = (c_uint16 * len(counts))(*map(int, counts))
        return self._library.vw_measuring_add_samples(self._state, given, c_uint16(len(counts)))

    def run(self, now_s: float, pass_ms: int) -> tuple[CReading, list[int], bool]:
        """Run a pass; return what it found: the reading, the new means, whether it has settled."""
        self.reader.now_s = now_s
        self._library.vw_measuring_run(self._state, byref(self.inputs), c_uint32(pass_ms), self._ms(now_s))
        return self.inputs.reading, self.inputs.means[: self.inputs.n_means], self.inputs.is_ready

    def known(self) -> np.ndarray:
        """Return which cells have a voltage: the masks behind two pointers, a flag and the filtered voltages."""
        masks = np.frombuffer(self._state, "<u2", N_PACKS, offset=3 * ctypes.sizeof(c_size_t) + N_CELLS * 8)
        return np.array(cells_of(masks.tolist()))

    def bleed(self, cells: np.ndarray, now_s: float, *, is_now: bool) -> bool:
        """Have the cells' switches written, now or when it is time; return whether they were."""
        masks = [sum(1 << at for at in np.flatnonzero(row)) for row in cells.reshape(N_PACKS, 12)]
        of_packs = (c_uint16 * N_PACKS)(*masks)
        return self._library.vw_measuring_write_bleeding(self._state, of_packs, c_bool(is_now), self._ms(now_s))

    def _ms(self, now_s: float) -> c_uint32:
        return c_uint32(ms(now_s) + self._start_ms & 0xFFFFFFFF)


class Passes:
    """Passes one after the other, of slaves to which anything may happen between them."""

    def __init__(
        self, library: ctypes.CDLL, config: Config, inputs: tuple[int, ...] = INPUTS, start_ms: int = 0
    ) -> None:
        self.chain = DamagedChain(inputs)
        self.chain.converters.sensor_v = np.linspace(1.35, 2.4, 96)
        self.c = CMeasuring(library, self.chain, config, start_ms)
        self.memory = self.c.memory
        self.means: list[int] = []
        self._now_ms = 0

    def use(self, config: Config) -> None:
        """Put a configuration in force."""
        self.memory.config = image_of(config)

    def bleed(self, cells: np.ndarray) -> None:
        """Write the cells' switches."""
        assert self.c.bleed(cells, self._now_ms / 1000, is_now=True)

    def run(self, pass_ms: int, counts: np.ndarray) -> CReading:
        """Run a pass."""
        self._now_ms += pass_ms
        assert self.c.samples(counts) == len(counts)
        reading, self.means, _ = self.c.run(self._now_ms / 1000, pass_ms)
        return reading
