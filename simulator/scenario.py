"""A scenario: its start, phases, faults, actions of the operator, and the events that must follow.

docs/reference/simulator.md describes the file; `scenario_file` reads it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from firmware_protocol.messages import EventCode
from simulator.fault_kinds import Target
from simulator.faults import fault_kind
from simulator.loads import Recorded
from simulator.shape import TEAM, Shape

LOADS: dict[str, tuple[str, ...]] = {  # with the keys that only they have
    "rest": (),
    "idle": (),
    "constant": ("current_a",),
    "endurance": ("laps",),
    "acceleration": (),
    "skid-pad": (),
    "pattern": ("pattern", "power_scale"),
    "recorded": ("file",),
    "charge": (),
    "charge-by-hand": (),
}
ACTIONS = ("charge-start", "charge-stop", "balance-start", "balance-stop", "clear-faults", "store", "soc", "reset")


@dataclass(frozen=True, slots=True)
class Start:
    """The state at the beginning; spreads are standard deviations between cells.

    With a recording, its first state of charge and its air count where the scenario does not give its own.
    """

    soc: float = 0.9
    soc_spread: float = 0.004
    ambient_degc: float = 25.0
    sun_w: float = 0.0
    capacity_spread: float = 0.01
    resistance_spread: float = 0.03
    capacity_ageing: float = 1.0
    resistance_ageing: float = 1.0
    aged_days: float = 0.0  # on the shelf, by the law of `simulator.ageing`; factors come on top of the two above
    aged_degc: float = 25.0  # there
    aged_v: float = 3.7  # cell voltage in storage
    aged_ah: float = 0.0  # passed through what is measured as one cell, out and in together
    aged_depth: float = 0.75  # depth of the discharges, share of the capacity
    ageing: float = 0.0  # while it is played: so many times faster than the law, 0 not at all
    cells: Mapping[str, float] = field(default_factory=dict)  # index to start SOC
    paces: Mapping[str, float] = field(default_factory=dict)  # index to how many times faster it ages


@dataclass(frozen=True, slots=True)
class PhasePlan:
    """One phase; it ends with its load, after `for_s`, or when the mean SOC has reached `until_soc`."""

    load: str
    for_s: float | None = None
    until_soc: float | None = None
    current_a: float = 0.0
    power_scale: float = 1.0
    pattern_c: tuple[float, ...] = ()  # loads of equal slices
    laps: int = 22
    recording: Recorded | None = field(default=None, compare=False, repr=False)

    @property
    def longest_s(self) -> float | None:
        """Return how long the phase takes at the most [s]; None where the file gives no time."""
        given = [self.for_s, None if self.recording is None else self.recording.duration_s]
        return min((duration_s for duration_s in given if duration_s is not None), default=None)

    @property
    def is_filling(self) -> bool:
        """Return whether the SOC rises in this phase, so that `until_soc` is reached from below."""
        return self.load in ("charge", "charge-by-hand") or self.current_a < 0.0


@dataclass(frozen=True, slots=True)
class FaultPlan:
    """A fault at a time of the round, for some time or permanently."""

    at_s: float
    name: str
    target: int
    value: float | None
    for_s: float | None
    shape: Shape = TEAM  # shape of the battery that it was read for

    def __str__(self) -> str:
        return _fault_text(self)


@dataclass(frozen=True, slots=True)
class ActionPlan:
    """An action of the operator at a time of the round; the argument is that of `soc`, 0..1."""

    at_s: float
    name: str
    argument: float | None

    def __str__(self) -> str:
        return self.name if self.argument is None else f"{self.name} {self.argument:g}"


@dataclass(frozen=True, slots=True)
class Expectation:
    """An event that must occur, from this cell or pack, within these times."""

    event: EventCode
    cell: int | None
    value: int | None
    after_s: float
    before_s: float


@dataclass(frozen=True, slots=True)
class Scenario:
    """A whole scenario."""

    name: str
    title: str
    description: str
    seed: int
    loop: bool
    start: Start
    balancing: str
    sensor_inputs: tuple[int, ...]  # cell input of each cell's temperature sensor, from 0
    config: bytes | None
    phases: tuple[PhasePlan, ...]
    faults: tuple[FaultPlan, ...]
    actions: tuple[ActionPlan, ...]
    expected: tuple[Expectation, ...]

    @property
    def longest_s(self) -> float | None:
        """Return how long a round takes at most [s]; None if a phase ends by its load or by a SOC alone."""
        longest = [phase.longest_s for phase in self.phases]
        return None if None in longest else sum(duration_s for duration_s in longest if duration_s is not None)

    def describe(self) -> str:
        """Return the scenario for people to read."""
        lines = [f"{self.name}: {self.title}", "", self.description.strip(), ""]
        lines.append(f"starts at {self.start.soc:.0%} and {self.start.ambient_degc:g} degC, seed {self.seed}")
        lines += [] if self.balancing == "passive" else [f"balances by {self.balancing}"]
        lines += [f"then {phase.load}{_span(phase)}" for phase in self.phases]
        lines += [f"at {fault.at_s:g} s: {fault}" for fault in self.faults]
        lines += [f"at {action.at_s:g} s the operator: {action}" for action in self.actions]
        lines += ["and all over again"] if self.loop else []
        lines += [f"expected: {_expectation_text(item)}" for item in self.expected]
        return "\n".join(lines)


def _span(phase: PhasePlan) -> str:
    parts = []
    if phase.load == "constant":
        parts.append(f"at {phase.current_a:g} A")
    if phase.for_s is not None:
        parts.append(f"for {phase.for_s:g} s")
    if phase.until_soc is not None:
        parts.append(f"{'up' if phase.is_filling else 'down'} to {phase.until_soc:.0%}")
    return " " + ", ".join(parts) if parts else ""


def _fault_text(fault: FaultPlan) -> str:
    kind = fault_kind(fault.name)
    place = {
        Target.NONE: "",
        Target.PACK: f" in pack {fault.target + 1}",
        Target.CELL: f" in {_place(fault.target, fault.shape)}",
    }[kind.target]
    value = kind.default if fault.value is None else fault.value
    amount = f" ({value:g} {kind.unit})" if kind.unit else ""
    return f"{fault.name}{place}{amount}" + ("" if fault.for_s is None else f" for {fault.for_s:g} s")


def _expectation_text(item: Expectation) -> str:
    place = "" if item.cell is None else f" from {_place(item.cell, TEAM)}"
    value = "" if item.value is None else f" with value {item.value}"
    return f"{item.event.name}{place}{value} between {item.after_s:g} and {item.before_s:g} s"


def _place(index: int, shape: Shape) -> str:
    pack, cell = shape.place(index)
    return f"pack {pack}, cell {cell}"
