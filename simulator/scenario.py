"""Scenarios: readable TOML files that say how a run starts, what the car does, what goes wrong and what must follow.

docs/simulator.md describes the format; this module reads it and refuses what it does not know.
"""

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, TypeVar

from firmware_protocol.config_image import check, default_image, with_value
from firmware_protocol.errors import EncodeError
from firmware_protocol.memory_map import CELLS_PER_PACK
from firmware_protocol.messages import EventCode
from simulator.errors import FaultError, ParameterError, ScenarioError
from simulator.fault_kinds import Target
from simulator.faults import cell_index, check_fault, fault_kind
from simulator.recording import read_recording

Item = TypeVar("Item")

LOADS = (
    "rest",
    "idle",
    "constant",
    "endurance",
    "acceleration",
    "skid-pad",
    "pattern",
    "recorded",
    "charge",
    "charge-by-hand",
)
_RELAYS_S = 5.0  # until the relays are closed and a recorded current can flow
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
    cells: Mapping[str, float] = field(default_factory=dict)  # "pack/cell" to start SOC


@dataclass(frozen=True, slots=True)
class PhasePlan:
    """One thing the car does; it ends with its load, after `for_s`, or below `until_soc`."""

    load: str
    for_s: float | None = None
    until_soc: float | None = None
    current_a: float = 0.0
    power_scale: float = 1.0
    pattern: str = "medium"
    laps: int = 22
    file: str = ""


@dataclass(frozen=True, slots=True)
class FaultPlan:
    """A fault at a time, for a while or for good."""

    at_s: float
    name: str
    target: int
    value: float | None
    for_s: float | None


@dataclass(frozen=True, slots=True)
class ActionPlan:
    """Something the operator does at a time."""

    at_s: float
    name: str
    argument: float


@dataclass(frozen=True, slots=True)
class Expectation:
    """An event that must come, from this cell or pack, within these times."""

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
    config: bytes | None
    phases: tuple[PhasePlan, ...]
    faults: tuple[FaultPlan, ...]
    actions: tuple[ActionPlan, ...]
    expected: tuple[Expectation, ...]
    folder: Path

    def describe(self) -> str:
        """Return the scenario for people to read."""
        lines = [f"{self.name}: {self.title}", "", self.description.strip(), ""]
        lines.append(f"starts at {self.start.soc:.0%} and {self.start.ambient_degc:g} degC, seed {self.seed}")
        lines += [f"then {phase.load}{_span(phase)}" for phase in self.phases]
        lines += ["and all over again"] if self.loop else []
        lines += [f"at {fault.at_s:g} s: {_fault_text(fault)}" for fault in self.faults]
        lines += [f"at {action.at_s:g} s the operator: {action.name} {action.argument:g}" for action in self.actions]
        lines += [f"expected: {_expectation_text(item)}" for item in self.expected]
        return "\n".join(lines)


def load_scenario(path: Path) -> Scenario:
    """Read a scenario file.

    Raises:
        ScenarioError: it cannot be read, is no TOML, or says something that has no meaning.
    """
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ScenarioError(str(path), str(error)) from error
    return _scenario(document, path)


def recorded_scenario(path: Path) -> Scenario:
    """Return the scenario that replays a recorded drive from the state it began with.

    Raises:
        ScenarioError: the file is no recording.
    """
    return _scenario(
        {
            "title": f"{path.name} again",
            "description": "A recorded current over the physics, from the charge and in the air of its first row.",
            "start": {"recording": path.name},
            "phase": [{"load": "idle", "for_s": _RELAYS_S}, {"load": "recorded", "file": path.name}],
        },
        path,
    )


def _scenario(document: dict[str, Any], path: Path) -> Scenario:
    where = path.name
    known = {"title", "description", "seed", "loop", "start", "config", "phase", "fault", "action", "expect"}
    _refuse_unknown(document, known, where)
    phases = _each(document, "phase", where, _phase)
    if not phases:
        raise ScenarioError(where, "no [[phase]]: nothing would happen")
    return Scenario(
        name=path.stem,
        title=_text(document, "title", where),
        description=_text(document, "description", where),
        seed=int(_number(document, "seed", where, 1)),
        loop=bool(document.get("loop", False)),
        start=_start(_table(document, "start", where), f"{where} [start]", path.parent),
        config=_config(_table(document, "config", where), f"{where} [config]"),
        phases=phases,
        faults=_each(document, "fault", where, _fault),
        actions=_each(document, "action", where, _action),
        expected=_each(document, "expect", where, _expect),
        folder=path.parent,
    )


