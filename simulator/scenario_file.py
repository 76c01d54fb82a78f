"""Reads scenario files. An accepted file can be run to its end; an error names its place in the file.

docs/reference/simulator.md describes the format.
"""

import contextlib
import re
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

from firmware_protocol.config_image import check, default_image, with_value
from firmware_protocol.errors import EncodeError
from firmware_protocol.memory_map import CELLS_PER_PACK
from firmware_protocol.messages import EventCode
from simulator.balancing.choices import METHODS
from simulator.errors import FaultError, InputError, ParameterError, ScenarioError
from simulator.fault_kinds import Target, read_fault
from simulator.faults import check_fault, read_target
from simulator.inputs import (
    AMBIENT_DEGC,
    AT_S,
    CURRENT_A,
    FOR_S,
    SEED,
    SHARE,
    NumberRange,
    check_number,
    read_choice,
    read_number,
    read_optional,
    read_text,
    refuse_unknown,
    shown,
)
from simulator.loads import PATTERNS_C
from simulator.recording import load_recording, read_recording
from simulator.scenario import ACTIONS, LOADS, ActionPlan, Expectation, FaultPlan, PhasePlan, Scenario, Start
from simulator.shape import TEAM, Shape
from simulator.slave import THESIS_SENSOR_INPUTS

Item = TypeVar("Item")

START_LIMITS = {
    "soc": SHARE,
    "soc_spread": NumberRange(0, 0.25),
    "ambient_degc": AMBIENT_DEGC,
    "sun_w": NumberRange(0, 5000, "W"),
    "capacity_spread": NumberRange(0, 0.3),  # cells lie within three spreads: a tenth of the capacity is left
    "resistance_spread": NumberRange(0, 0.3),
    "capacity_ageing": NumberRange(0.05, 1.2, "of new"),
    "resistance_ageing": NumberRange(0.5, 20, "times new"),
    "aged_days": NumberRange(0, 7300, "days"),
    "aged_degc": AMBIENT_DEGC,
    "aged_v": NumberRange(3.2, 4.3, "V"),  # the law has no loss below
    "aged_ah": NumberRange(0, 100_000, "Ah"),
    "aged_depth": SHARE,
    "ageing": NumberRange(0, 1e6, "times"),
}
_PACE = NumberRange(0.1, 20, "times")
_POWER_SCALE = NumberRange(0.01, 4)
_SLICE_C = NumberRange(-10, 10, "C")
MOST_CHARACTERS = 262_144  # characters of a file
MOST_KEY_PARTS = 8  # `a.b.c` has three
MOST_SLICES = 200  # slices of a pattern
_LAPS = NumberRange(1, 100, is_whole=True)
_EVENT_VALUE = NumberRange(-(2**31), 2**32 - 1, is_whole=True)
_RELAYS_S = 5.0  # until the relays are closed and a recorded current can flow
_CELL_PLACE = re.compile(r"([1-9]\d{0,2})/([1-9]\d{0,2})", re.ASCII)


def load_scenario(path: Path, shape: Shape = TEAM) -> Scenario:
    """Read a scenario file, and the recordings that it names.

    Args:
        path: of the file.
        shape: of the battery that is to play it; others than the team's own have no configuration.

    Raises:
        ScenarioError: it cannot be read, is no TOML, or says something that has no meaning for this battery.
    """
    try:
        text = path.read_text(encoding="utf-8")
        _check_size(path, text)
        document = tomllib.loads(text)
    except (OSError, ValueError, RecursionError) as error:
        raise ScenarioError(str(path), str(error)) from error
    return _scenario(document, path, shape)


def _check_size(path: Path, text: str) -> None:
    """Refuse what takes the parser minutes: a long text, a key of many parts."""
    if len(text) > MOST_CHARACTERS:
        raise ScenarioError(str(path), f"{len(text)} characters; at most {MOST_CHARACTERS} are read")
    for number, line in enumerate(text.splitlines(), 1):
        key, equals, _ = line.partition("=")
        if equals and key.count(".") >= MOST_KEY_PARTS:
            raise ScenarioError(f"{path}, line {number}", f"a key of more than {MOST_KEY_PARTS} parts")


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
        TEAM,
    )


