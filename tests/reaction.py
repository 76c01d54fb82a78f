"""A simulated car in virtual time for tests of reaction times: its bytes as a host reads them, and its own truth.

The truth is when a fault was put in and when the relays opened, of the simulation itself; what measures never sees it.
"""

from dataclasses import dataclass, field

import numpy as np

from firmware_protocol.framing import FrameDecoder, encode_frame
from firmware_protocol.memory_map import CONFIG
from firmware_protocol.messages import Command, CommandId, Write, encode_request
from simulator.accumulator import AccumulatorParameters
from simulator.bms_state import RelayState
from simulator.fault_kinds import FAULTS
from simulator.faults import FaultBoard
from simulator.loads import ConstantCurrent
from simulator.simulation import Simulation

LOAD_A = 20.0
CELL = 40
FAULTS_OF_STEPS = {  # what each step of the test does to the car
    "voltage-high": ("cell-voltage-stuck", 5.0),
    "voltage-low": ("cell-voltage-stuck", 1.0),
    "current-high": ("current-sensor-offset", 400.0),
    "current-low": ("current-sensor-offset", -400.0),
    "temperature-high": ("temperature-sensor-fault", 70.0),
    "temperature-low": ("temperature-sensor-fault", -30.0),
    "slave-lost": ("slave-lost", None),
    "wire-lost": ("sense-wire-open", None),
    "temperature-lost": ("temperature-sensor-open", None),
    "current-lost": ("current-sensor-open", None),
}


@dataclass
class Car:
    """A driving car; `frames` are (arrival [ns], raw), its host's clock runs at `clock_rate` of the master's."""

    seed: int
    ts_ms: int = 40
    clock_rate: float = 1.0
    late_s: float = 0.004  # mean of what a frame waits before it is read
    soc: float = 0.8
    frames: list[tuple[int, bytes]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)
        self.simulation = Simulation(AccumulatorParameters(start_soc=self.soc), seed=self.seed)
        self.faults = FaultBoard(self.simulation)
        self.offset_s = float(self.rng.uniform(0, 1e5))
        self._decoder = FrameDecoder()
        self._arrived_ns = 0
        self._sequence = 0
        self.simulation.serial_out = self._take
        self.simulation.set_load(ConstantCurrent(LOAD_A))
        self.simulation.run_until(1.0)
        self.simulation.receive(b"x")
        self.request(Write(CONFIG["telemetry_period"].offset, self.ts_ms.to_bytes(2, "little")))
        self.run(4.0)
        assert self.simulation.master.relay_state is RelayState.VEHICLE

    @property
    def config(self) -> bytes:
        """In force."""
        return bytes(self.simulation.master.image[:420])

    def request(self, request) -> None:
        """Send one, without looking at the answer."""
        kind, body = encode_request(request)
        self._sequence += 1
        self.simulation.receive(encode_frame(kind, self._sequence, 0, body))

    def run(self, seconds: float) -> None:
        """Let time pass."""
        self.simulation.run_until(self.simulation.now_s + seconds)

    def react(self, step: str, within_s: float = 5.0) -> tuple[float, list[tuple[int, bytes]]]:
        """Do a step at a random phase; the true reaction time [s], and the frames from before it to after it."""
        simulation = self.simulation
        self.run(0.5 + float(self.rng.random()))
        first = len(self.frames) - 8
        name, value = FAULTS_OF_STEPS[step]
        target = {"cell": CELL, "pack": CELL // 12, "none": 0}[FAULTS[name].target.value]
        injected_s = simulation.now_s
        self.faults.inject(name, target, value)
        while simulation.master.relay_state is not RelayState.OPEN and simulation.now_s < injected_s + within_s:
            self.run(0.001)
        opened_s = simulation.now_s
        self.run(0.3)
        seen = self.frames[first:]
        self.faults.clear_all()
        self.run(2.5)
        self.request(Command(CommandId.CLEAR_FAULTS, 0))
        self.run(2.5)
        return opened_s - injected_s, seen

    def _take(self, data: bytes) -> None:
        late_s = float(self.rng.exponential(self.late_s))
        read_s = self.offset_s + self.clock_rate * self.simulation.now_s + late_s
        self._arrived_ns = max(self._arrived_ns, round(read_s * 1e9))
        self.frames += [(self._arrived_ns, item.raw) for item in self._decoder.feed(data)]
