"""Races of the virtual car with their predictions, and what the simulator's physics does from the same moments."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Set
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.estimators import make_estimator
from app.estimation.prediction.energy_target import RacePlan
from app.estimation.prediction.power import TIME_LIMIT_S, PowerLimit, TimeToTrip
from app.live.pipeline import Pipeline
from app.live.prediction import Predictor
from app.sources.items import LinkChange, SerialItem
from app.sources.master.source import MasterSource
from app.telemetry import Prediction, ProtectionLimits, Snapshot
from firmware_protocol.framing import FrameDecoder
from firmware_protocol.memory_map import N_CELLS
from simulator.accumulator import Accumulator
from simulator.library import find_scenario
from simulator.loads import Phase
from simulator.scenario_player import ScenarioPlayer
from simulator.simulation import Simulation

CELL = "samsung-25r-10p"
STEP_S = 0.05  # step of the race
AHEAD_STEP_S = 0.1  # step of the physics run ahead
LONG_STEP_S = 1.0  # over minutes at a constant current
POWER_ROUNDS = 11  # rounds of bisection
LAPS_REPEATED = 5  # laps after the race's end, like its last; all where it has fewer
EMPTY_SOC = 0.0

Foretold = tuple[str, float, float, float, float]  # name, low, median, high, truth


@dataclass(frozen=True)
class Probe:
    """A moment: what was foretold and the true state."""

    at_s: float
    prediction: Prediction
    limits: ProtectionLimits
    state: Any
    fan_duty: float


@dataclass
class RaceRun:
    """One race: its probes, and per step of the physics its current and the lap, fractions included."""

    scenario: str
    seed: int
    every_s: float
    seconds: float = 1e9
    plan: RacePlan | None = None  # with it the line is marked at the end of each lap
    probes: list[Probe] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.player = ScenarioPlayer(find_scenario(self.scenario), seed=self.seed, step_s=STEP_S)
        simulation = self.player.simulation
        assert isinstance(simulation, Simulation)  # the team's car
        self.simulation = simulation
        self.accumulator: Accumulator = self.simulation.accumulator
        cell = load_cell(CELL)
        predictor = Predictor(cell, (12,) * 8)
        if self.plan is not None:
            predictor.set_plan(self.plan)
        self._pipeline = Pipeline(
            MasterSource("serial", "simulated"),
            lambda: make_estimator("fused", cell, N_CELLS),
            filter_name="fused",
            cell_name=CELL,
            predictor=predictor,
        )
        self._decoder = FrameDecoder()
        self._snapshot: Snapshot | None = None
        self._history: list[tuple[float, float, int, bool]] = []
        self._play()

    @property
    def _now_ns(self) -> int:
        return round(self.simulation.now_s * 1e9)

    def _take(self, data: bytes) -> None:
        for item in self._decoder.feed(data):
            output = self._pipeline.feed(SerialItem(self._now_ns, self._now_ns, item))
            self._pipeline.predict()
            self._snapshot = output.snapshot or self._snapshot

    def _play(self) -> None:
        simulation = self.simulation
        self._pipeline.feed(LinkChange(0, 0, "rs232", "open"))
        simulation.serial_out = self._take
        advance = simulation._advance_accumulator

        def advance_and_note(dt_s: float) -> None:
            advance(dt_s)
            state = simulation.load.state(simulation.load_time_s)
            is_driving = state.phase == Phase.DRIVING
            if self.plan is not None and self._history and 0 < self._history[-1][2] < state.lap:
                self._pipeline.mark_lap()
            self._history.append((simulation.now_s, simulation.current_a, state.lap, is_driving))

        simulation._advance_accumulator = advance_and_note  # type: ignore[method-assign]
        self.player.run(1.0)
        simulation.receive(b"x")
        while not self.player.is_over and simulation.now_s < self.seconds:
            self.player.run(self.every_s)
            self._probe()
        self.time_s, self.current_a, self.lap, self.is_driving = (np.array(v) for v in zip(*self._history, strict=True))

    def _probe(self) -> None:
        snapshot = self._snapshot
        if snapshot is None or snapshot.prediction is None or snapshot.limits is None:
            return
        master = self.simulation.master
        fan_duty = 0.0 if master is None else master.fan_duty
        state = state_of(self.accumulator)
        self.probes.append(Probe(self.simulation.now_s, snapshot.prediction, snapshot.limits, state, fan_duty))

    def future(self, at_s: float) -> Iterator[tuple[float, float]]:
        """Yield current [A] and lap, fractions included, each AHEAD_STEP_S: the race, then its last laps repeated."""
        starts = [self.time_s[(self.lap == n) & self.is_driving][0] for n in np.unique(self.lap[self.is_driving])]
        every = round(AHEAD_STEP_S / STEP_S)
        driven = np.interp(self.time_s, starts, np.arange(len(starts), dtype=np.float64))  # laps so far
        now = int(np.searchsorted(self.time_s, at_s))
        end = int(np.searchsorted(self.time_s, starts[-1]))
        repeated = min(LAPS_REPEATED, len(starts) - 1)
        times = 20 * LAPS_REPEATED // repeated
        first = int(np.searchsorted(self.time_s, starts[-1 - repeated]))
        current = np.concatenate((self.current_a[now:end], np.tile(self.current_a[first:end], times)))
        again = driven[first:end] - driven[first]
        laps = np.concatenate((driven[now:end], *(driven[end - 1] + repeated * k + again for k in range(times))))
        current = current[: len(current) // every * every].reshape(-1, every).mean(axis=1)
        yield from zip(current.tolist(), laps[::every].tolist(), strict=False)


def state_of(accumulator: Accumulator) -> list[dict[str, Any]]:
    """Return a copy of all numbers of an accumulator, its cells and its heat."""
    parts = (accumulator, accumulator._cells, accumulator._thermal)
    return [
        {name: np.copy(value) for name, value in vars(part).items() if isinstance(value, (np.ndarray, float, int))}
        for part in parts
    ]


def put_state(accumulator: Accumulator, kept: list[dict[str, Any]]) -> None:
    """Write the numbers back, into the same arrays, of which some are views of others."""
    for part, values in zip((accumulator, accumulator._cells, accumulator._thermal), kept, strict=True):
        for name, value in values.items():
            current = getattr(part, name)
            if not isinstance(current, np.ndarray):
                setattr(part, name, value.item())
            elif current.flags.writeable:
                current[...] = value
    accumulator._sum_v = accumulator._outlet_v = None


def fly_ahead(run: RaceRun, probe: Probe, only: Set[str] | None = None) -> Iterator[Foretold]:
    """Yield what was foretold at a moment, and what the physics then does; `only` of these names, None = of all."""
    prediction = probe.prediction

    def is_asked(*names: str) -> bool:
        return only is None or not only.isdisjoint(names)

    if prediction.power is not None:
        for side, sign in (("discharge", 1.0), ("charge", -1.0)):
            for limit in getattr(prediction.power, side):
                name = f"power {side} {limit.horizon_s:2g} s"
                if limit.reason != "relays" and is_asked(name):
                    truth = _power_w(run, probe, limit, sign)
                    yield name, limit.low_w, limit.power_w, limit.high_w, truth
    for kind, current_a, trips in (
        ("at load", prediction.load_a, prediction.to_trip),
        ("at full current", probe.limits.discharge_max_a, prediction.to_trip_full),
    ):
        for trip in trips:
            name = f"{trip.limit} {kind} [s]"
            if current_a and is_asked(name):
                truth = _seconds(run, probe, float(current_a), trip)
                values = (min(s, TIME_LIMIT_S) for s in (trip.low_s, trip.seconds, trip.high_s))
                low, middle, high = values
                yield name, low, middle, high, truth
    if is_asked("energy left", "laps left"):
        yield from _energy_and_laps(run, probe)


def possible_lap_wh(run: RaceRun, probe: Probe, reserve_soc: float) -> float:
    """The energy of each remaining lap that just leaves the reserve in the first cell, by the secant method [Wh].

    The race is driven on from there to its end with the currents that it had, all scaled by one factor.
    """
    to_go = run.lap.max() - run.lap[np.searchsorted(run.time_s, probe.at_s)] + 1

    def end_at(scale: float) -> tuple[float, float]:
        step, energy_wh = _ahead(run, probe), 0.0
        every = round(AHEAD_STEP_S / STEP_S)
        current = run.current_a[np.searchsorted(run.time_s, probe.at_s) :]
        for current_a in current[: len(current) // every * every].reshape(-1, every).mean(axis=1).tolist():
            accumulator = step(AHEAD_STEP_S, scale * current_a)
            energy_wh += accumulator.voltage_v * scale * current_a * AHEAD_STEP_S / 3600
        return float(accumulator.soc.min()) - reserve_soc, energy_wh / float(to_go)

    scale, other = 1.0, 1.1
    spare, _lap_wh = end_at(scale)
    for _ in range(4):
        spare_other, lap_other = end_at(other)
        if abs(spare_other) < 5e-4:
            return lap_other
        following = other - spare_other * (other - scale) / (spare_other - spare)
        (scale, spare), other = (other, spare_other), following
    return lap_other


def _ahead(run: RaceRun, probe: Probe) -> Callable[[float, float], Accumulator]:
    put_state(run.accumulator, probe.state)

    def step(dt_s: float, current_a: float) -> Accumulator:
        run.accumulator.step(dt_s, current_a, fan_duty=probe.fan_duty)
        return run.accumulator

    return step


def _is_within(run: RaceRun, probe: Probe, accumulator: Accumulator) -> bool:
    limits, v = probe.limits, accumulator.terminal_voltage_v
    is_voltage = (
        v.min() >= limits.cell_voltage_min_v if accumulator.current_a > 0 else v.max() <= limits.cell_voltage_max_v
    )
    is_soc = accumulator.soc.min() >= 0.0 if accumulator.current_a > 0 else accumulator.soc.max() <= 1.0
    return bool(is_voltage and is_soc and accumulator.temperature_degc.max() <= limits.temperature_max_degc)


def _power_w(run: RaceRun, probe: Probe, limit: PowerLimit, sign: float) -> float:
    """The power held throughout the horizon at the largest constant current within the limits, by bisection [W]."""
    full_a = probe.limits.discharge_max_a if sign > 0 else -probe.limits.discharge_min_a
    held_w, low_a, high_a, current_a = 0.0, 0.0, full_a, full_a
    for _ in range(POWER_ROUNDS):
        watts = _held_w(run, probe, limit.horizon_s, sign * current_a)
        if watts is None:
            high_a = current_a
        else:
            held_w, low_a = watts, current_a
        if low_a == full_a:
            break
        current_a = 0.5 * (low_a + high_a)
    return held_w


def _held_w(run: RaceRun, probe: Probe, horizon_s: float, current_a: float) -> float | None:
    """The least power at a constant current [W]; None where it passes a limit."""
    step, least_w = _ahead(run, probe), float("inf")
    for _ in range(round(horizon_s / AHEAD_STEP_S)):
        accumulator = step(AHEAD_STEP_S, current_a)
        if not _is_within(run, probe, accumulator):
            return None
        least_w = min(least_w, accumulator.voltage_v * abs(current_a))
    return least_w


def _seconds(run: RaceRun, probe: Probe, current_a: float, trip: TimeToTrip) -> float:
    """When the limit is met at the constant current; at most the longest that is looked at [s]."""
    step, limits = _ahead(run, probe), probe.limits
    dt_s = AHEAD_STEP_S if trip.high_s < 60.0 else LONG_STEP_S

    def passed(a: Accumulator) -> bool:
        return bool(
            {
                "v_min": a.terminal_voltage_v.min() < limits.cell_voltage_min_v,
                "v_max": a.terminal_voltage_v.max() > limits.cell_voltage_max_v,
                "soc_min": a.soc.min() < EMPTY_SOC,
                "soc_max": a.soc.max() > 1.0,
                "temperature_max": a.temperature_degc.max() > limits.temperature_max_degc,
            }[trip.limit]
        )

    elapsed_s = 0.0
    while elapsed_s < TIME_LIMIT_S:
        accumulator = step(dt_s, current_a)
        if passed(accumulator):
            break
        if accumulator.soc.min() < -0.02 or accumulator.soc.max() > 1.02:
            return TIME_LIMIT_S  # physics ends here, and the limit was not met
        elapsed_s += dt_s
    return elapsed_s


def _energy_and_laps(run: RaceRun, probe: Probe) -> Iterator[Foretold]:
    """Drive on until the first cell is empty."""
    prediction, step = probe.prediction, _ahead(run, probe)
    energy_wh, lap, first_lap = 0.0, 0.0, None
    for current_a, lap_now in run.future(probe.at_s):
        first_lap = lap_now if first_lap is None else first_lap
        lap = lap_now
        accumulator = step(AHEAD_STEP_S, current_a)
        energy_wh += accumulator.voltage_v * current_a * AHEAD_STEP_S / 3600
        if accumulator.soc.min() <= EMPTY_SOC:
            break
    else:
        return
    if first_lap is None:
        return
    if prediction.energy_left_wh is not None and prediction.load_a is not None and probe.at_s > 60.0:
        low, high = prediction.energy_left_low_wh, prediction.energy_left_high_wh
        yield "energy left", float(low or 0.0), prediction.energy_left_wh, float(high or 0.0), energy_wh
    if prediction.laps is not None:
        laps = prediction.laps
        yield "laps left", laps.low, laps.laps, laps.high, lap - first_lap