def _scenario(document: dict[str, Any], path: Path, shape: Shape) -> Scenario:
    where, folder = path.name, path.parent
    phases = _each(document, "phase", where, lambda table: _phase(table, folder))
    faults = _each(document, "fault", where, lambda table: _fault(table, shape))
    actions = _each(document, "action", where, _action)
    expected = _each(document, "expect", where, _expect) if shape.is_team else ()
    with _place(f"{where} [start]"):
        start = _start(_table(document, "start"), folder, shape)
    with _place(f"{where} [balancing]"):
        balancing = _balancing(_table(document, "balancing"))
    with _place(f"{where} [config]"):
        config = _config(_table(document, "config"))
    with _place(f"{where} [slaves]"):
        sensor_inputs = _sensor_inputs(_table(document, "slaves"))
    of_team = ("slaves", "config", "balancing")
    if not shape.is_team and (config is not None or balancing != METHODS[0] or sensor_inputs != THESIS_SENSOR_INPUTS):
        raise ScenarioError(where, f"[{'], ['.join(of_team)}] are of the team's own battery; this one has none of them")
    with _place(where):
        keys = {
            "title", "description", "seed", "loop",
            "start", "balancing", "slaves", "config", "phase", "fault", "action", "expect",
        }  # fmt: skip
        refuse_unknown(document, keys)
        if not phases:
            raise InputError("phase", "no [[phase]]: nothing would happen")
        loop = document.get("loop", False)
        if not isinstance(loop, bool):
            raise InputError("loop", f"loop = {shown(loop)} is neither true nor false")
        return Scenario(
            name=path.stem,
            title=read_text(document, "title"),
            description=read_text(document, "description"),
            seed=int(read_number(document, "seed", SEED, 1)),
            loop=loop,
            start=start,
            balancing=balancing,
            sensor_inputs=sensor_inputs,
            config=config,
            phases=phases,
            faults=faults,
            actions=actions,
            expected=expected,
        )


@contextlib.contextmanager
def _place(where: str) -> Iterator[None]:
    """Add the place in the file to an error."""
    try:
        yield
    except (InputError, FaultError, ParameterError, EncodeError) as error:
        raise ScenarioError(where, str(error)) from error


def _each(document: dict[str, Any], key: str, where: str, parse: Callable[[dict[str, Any]], Item]) -> tuple[Item, ...]:
    items = document.get(key, [])
    if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
        raise ScenarioError(where, f"{key} is written as [[{key}]], one table each")
    parsed = []
    for n, item in enumerate(items, 1):
        with _place(f"{where} [[{key}]] {n}"):
            parsed.append(parse(item))
    return tuple(parsed)


def _table(document: dict[str, Any], key: str) -> dict[str, Any]:
    table = document.get(key, {})
    if not isinstance(table, dict):
        raise InputError(key, f"{key} is written as [{key}], not {key} = {shown(table)}")
    return table


def _start(table: dict[str, Any], folder: Path, shape: Shape) -> Start:
    refuse_unknown(table, {item.name for item in fields(Start)} | {"recording"})
    recorded = _recorded_start(folder / read_text(table, "recording")) if "recording" in table else {}
    cells, paces = _of_cells(table, "cells", SHARE, shape), _of_cells(table, "paces", _PACE, shape)
    defaults = Start()
    numbers = {
        name: read_number(table, name, limits, recorded.get(name, getattr(defaults, name)))
        for name, limits in START_LIMITS.items()
    }
    return Start(**numbers, cells=cells, paces=paces)


def _of_cells(table: dict[str, Any], key: str, limits: NumberRange, shape: Shape) -> dict[str, float]:
    """Numbers by "pack/cell", as people count, to numbers by index."""
    values = {}
    for place, value in _table(table, key).items():
        match = _CELL_PLACE.fullmatch(place)
        if match is None:
            raise InputError(key, f'{key}: write "pack/cell" = number, not {shown(place)} = {shown(value)}')
        values[str(shape.cell_index(int(match[1]), int(match[2])))] = check_number(f'{key} "{place}"', value, limits)
    return values


def _recorded_start(path: Path) -> dict[str, float]:
    recording = read_recording(path)
    ambient = recording.ambient_degc
    start = {"soc": recording.start_soc, "ambient_degc": None if ambient is None else float(ambient[0])}
    return {name: value for name, value in start.items() if value is not None}


def _balancing(table: dict[str, Any]) -> str:
    refuse_unknown(table, {"method"})
    return read_choice({"method": METHODS[0], **table}, "method", METHODS)


