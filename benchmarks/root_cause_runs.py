"""Runs with a hidden fault for `benchmarks.root_cause`: drawn at random, simulated, recorded into a real session file.

The simulated car's bytes go through the service's own decoder, pipeline and recorder, in one process and in virtual
time: RS232 and CAN as a pit laptop hears them. What the fault was is kept by the caller, never in the file.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.live.pipeline_factory import PipelineFactory
from app.sessions.recording.auto_recorder import AutoRecorder
from app.sources.items import CanFault, CanItem, Item, LinkChange, SerialItem
from app.telemetry import BusState
from firmware_protocol.config_image import default_image
from firmware_protocol.framing import FrameDecoder
from firmware_protocol.memory_map import CAN_ID_EXTENDED, N_CELLS, N_PACKS
from simulator.can_bus import PASSIVE, WARNING, CanFrame
from simulator.fault_kinds import FAULTS, Target
from simulator.scenario import ActionPlan, FaultPlan, PhasePlan, Scenario, Start
from simulator.scenario_player import ScenarioPlayer
from simulator.slave import THESIS_SENSOR_INPUTS
from tests.fake_clock import FunctionClock

EPOCH_NS = 1_790_000_000 * 10**9
START_NS = 1000 * 10**9
STEP_S = 0.05  # of the physics
STREAM_S = 0.2  # then the service asks for telemetry
JUDGE_NS = 5 * 10**9  # between two predictions, which nothing here reads and which cost the most
TURN_S = 0.05  # of virtual time between two looks at the lines
HEALTHY = ("clean race", "clean acceleration", "clean charging", "clean rest", "clean pit stop")
ABUSES = ("overload", "accumulator-cold", "accumulator-empty")  # what trips without any fault


@dataclass(frozen=True)
class Case:
    """One run: what is wrong (`fault`), where and how much, and the scenario that plays it."""

    fault: str
    seed: int
    cell: int | None
    pack: int | None
    value: float | None
    at_s: float
    scenario: Scenario

    @property
    def name(self) -> str:
        """A name for the file."""
        return f"{self.fault.replace(' ', '-')}-{self.seed}"


def cases(seed: int) -> Iterator[Case]:
    """Yield a run of every fault, of every abuse, and of a healthy car in every situation."""
    for k, fault in enumerate((*FAULTS, *ABUSES, *HEALTHY)):
        yield draw(fault, seed, np.random.default_rng((seed, k)))


def draw(fault: str, seed: int, rng: np.random.Generator) -> Case:
    """Draw cell, time and magnitude of one run."""
    kind = FAULTS.get(fault)
    value = None if kind is None else _value(fault, rng)
    target = 0
    cell = pack = None
    if kind is not None and kind.target is Target.CELL:
        target = cell = int(rng.integers(N_CELLS))
        pack = target // (N_CELLS // N_PACKS)
    elif kind is not None and kind.target is Target.PACK:
        target = pack = int(rng.integers(N_PACKS))
    start, phases, at_s, for_s, actions = _situation(fault, rng)
    faults = () if kind is None else (FaultPlan(at_s, fault, target, value, None if kind.is_instant else for_s),)
    scenario = Scenario(
        fault,
        fault,
        "",
        seed * 100 + 1,
        False,
        start,
        "passive",
        THESIS_SENSOR_INPUTS,
        default_image(),
        tuple(phases),
        faults,
        tuple(actions),
        (),
    )
    return Case(fault, seed, cell, pack, value, at_s, scenario)


def _value(fault: str, rng: np.random.Generator) -> float | None:
    """A magnitude at random: at least what disturbs a run, at most what the simulator allows."""

    def log(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    def either(first: tuple[float, float], second: tuple[float, float]) -> float:
        return float(rng.uniform(*(first if rng.random() < 0.5 else second)))

    draws: dict[str, Callable[[], float]] = {
        "cell-voltage-stuck": lambda: either((0.5, 2.4), (3.2, 5.0)),
        "cell-voltage-noisy": lambda: log(0.03, 0.5),
        "temperature-sensor-fault": lambda: either((-40.0, 10.0), (48.0, 110.0)),
        "joint-resistance-high": lambda: log(1.0, 25.0),
        "capacity-low": lambda: rng.uniform(0.35, 0.8),
        "cell-resistance-high": lambda: log(1.5, 8.0),
        "self-discharge-high": lambda: log(4.0, 40.0),
        "external-heating": lambda: log(20.0, 300.0),
        "cooling-failed": lambda: rng.uniform(0.85, 1.0),
        "ambient-temperature": lambda: either((-25.0, 0.0), (48.0, 75.0)),
        "slave-adc-fault": lambda: float(rng.integers(16)),
        "slave-reference-drift": lambda: either((-6.0, -0.8), (0.8, 6.0)),
        "isospi-noise": lambda: log(1e-4, 2e-2),
        "current-sensor-offset": lambda: either((-60.0, -3.0), (3.0, 60.0)),
        "dc-link-load": lambda: log(300.0, 5000.0),
        "master-watchdog-reset": lambda: rng.uniform(0.1, 3.0),
        "master-supply-lost": lambda: rng.uniform(0.3, 5.0),
        "serial-noise": lambda: log(5e-4, 5e-2),
        "can-noise": lambda: log(3e-3, 5e-2),
        "can-babbling-node": lambda: rng.uniform(0.7, 1.0),
        "charger-over-temperature": lambda: rng.uniform(2500.0, 5000.0),
    }
    return float(draws[fault]()) if fault in draws else None


_Situation = tuple[Start, list[PhasePlan], float, float | None, list[ActionPlan]]


def _situation(fault: str, rng: np.random.Generator) -> _Situation:
    """Return start, phases, when the fault begins and for how long, and what the crew does."""
    at_s = float(rng.uniform(40.0, 90.0))
    soc, degc = float(rng.uniform(0.55, 0.9)), float(rng.uniform(18.0, 30.0))
    drive = PhasePlan("endurance", for_s=at_s + 45.0)
    halt = PhasePlan("idle", for_s=4.0)  # nobody switches high voltage off at full power
    started = ActionPlan(4.0, "charge-start", None)

    def charge(length_s: float) -> list[PhasePlan]:
        return [PhasePlan("charge-by-hand", for_s=length_s)]

    match fault:
        case "capacity-low":
            return Start(float(rng.uniform(0.3, 0.5)), ambient_degc=degc), [PhasePlan("endurance", for_s=500)], 0.0, None, []  # fmt: skip  # noqa: E501
        case "self-discharge-high":
            load = "rest" if rng.random() < 0.5 else "endurance"
            return Start(soc, ambient_degc=degc), [PhasePlan(load, for_s=at_s + 240.0)], at_s, None, []
        case "external-heating" | "cell-resistance-high":
            return Start(soc, ambient_degc=degc), [PhasePlan("endurance", for_s=at_s + 150.0)], at_s, None, []
        case "cooling-failed":
            return Start(0.95, ambient_degc=float(rng.uniform(28, 34))), [PhasePlan("endurance", for_s=600)], at_s, None, []  # fmt: skip  # noqa: E501
        case "ambient-temperature":
            return Start(soc, ambient_degc=degc), [PhasePlan("endurance", for_s=at_s + 300.0)], at_s, None, []
        case "current-sensor-offset":
            laps = PhasePlan("endurance", for_s=at_s + 30.0)
            return Start(soc, ambient_degc=degc), [laps, halt, PhasePlan("rest", for_s=30.0)], at_s, None, []
        case "precharge-failed" | "dc-link-load":
            wait = PhasePlan("rest", for_s=20.0)
            cleared = ActionPlan(42.0, "clear-faults", None)
            return Start(soc, ambient_degc=degc), [wait, PhasePlan("endurance", for_s=50.0)], 0.0, 40.0, [cleared]
        case "dc-link-discharge-failed":
            stop = PhasePlan("rest", for_s=float(rng.uniform(15.0, 40.0)))
            return (
                Start(soc, ambient_degc=degc),
                [PhasePlan("endurance", for_s=50.0), halt, stop, PhasePlan("endurance", for_s=30.0)],
                30.0,
                None,
                [],
            )
        case "charger-over-temperature":
            return Start(0.5, ambient_degc=degc), charge(at_s + 250.0), at_s, None, [started]
        case "charger-input-voltage" | "charger-no-battery" | "charger-silent" | "charger-hardware-fault":
            return Start(0.5, ambient_degc=degc), charge(at_s + 25.0), at_s, None, [started]
        case "can-master-bus-off" | "can-short" | "can-babbling-node" | "can-noise":
            return Start(0.5, ambient_degc=degc), charge(at_s + 25.0), at_s, None, [started]
        case "overload":
            phase = PhasePlan("constant", for_s=20.0, current_a=float(rng.uniform(203.0, 260.0)))
            return Start(soc, ambient_degc=degc), [PhasePlan("endurance", for_s=at_s), phase], 0.0, None, []
        case "accumulator-cold":
            return Start(soc, ambient_degc=float(rng.uniform(-25.0, -17.0))), [drive], 0.0, None, []
        case "accumulator-empty":
            phase = PhasePlan("constant", for_s=600.0, current_a=float(rng.uniform(60.0, 140.0)))
            return Start(float(rng.uniform(0.05, 0.15)), ambient_degc=degc), [phase], 0.0, None, []
        case "clean acceleration":
            return Start(soc, ambient_degc=degc), [PhasePlan("acceleration"), PhasePlan("rest", for_s=60.0)], 0.0, None, []  # fmt: skip  # noqa: E501
        case "clean charging":
            return Start(soc, ambient_degc=degc), charge(150.0), 0.0, None, [started]
        case "clean rest":
            return Start(soc, ambient_degc=degc), [PhasePlan("rest", for_s=300.0)], 0.0, None, []
        case "clean pit stop":
            stop = PhasePlan("rest", for_s=30.0)
            laps = PhasePlan("endurance", laps=1)
            return Start(soc, ambient_degc=degc), [laps, stop, laps, stop], 0.0, None, []
        case "clean race":
            return Start(0.95, ambient_degc=degc), [PhasePlan("endurance", for_s=500.0)], 0.0, None, []
    return Start(soc, ambient_degc=degc), [drive], at_s, None, []


class _Listener:
    """The pit laptop's CAN adapter: one that hands on data frames and error frames, as SocketCAN does."""

    is_listening_only = False
    bit_rate = 500_000

    def __init__(self, take: Callable[[CanFrame, float], None]) -> None:
        self._take = take

    def can_received(self, frame: CanFrame, now_s: float) -> None:
        """Hand a frame on."""
        self._take(frame, now_s)


