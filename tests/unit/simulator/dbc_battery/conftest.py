import math

import numpy as np
import pytest

from simulator.accumulator import AccumulatorParameters
from simulator.dbc_battery.battery import DbcBattery
from simulator.dbc_battery.simulation import BatterySimulation
from simulator.loads import ConstantCurrent, Rest
from simulator.shape import Shape


class Listening:
    """A voice that says the whole of the readings every 0.1 s, as a frame for which only the time counts."""

    has_fd_frames = False

    def __init__(self) -> None:
        self.due_s = 0.0
        self.received: list[tuple[float, dict[str, np.ndarray]]] = []

    def begin(self, now_s: float) -> None:
        self.due_s = now_s

    def frames(self, now_s, readings):
        self.due_s = now_s + 0.1
        self.received.append((now_s, {kind: np.array(values) for kind, values in readings.items()}))
        return [(0x100, b"\0" * 8)]

    def last(self, kind: str) -> np.ndarray:
        return self.received[-1][1][kind]


class Rig:
    """A battery of 14, 6 and 10 cells with seven sensors."""

    def __init__(self, soc: float = 0.6, limits: dict[str, float] | None = None, capacity_ah: float = 5.0) -> None:
        self.voice = Listening()
        shape = Shape((14, 6, 10))
        sensors = (*(tuple(range(first, first + 5)) for first in range(0, 30, 5)), ())
        battery = DbcBattery(shape, sensors, capacity_ah, limits or {}, self.voice)
        parameters = AccumulatorParameters(n_cells=30, start_soc=soc, start_soc_spread=0.002)
        self.simulation = BatterySimulation(parameters, battery, seed=4)

    def run(self, for_s: float) -> None:
        self.simulation.run_until(self.simulation.now_s + for_s)

    def draw(self, amps: float, for_s: float = math.inf) -> None:
        self.simulation.set_load(ConstantCurrent(amps, for_s))

    def stop(self) -> None:
        self.simulation.set_load(Rest())


@pytest.fixture
def rig() -> Rig:
    return Rig()


@pytest.fixture
def make_rig() -> type[Rig]:
    return Rig
