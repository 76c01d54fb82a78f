"""A computer on the simulated master's line, in virtual time."""

from collections.abc import Callable

import numpy as np
import pytest

from firmware_protocol.config_image import default_image, with_value
from firmware_protocol.framing import BadFrame, Frame, FrameDecoder, encode_frame
from firmware_protocol.ltc6804 import Command
from firmware_protocol.memory_map import FIELDS, MASTER_SIZE
from firmware_protocol.messages import Data, EventMessage, Reply, Request, decode_message, encode_request
from simulator.accumulator import AccumulatorParameters
from simulator.eeprom import Eeprom
from simulator.simulation import Simulation
from simulator.slave import SlaveChain
from tests.ltc6804_packets import Configuration, write_packet
from tests.master_memory import MasterMemory


class Host:
    """Keeps what the master sends and when, and asks."""

    def __init__(self, eeprom: Eeprom | None = None, seed: int = 1, soc: float = 0.7) -> None:
        parameters = AccumulatorParameters(start_soc=soc, start_soc_spread=0.002)
        self.simulation = Simulation(parameters, eeprom=eeprom, seed=seed)
        self.simulation.serial_out = self._take
        self._decoder = FrameDecoder()
        self._sequence = 0
        self.arrivals: list[tuple[float, int]] = []
        self.frames: list[Frame] = []
        self.bad = 0
        self.events: list[EventMessage] = []
        self.replies: list[Reply] = []
        self.image = bytearray(MASTER_SIZE)

    @property
    def memory(self) -> MasterMemory:
        """The master's struct itself, not what the stream showed of it."""
        return MasterMemory(self.simulation.master.image)

    def _take(self, data: bytes) -> None:
        self.arrivals.append((self.simulation.now_s, len(data)))
        for item in self._decoder.feed(data):
            if isinstance(item, BadFrame):
                self.bad += 1
                continue
            self.frames.append(item)
            message = decode_message(item)
            if isinstance(message, EventMessage):
                self.events.append(message)
            elif isinstance(message, Reply):
                self.replies.append(message)
            elif isinstance(message, Data):
                for window in message.windows:
                    self.image[window.offset : window.offset + len(window.data)] = window.data

    def run(self, seconds: float) -> None:
        self.simulation.run_until(self.simulation.now_s + seconds)

    def send(self, request: Request, sequence: int | None = None) -> int:
        self._sequence = (self._sequence + 1) & 0xFF if sequence is None else sequence
        message_type, body = encode_request(request)
        self.simulation.receive(encode_frame(message_type, self._sequence, 0, body))
        return self._sequence

    def ask(self, request: Request) -> Reply:
        """Send a request and return its answer."""
        sequence = self.send(request)
        for _ in range(100):
            if self.replies and self.replies[-1].request_sequence == sequence:
                return self.replies[-1]
            self.run(0.01)
        raise AssertionError(f"no answer to {request}")

    def value(self, name: str) -> int:
        """Return a scalar of the struct as the stream showed it."""
        return FIELDS[name].unpack(self.image)[0]

    def config(self, **values: float) -> bytes:
        """Return the default configuration with some values changed, in units."""
        image = default_image()
        for name, value in values.items():
            image = with_value(image, name, value)
        return image


@pytest.fixture
def make_host() -> Callable[..., Host]:
    return Host


@pytest.fixture
def host(make_host: Callable[..., Host]) -> Host:
    host = make_host()
    host.run(1.0)
    return host


@pytest.fixture
def chain() -> SlaveChain:
    """Eight slaves that were configured once, every cell at a voltage of its own."""
    chain = SlaveChain(8, np.random.default_rng(1))
    chain.converters.cell_v = 3.0 + 0.01 * np.arange(96)
    chain.converters.sensor_v = np.full(96, 1.86)
    chain.execute(write_packet(Command.WRCFG, Configuration().to_bytes()), chain.wake(0.0))
    return chain
