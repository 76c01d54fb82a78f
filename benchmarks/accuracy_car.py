"""Rows of the simulated car: a service that starts while it drives, and what it says of the SOC later."""

from __future__ import annotations

from typing import Final

import numpy as np

from app.estimation.filters.estimates import Estimates
from app.live.pipeline_factory import PipelineFactory
from app.sources.items import LinkChange, SerialItem
from firmware_protocol.framing import FrameDecoder
from simulator.library import find_scenario
from simulator.scenario_player import ScenarioPlayer
from simulator.simulation import Simulation

SEEDS: Final = (31, 32, 33)
STARTS_S: Final = (100.0, 300.0)  # in the scenario; the service starts at the next load after it
LOAD_A: Final = 50.0
LATER_S: Final = (60.0, 180.0)
GOAL: Final = 1.0  # after the first of them
EPOCH_NS: Final = 1_790_000_000 * 10**9
HEADER: Final = """| start under load, simulated car | goal | RMSE of the cells |
| --- | --- | --- |"""


class Listener:
    """A service that has just started, without anything learned before."""

    def __init__(self, player: ScenarioPlayer) -> None:
        assert isinstance(player.simulation, Simulation)  # the team's car
        self._player, self._car = player, player.simulation
        self._pipeline = PipelineFactory("fused").pipeline("serial", "car", predicts=False)
        self._pipeline.feed(LinkChange(self._now_ns, EPOCH_NS + self._now_ns, "rs232", "open"))
        self._decoder = FrameDecoder()
        self._estimates: Estimates | None = None
        self._car.serial_out = self._take
        self._car.receive(b"x")

    @property
    def _now_ns(self) -> int:
        return round(self._car.now_s * 1e9)

    def _take(self, data: bytes) -> None:
        for item in self._decoder.feed(data):
            output = self._pipeline.feed(SerialItem(self._now_ns, EPOCH_NS + self._now_ns, item), publishes=False)
            self._estimates = output.estimates or self._estimates
            self._pipeline.predict()

    def error_after(self, seconds: float) -> float:
        """Return the RMS error over the cells after so long [points]."""
        self._player.run(seconds)
        assert self._estimates is not None
        return float(100.0 * np.sqrt(np.mean((self._estimates.soc - self._car.accumulator.soc) ** 2)))


def judge(seed: int, start_s: float) -> list[float]:
    """Return the error after each of `LATER_S` [points]."""
    player = ScenarioPlayer(find_scenario("clean-endurance"), seed=seed, step_s=0.05)
    player.run(start_s)
    while player.simulation.current_a < LOAD_A:
        player.run(0.05)
    listener = Listener(player)
    return [listener.error_after(float(step_s)) for step_s in np.diff(LATER_S, prepend=0.0)]


def lines(errors: list[list[float]]) -> list[str]:
    """Return a row of Markdown for each of `LATER_S`: median and worst of the starts."""
    goals = [f"{GOAL:g}", *[""] * (len(LATER_S) - 1)]
    return [
        f"| after {after_s:g} s | {goal} | {np.median(points):.2f}/{points.max():.2f} |"
        for after_s, goal, points in zip(LATER_S, goals, np.array(errors).T, strict=True)
    ]