def _each(
    document: dict[str, Any], key: str, where: str, parse: Callable[[dict[str, Any], str], Item]
) -> tuple[Item, ...]:
    items = document.get(key, [])
    if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
        raise ScenarioError(where, f"{key} is written as [[{key}]], one table each")
    return tuple(parse(item, f"{where} [[{key}]] {n}") for n, item in enumerate(items, 1))


def _table(document: dict[str, Any], key: str, where: str) -> dict[str, Any]:
    table = document.get(key, {})
    if not isinstance(table, dict):
        raise ScenarioError(where, f"{key} is written as [{key}], not {key} = {table!r}")
    return table


def _start(table: dict[str, Any], where: str, folder: Path) -> Start:
    _refuse_unknown(table, {item.name for item in fields(Start)} | {"recording"}, where)
    if "recording" in table:
        table = {**_recorded_start(folder / _text(table, "recording", where), where), **table}
    cells = {}
    for place, soc in _table(table, "cells", where).items():
        pack, _, cell = str(place).partition("/")
        if not (pack.isdecimal() and cell.isdecimal() and isinstance(soc, int | float)):
            raise ScenarioError(where, f'cells: write "pack/cell" = soc, not {place!r} = {soc!r}')
        cells[str(_cell(int(pack), int(cell), where))] = float(soc)
    defaults = Start()
    numbers = {
        item.name: _number(table, item.name, where, getattr(defaults, item.name))
        for item in fields(Start)
        if item.name != "cells"
    }
    return Start(**numbers, cells=cells)


def _recorded_start(path: Path, where: str) -> dict[str, float]:
    try:
        recording = read_recording(path)
    except ParameterError as error:
        raise ScenarioError(where, str(error)) from error
    ambient = recording.ambient_degc
    found = {"soc": recording.start_soc, "ambient_degc": None if ambient is None else float(ambient[0])}
    return {name: value for name, value in found.items() if value is not None}


def _config(table: dict[str, Any], where: str) -> bytes | None:
    if not table:
        return None
    image = default_image()
    try:
        for name, value in table.items():
            image = with_value(image, name, value)
    except EncodeError as error:
        raise ScenarioError(where, str(error)) from error
    if errors := check(image):
        raise ScenarioError(where, errors[0].message)
    return image


def _phase(table: dict[str, Any], where: str) -> PhasePlan:
    _refuse_unknown(table, {item.name for item in fields(PhasePlan)}, where)
    load = _text(table, "load", where)
    if load not in LOADS:
        raise ScenarioError(where, f"load {load!r} is none of {', '.join(LOADS)}")
    return PhasePlan(
        load,
        for_s=_optional_number(table, "for_s", where),
        until_soc=_optional_number(table, "until_soc", where),
        current_a=_number(table, "current_a", where, 0.0),
        power_scale=_number(table, "power_scale", where, 1.0),
        pattern=str(table.get("pattern", "medium")),
        laps=int(_number(table, "laps", where, 22)),
        file=str(table.get("file", "")),
    )


def _fault(table: dict[str, Any], where: str) -> FaultPlan:
    _refuse_unknown(table, {"at_s", "name", "pack", "cell", "value", "for_s"}, where)
    try:
        kind = fault_kind(_text(table, "name", where))
        target = _target(kind.target, table, where)
        value, for_s = _optional_number(table, "value", where), _optional_number(table, "for_s", where)
        check_fault(kind, target, value, for_s)
    except FaultError as error:
        raise ScenarioError(where, str(error)) from error
    return FaultPlan(_number(table, "at_s", where, 0.0), kind.name, target, value, for_s)


