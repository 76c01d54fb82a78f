"""Runs with a hidden fault for `benchmarks.root_cause`: cell, time and size drawn at random, and their scenarios."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from firmware_protocol.config_image import default_image
from firmware_protocol.memory_map import N_CELLS, N_PACKS
from simulator.fault_kinds import FAULTS, Target
from simulator.scenario import ActionPlan, FaultPlan, PhasePlan, Scenario, Start
from simulator.slave import THESIS_SENSOR_INPUTS

JOINT: Final = "joint-resistance-high"
LARGE_MOHM: Final = (11.0, 20.0)  # opens the shutdown circuit within seconds
A_MINUTE_S: Final = 60.0
HALF_HOUR_S: Final = 1800.0
ABUSES = ("overload", "accumulator-cold", "accumulator-empty")  # what trips without any fault


@dataclass(frozen=True)
class Case:
    """One run: what is wrong (`fault`), since when, where and how much."""

    part: str
    fault: str
    seed: int
    at_s: float
    cell: int | None = None
    pack: int | None = None
    value: float | None = None

    @property
    def name(self) -> str:
        """A name for its folder."""
        return f"{self.part}-{self.fault.replace(' ', '-')}-{self.seed}"

    @property
    def where(self) -> int | None:
        """Cell, or pack, or neither."""
        return self.pack if self.cell is None else self.cell


Drawn = tuple[Case, Scenario]


def faults(seed: int) -> Iterator[Drawn]:
    """Yield a run of every fault and of every abuse."""
    for k, fault in enumerate((*FAULTS, *ABUSES)):
        yield draw("faults", fault, seed, np.random.default_rng((seed, k)))


def large_joint(seed: int) -> Drawn:
    """Return a run in which a joint parts a minute into the race, and the car trips within seconds."""
    rng = np.random.default_rng((seed, 1001))
    cell, mohm = int(rng.integers(N_CELLS)), float(rng.uniform(*LARGE_MOHM))
    case = Case("joints", JOINT, seed, A_MINUTE_S, cell, cell // (N_CELLS // N_PACKS), mohm)
    start = Start(float(rng.uniform(0.7, 0.95)), ambient_degc=float(rng.uniform(18.0, 30.0)))
    return case, _scenario(case, start, [PhasePlan("endurance", for_s=A_MINUTE_S + 30.0)], None)


def any_joint(seed: int) -> Drawn:
    """Return a run with a joint of any size at any time."""
    return draw("sizes", JOINT, seed, np.random.default_rng((seed, 1002)))


def half_hour(seed: int) -> Drawn:
    """Return half an hour of a healthy car: a race for the most part, also charging and standing."""
    rng = np.random.default_rng((seed, 1003))
    load = ("endurance", "endurance", "endurance", "charge-by-hand", "rest")[seed % 5]
    soc = 0.97 if load == "endurance" else float(rng.uniform(0.3, 0.6))
    start = Start(soc, ambient_degc=float(rng.uniform(15.0, 32.0)))
    actions = [ActionPlan(4.0, "charge-start", None)] if load == "charge-by-hand" else []
    case = Case("healthy", "clean half-hour", seed, 0.0)
    return case, _scenario(case, start, [PhasePlan(load, for_s=HALF_HOUR_S)], None, actions)


def draw(part: str, fault: str, seed: int, rng: np.random.Generator) -> Drawn:
    """Draw cell, time and magnitude of one run."""
    kind = FAULTS.get(fault)
    value = None if kind is None else _value(fault, rng)
    cell = pack = None
    if kind is not None and kind.target is Target.CELL:
        cell = int(rng.integers(N_CELLS))
        pack = cell // (N_CELLS // N_PACKS)
    elif kind is not None and kind.target is Target.PACK:
        pack = int(rng.integers(N_PACKS))
    start, phases, at_s, for_s, actions = _situation(fault, rng)
    case = Case(part, fault, seed, at_s, cell, pack, value)
    return case, _scenario(case, start, phases, for_s, actions)


def _scenario(
    case: Case, start: Start, phases: list[PhasePlan], for_s: float | None, actions: list[ActionPlan] | None = None
) -> Scenario:
    kind = FAULTS.get(case.fault)
    plan = [] if kind is None else [(case.where or 0, case.value, None if kind.is_instant else for_s)]
    return Scenario(
        case.fault,
        case.fault,
        "",
        case.seed * 100 + 1,
        False,
        start,
        "passive",
        THESIS_SENSOR_INPUTS,
        default_image(),
        tuple(phases),
        tuple(FaultPlan(case.at_s, case.fault, *fault) for fault in plan),
        tuple(actions or ()),
        (),
    )


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
    return Start(soc, ambient_degc=degc), [drive], at_s, None, []