def _sensor_inputs(table: dict[str, Any]) -> tuple[int, ...]:
    """Return the cell input of each cell's sensor, from 0; in the file from 1."""
    refuse_unknown(table, {"sensor_inputs"})
    key = "sensor_inputs"
    if key not in table:
        return THESIS_SENSOR_INPUTS
    given = table[key]
    whole = isinstance(given, list) and all(isinstance(at, int) and not isinstance(at, bool) for at in given)
    if not whole or sorted(given) != list(range(1, CELLS_PER_PACK + 1)):
        raise InputError(key, f"{key} = {shown(given)} is not each of 1..{CELLS_PER_PACK} once")
    return tuple(at - 1 for at in given)


def _config(table: dict[str, Any]) -> bytes | None:
    if not table:
        return None
    image = default_image()
    for name, value in table.items():
        image = with_value(image, name, value)
    if errors := check(image):
        raise InputError("config", errors[0].message)
    return image


def _phase(table: dict[str, Any], folder: Path) -> PhasePlan:
    load = read_choice(table, "load", LOADS)
    ends = {"for_s"} if load == "rest" else {"for_s", "until_soc"}
    refuse_unknown(table, {"load", *ends, *LOADS[load]}, f"with load {load!r}")
    return PhasePlan(
        load,
        for_s=read_optional(table, "for_s", FOR_S),
        until_soc=read_optional(table, "until_soc", SHARE),
        current_a=read_number(table, "current_a", CURRENT_A) if load == "constant" else 0.0,
        power_scale=read_number(table, "power_scale", _POWER_SCALE, 1.0),
        pattern_c=_pattern(table) if load == "pattern" else (),
        laps=int(read_number(table, "laps", _LAPS, 22)),
        recording=load_recording(folder / read_text(table, "file")) if load == "recorded" else None,
    )


def _pattern(table: dict[str, Any]) -> tuple[float, ...]:
    """Return a pattern by its name, or the one that is written there."""
    given = table.get("pattern", "medium")
    if not isinstance(given, list):
        return PATTERNS_C[read_choice({"pattern": given}, "pattern", PATTERNS_C)]
    if not 1 <= len(given) <= MOST_SLICES:
        raise InputError("pattern", f"has {len(given)} slices; 1 to {MOST_SLICES} are possible")
    slices_c = tuple(check_number(f"pattern[{k}]", value, _SLICE_C) for k, value in enumerate(given))
    if not sum(slices_c) > 0.0:
        raise InputError("pattern", f"sums to {sum(slices_c):g} C: it has to discharge")
    return slices_c


def _fault(table: dict[str, Any], shape: Shape) -> FaultPlan:
    refuse_unknown(table, {"at_s", "name", "pack", "cell", "value", "for_s"})
    kind = read_fault(table, "name")
    target = read_target(kind.target, table, shape)
    value, for_s = table.get("value"), table.get("for_s")
    check_fault(kind, target, value, for_s, shape)
    return FaultPlan(read_number(table, "at_s", AT_S, 0), kind.name, target, value, for_s, shape)


def _action(table: dict[str, Any]) -> ActionPlan:
    name = read_choice(table, "name", ACTIONS)
    refuse_unknown(table, {"at_s", "name"} | ({"argument"} if name == "soc" else set()), f"with {name!r}")
    argument = read_number(table, "argument", SHARE) if name == "soc" else None
    return ActionPlan(read_number(table, "at_s", AT_S, 0), name, argument)


def _expect(table: dict[str, Any]) -> Expectation:
    refuse_unknown(table, {"event", "pack", "cell", "value", "after_s", "before_s"})
    event = read_choice(table, "event", EventCode.__members__)
    cell = None
    if "cell" in table:
        cell = read_target(Target.CELL, table)
    elif "pack" in table:
        cell = TEAM.starts[read_target(Target.PACK, table)]
    value = read_optional(table, "value", _EVENT_VALUE)
    after_s = read_number(table, "after_s", AT_S, 0)
    before_s = float("inf") if "before_s" not in table else read_number(table, "before_s", AT_S)
    if before_s < after_s:
        raise InputError("before_s", f"before_s = {before_s:g} is before after_s = {after_s:g}")
    return Expectation(EventCode[event], cell, None if value is None else int(value), after_s, before_s)