def _action(table: dict[str, Any], where: str) -> ActionPlan:
    _refuse_unknown(table, {"at_s", "name", "argument"}, where)
    name = _text(table, "name", where)
    if name not in ACTIONS:
        raise ScenarioError(where, f"name {name!r} is none of {', '.join(ACTIONS)}")
    return ActionPlan(_number(table, "at_s", where, 0.0), name, _number(table, "argument", where, 0.0))


def _expect(table: dict[str, Any], where: str) -> Expectation:
    _refuse_unknown(table, {"event", "pack", "cell", "value", "after_s", "before_s"}, where)
    name = _text(table, "event", where)
    if name not in EventCode.__members__:
        raise ScenarioError(where, f"event {name!r} is none of {', '.join(EventCode.__members__)}")
    cell = None
    if "pack" in table:
        cell = _target(Target.CELL if "cell" in table else Target.PACK, table, where)
        cell = cell if "cell" in table else cell * CELLS_PER_PACK
    value = _optional_number(table, "value", where)
    return Expectation(
        EventCode[name],
        cell,
        None if value is None else int(value),
        _number(table, "after_s", where, 0.0),
        _number(table, "before_s", where, float("inf")),
    )


def _target(target: Target, table: dict[str, Any], where: str) -> int:
    needed = {Target.NONE: set[str](), Target.PACK: {"pack"}, Target.CELL: {"pack", "cell"}}[target]
    given = {"pack", "cell"} & set(table)
    if given != needed:
        raise ScenarioError(where, f"needs {' and '.join(sorted(needed)) or 'neither pack nor cell'}")
    if not needed:
        return 0
    pack = int(_number(table, "pack", where, 1))
    if target is Target.PACK:
        return _cell(pack, 1, where) // CELLS_PER_PACK
    return _cell(pack, int(_number(table, "cell", where, 1)), where)


def _cell(pack: int, cell: int, where: str) -> int:
    try:
        return cell_index(pack, cell)
    except FaultError as error:
        raise ScenarioError(where, error.reason) from error


def _refuse_unknown(table: Mapping[str, Any], known: set[str], where: str) -> None:
    unknown = sorted(set(table) - known)
    if unknown:
        raise ScenarioError(where, f"{unknown[0]!r} means nothing here; known are {', '.join(sorted(known))}")


def _text(table: Mapping[str, Any], key: str, where: str) -> str:
    value = table.get(key)
    if not isinstance(value, str) or not value:
        raise ScenarioError(where, f"{key} is missing")
    return value


def _number(table: Mapping[str, Any], key: str, where: str, default: float) -> float:
    value = table.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ScenarioError(where, f"{key} = {value!r} is no number")
    return float(value)


def _optional_number(table: Mapping[str, Any], key: str, where: str) -> float | None:
    return _number(table, key, where, 0.0) if key in table else None


def _span(phase: PhasePlan) -> str:
    parts = []
    if phase.load == "constant":
        parts.append(f"at {phase.current_a:g} A")
    if phase.for_s is not None:
        parts.append(f"for {phase.for_s:g} s")
    if phase.until_soc is not None:
        parts.append(f"down to {phase.until_soc:.0%}")
    return " " + ", ".join(parts) if parts else ""


def _fault_text(fault: FaultPlan) -> str:
    kind = fault_kind(fault.name)
    place = {
        Target.NONE: "",
        Target.PACK: f" in pack {fault.target + 1}",
        Target.CELL: f" in {_place(fault.target)}",
    }[kind.target]
    value = kind.default if fault.value is None else fault.value
    amount = f" ({value:g} {kind.unit})" if kind.unit else ""
    return f"{fault.name}{place}{amount}" + ("" if fault.for_s is None else f" for {fault.for_s:g} s")


def _expectation_text(item: Expectation) -> str:
    place = "" if item.cell is None else f" from {_place(item.cell)}"
    value = "" if item.value is None else f" with value {item.value}"
    return f"{item.event.name}{place}{value} between {item.after_s:g} and {item.before_s:g} s"


def _place(cell: int) -> str:
    return f"pack {cell // CELLS_PER_PACK + 1}, cell {cell % CELLS_PER_PACK + 1}"