def record(case: Case, folder: Path, factory: PipelineFactory) -> Path:
    """Play the run and return its session file; what is there already is not made anew."""
    target = folder / f"{case.name}.sqlite"
    if target.exists():
        return target
    player = ScenarioPlayer(case.scenario, seed=case.scenario.seed, step_s=STEP_S)
    simulation = player.simulation
    clock = FunctionClock(
        lambda: START_NS + round(simulation.now_s * 1e9), lambda: EPOCH_NS + round(simulation.now_s * 1e9)
    )
    work = folder / f".{case.name}"
    recorder = AutoRecorder(work / "sessions", automatic=True, on_event=lambda event: None, clock=clock)
    pipeline = factory.pipeline("simulator", "recorded", "recorded")
    decoder = FrameDecoder()

    def take(item: Item) -> None:
        recorder.on_item(item)
        output = pipeline.feed(item)
        recorder.on_output(output)
        for event in output.events:
            recorder.on_event(event)
        if output.snapshot is not None:
            published[0] = item.t_mono_ns
            if item.t_mono_ns - judged[0] >= JUDGE_NS:
                judged[0] = item.t_mono_ns
                pipeline.predict()

    def serial(data: bytes) -> None:
        for frame in decoder.feed(data):
            take(SerialItem(clock.monotonic_ns(), clock.wall_ns(), frame))

    def can(frame: CanFrame, now_s: float) -> None:
        can_id = frame.can_id | (CAN_ID_EXTENDED if frame.is_extended else 0)
        take(CanItem(clock.monotonic_ns(), clock.wall_ns(), can_id, frame.data))

    def can_error() -> None:
        station = simulation.bus.station(listener)
        errors = max(station.transmit_errors, station.receive_errors)
        state: BusState = "passive" if errors >= PASSIVE else "warning" if errors >= WARNING else "active"
        error_frames[0] += 1
        take(CanFault(clock.monotonic_ns(), clock.wall_ns(), state, error_frames[0]))

    error_frames = [0]
    listener = _Listener(can)
    published, judged = [clock.monotonic_ns()], [0]
    simulation.bus.attach(listener)
    simulation.bus.error_listeners.append(can_error)
    simulation.serial_out = serial
    for link in ("rs232", "can"):
        take(LinkChange(clock.monotonic_ns(), clock.wall_ns(), link, "open"))
    simulation.run_until(STREAM_S)
    simulation.receive(b"x")
    asked_s, flushed_s = simulation.now_s, simulation.now_s
    while not player.is_over:
        player.run(TURN_S)
        now_ns = clock.monotonic_ns()
        if now_ns - published[0] >= 10**9:
            published[0] = now_ns
            output = pipeline.tick(now_ns, clock.wall_ns())
            recorder.on_output(output)
            for event in output.events:
                recorder.on_event(event)
            if simulation.now_s - asked_s > 1.0:  # like the RS232 link: silence is answered with `x`
                asked_s = simulation.now_s
                simulation.receive(b"x")
        if simulation.now_s - flushed_s > 60.0:
            flushed_s = simulation.now_s
            recorder.flush()
    recorder.stop()
    recorder.close()
    made = sorted((work / "sessions").glob("*.sqlite"))
    made[0].replace(target)
    for left in sorted(work.rglob("*"), reverse=True):
        left.rmdir() if left.is_dir() else left.unlink()
    work.rmdir()
    return target
