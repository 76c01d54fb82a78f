"""A profile's patterns against the definitions: which bits of which frame are which cell. Done once, before frames."""

import re
from collections import defaultdict
from dataclasses import dataclass, field, replace

import numpy as np

from app.battery.battery import Battery, SignalName
from app.battery.source import (
    CURRENT_UNITS,
    RESISTANCE_UNITS,
    SOC_UNITS,
    TEMPERATURE_UNITS,
    VOLTAGE_UNITS,
    ZERO_AT,
    CellSignals,
    DbcMapping,
    Kind,
    ScalarSignal,
)
from app.estimation.arrays import IntArray
from app.sources.dbc.definitions import BitLayout, Definitions, MessageDefinition, MultiplexCondition, SignalDefinition
from app.sources.dbc.patterns import PatternError, filled, numbers_in, texts_in
from app.words import Message, Text

_PREFIX = {"": 1.0, "m": 1e-3, "u": 1e-6, "µ": 1e-6, "k": 1e3, "c": 1e-2, "d": 0.1}
_CELSIUS, _FAHRENHEIT, _KELVIN = (1.0, 0.0), (5 / 9, -160 / 9), (1.0, -273.15)
_TEMPERATURES = {
    **dict.fromkeys(
        ("degc", "degreec", "degreesc", "c", "°c", "cel", "celsius", "degcelsius", "grad", "gradc", "oc", "deg"),
        _CELSIUS,
    ),
    **dict.fromkeys(("f", "degf", "°f", "fahrenheit"), _FAHRENHEIT),
    **dict.fromkeys(("k", "kelvin"), _KELVIN),
    "ddegc": (0.1, 0.0),
    "cdegc": (0.01, 0.0),
}
_WORDS = {"volt": "v", "volts": "v", "ampere": "a", "amps": "a", "amp": "a", "amperes": "a", "millivolt": "mv",
          "millivolts": "mv", "milliampere": "ma", "milliamps": "ma"}  # fmt: skip
_BASE = {
    "voltage": "v", "pack_voltage": "v", "charger_voltage": "v", "current": "a", "charger_current": "a",
    "resistance": "ohm",
}  # fmt: skip


def conversion(kind: str, unit: str) -> tuple[float, float]:
    """Return factor and zero of a DBC's unit for a quantity; 1 and 0 where the unit is unknown or none."""
    return known_conversion(kind, unit) or (1.0, 0.0)


def known_conversion(kind: str, unit: str) -> tuple[float, float] | None:
    """Return factor and zero of a DBC's unit for a quantity; None where the unit is not one of it."""
    text = re.sub(r"[\s_\[\]()]", "", unit)
    count, text = _count(text)
    low = text.lower()
    if kind == "soc":
        return {"%": (0.01 * count, 0.0), "percent": (0.01 * count, 0.0), "pct": (0.01 * count, 0.0)}.get(low)
    if kind == "temperature":
        conversion = _TEMPERATURES.get(low.replace("�", "°").replace("º", "°").replace("â", ""))
        return (conversion[0] * count, conversion[1]) if conversion else None
    base = _BASE.get(kind, "")
    low = _WORDS.get(low, low).replace("ω", "ohm").replace("ohms", "ohm")
    if not base or not low.endswith(base):
        return None
    prefix = text[: len(low) - len(base)] if len(text) == len(low) else low[: -len(base)]
    factor = _PREFIX.get(prefix, _PREFIX.get(prefix.lower()))
    return None if factor is None else (factor * count, 0.0)


def _count(text: str) -> tuple[float, str]:
    """A number in front of the unit, as in 0.1mV or 100uV."""
    match = re.match(r"(\d+(?:[.,]\d+)?)[*x]?(.+)", text)
    return (float(match[1].replace(",", ".")), match[2]) if match else (1.0, text)


_UNITS = {
    "voltage": VOLTAGE_UNITS,
    "temperature": TEMPERATURE_UNITS,
    "resistance": RESISTANCE_UNITS,
    "current": CURRENT_UNITS,
    "pack_voltage": VOLTAGE_UNITS,
    "charger_voltage": VOLTAGE_UNITS,
    "charger_current": CURRENT_UNITS,
    "soc": SOC_UNITS,
}
_MOST_MULTIPLEXED = 65536
_MOST_NAMED = 6


@dataclass(frozen=True, slots=True)
class SignalBinding:
    """Values of one layout of one message, and which channel each is of. A channel is a cell, a sensor, or 0."""

    kind: str
    can_id: int
    signal: str
    layout: BitLayout  # with the profile's unit, scale and offset
    conditions: tuple[MultiplexCondition, ...] = ()
    index: int = 0  # index of the channel, unless one of the next two has it
    multiplexer: str = ""  # signal whose raw number tells the channel by `table`
    table: IntArray | None = None  # -1: no channel
    numbers: tuple[tuple[str, SignalDefinition], ...] = ()  # parts that the frame tells
    named_parts: dict[str, int] = field(default_factory=dict, hash=False)  # parts that the names tell
    entry: CellSignals | None = None
    flag: SignalDefinition | None = None  # tells whether the value is valid
    flag_when_valid: bool = False  # it is not 0 where the value is valid
    signal_names: tuple[str, ...] = ()  # all signals of this binding


@dataclass(frozen=True, slots=True)
class BindingIssue:
    """A part of a profile that does not fit the definitions."""

    line: int | None  # line number in the profile
    field: str
    what: Text


@dataclass(frozen=True, slots=True)
class SignalBindings:
    """All lanes of a profile, and what did not fit."""

    by_id: dict[int, tuple[SignalBinding, ...]]
    messages: dict[int, MessageDefinition]
    troubles: tuple[BindingIssue, ...]
    sizes: dict[str, int]  # channels of each kind
    segments: dict[str, tuple[int, ...]]  # channels of each pack, by kind


def segments_of(battery: Battery, kind: str) -> tuple[int, ...]:
    """Return how many channels of a kind each pack has; a sensor is of the pack of its first cell."""
    if kind != "temperature":
        return battery.segments
    counts = [0] * battery.n_packs
    for cells in battery.sensors:
        counts[battery.place(cells[0])[0] if cells else 0] += 1
    return tuple(counts)


def channel(entry: CellSignals, segments: tuple[int, ...], parts: dict[str, IntArray]) -> IntArray:
    """Return (n,) the channel that numbers name, -1 where there is none; see `CellSignals`.

    Args:
        entry: base, group_cells and order.
        segments: channels of each pack.
        parts: (n,) numbers by part, as they are spoken.
    """
    at = np.full(len(next(iter(parts.values()))) if parts else 1, entry.first, np.intp)
    if "group" in parts:
        at = at + (parts["group"] - entry.base.get("group", 0)) * entry.group_cells
    if "cell" in parts:
        at = at + (parts["cell"] - entry.base.get("cell", 0))
    total = sum(segments)
    if "pack" in parts:
        pack = parts["pack"] - entry.base.get("pack", 0)
        is_one = (pack >= 0) & (pack < len(segments))
        pack = np.where(is_one, pack, 0)
        starts = np.concatenate([[0], np.cumsum(segments)])[:-1]
        is_one &= (at >= 0) & (at < np.array(segments)[pack])
        at = np.where(is_one, starts[pack] + at, -1)
    at = np.where((at >= 0) & (at < total), at, -1)
    if entry.order:
        order = np.array((*entry.order, *range(len(entry.order), total))[:total], np.intp)
        at = np.where(at >= 0, order[at], -1)
    return at.astype(np.intp)


def bind_signals(battery: Battery, source: DbcMapping, definitions: Definitions) -> SignalBindings:
    """Return which bits of which frame are which cell, and what of the profile fits nothing."""
    troubles: list[BindingIssue] = []
    segments = {kind: segments_of(battery, kind) for kind in source.cells}
    bindings: list[SignalBinding] = []
    for kind, entries in source.cells.items():
        for i, entry in enumerate(entries):
            lanes = list(_cell_lanes(kind, entry, segments[kind], definitions, troubles, f"source.{kind}[{i}]"))
            bindings += lanes
    for name in ("current", "pack_voltage", "soc", "charger_voltage", "charger_current"):
        reading: ScalarSignal | None = getattr(source, name)
        if reading is not None:
            bindings += _reading_lanes(name, reading, definitions, troubles)
    for name, state in source.states.items():
        for message, signal in find_signals(definitions, state.signal, troubles, f"source.state.{name}", state.line):
            bindings.append(_lane(f"state.{name}", message, signal))
    for name, limit in battery.limits.items():
        if isinstance(limit, SignalName):
            for message, signal in find_signals(definitions, limit, troubles, f"battery.limits.{name}", None):
                bindings.append(_lane(f"limit.{name}", message, signal))
    merged = _merged(bindings)
    by_id: dict[int, list[SignalBinding]] = defaultdict(list)
    for lane in merged:
        by_id[lane.can_id].append(lane)
    messages = {can_id: m for can_id, m in definitions.by_id().items() if can_id in by_id}
    sizes = {kind: sum(pack) for kind, pack in segments.items()}
    return SignalBindings(
        {can_id: tuple(of_id) for can_id, of_id in by_id.items()}, messages, tuple(troubles), sizes, segments
    )


def _lane(kind: str, message: MessageDefinition, signal: SignalDefinition) -> SignalBinding:
    return SignalBinding(
        kind, message.can_id, signal.name, signal.layout, signal.conditions, signal_names=(signal.name,)
    )


def _cell_lanes(
    kind: Kind,
    entry: CellSignals,
    segments: tuple[int, ...],
    definitions: Definitions,
    troubles: list[BindingIssue],
    path: str,
) -> list[SignalBinding]:
    lanes = []
    try:
        for message in definitions.by_id().values():
            of_message = numbers_in(entry.message, message.name, entry.base)
            if of_message is None:
                continue
            for signal in message.signals:
                named_parts = numbers_in(entry.signal, signal.name, entry.base)
                if named_parts is not None:
                    lanes.append(_cell_lane(kind, entry, message, signal, {**of_message, **named_parts}, segments))
    except PatternError as error:
        troubles.append(BindingIssue(entry.line, f"{path}.signal", error.args[0]))
        return []
    except LookupError as error:
        troubles.append(BindingIssue(entry.line, path, Message("signal-not-in-dbc", name=str(error.args[0]))))
        return []
    if not lanes:
        troubles.append(BindingIssue(entry.line, f"{path}.signal", Message("no-signal-fits", pattern=entry.signal)))
    beyond = [lane.signal for lane in lanes if not lane.numbers and lane.index < 0]
    if beyond:
        what = Message("cell-beyond", n=len(beyond), names=tuple(dict.fromkeys(beyond))[:_MOST_NAMED])
        troubles.append(BindingIssue(entry.line, f"{path}.signal", what))
    return [lane for lane in lanes if lane.numbers or lane.index >= 0]


def _cell_lane(
    kind: Kind,
    entry: CellSignals,
    message: MessageDefinition,
    signal: SignalDefinition,
    named_parts: dict[str, int],
    segments: tuple[int, ...],
) -> SignalBinding:
    texts = {**texts_in(entry.message, message.name), **texts_in(entry.signal, signal.name)}
    numbers = []
    for part, pattern in entry.numbers.items():
        name = filled(pattern, texts)
        of_frame = message.signal(name)
        if of_frame is None:
            raise LookupError(f"{message.name}.{name}")
        numbers.append((part, of_frame))
    index = 0
    if not numbers:
        index = int(
            channel(entry, segments, {part: np.array([named_part]) for part, named_part in named_parts.items()})[0]
        )
    flag_name = filled(entry.valid_signal or entry.invalid_signal, texts)
    flag = message.signal(flag_name)
    if flag_name and flag is None:
        raise LookupError(f"{message.name}.{flag_name}")
    return SignalBinding(
        kind,
        message.can_id,
        signal.name,
        _scaled(kind, signal, entry.unit, entry.scale, entry.offset),
        signal.conditions,
        index,
        numbers=tuple(numbers),
        named_parts=named_parts,
        entry=entry,
        flag=flag,
        flag_when_valid=bool(entry.valid_signal),
        signal_names=(signal.name,),
    )


def _scaled(kind: str, signal: SignalDefinition, unit: str, scale: float = 1.0, offset: float = 0.0) -> BitLayout:
    layout = signal.layout
    if kind in _UNITS:
        factor, zero = (_UNITS[kind][unit], ZERO_AT.get(unit, 0.0)) if unit else conversion(kind, signal.unit)
        layout = replace(layout, scale=layout.scale * factor, offset=layout.offset * factor + zero)
    return replace(layout, scale=layout.scale * scale, offset=layout.offset * scale + offset)


def _reading_lanes(
    name: str, reading: ScalarSignal, definitions: Definitions, troubles: list[BindingIssue]
) -> list[SignalBinding]:
    lanes = []
    for message, signal in find_signals(definitions, reading.signal, troubles, f"source.{name}", reading.line):
        sign = -1.0 if reading.positive == "charge" else 1.0
        layout = _scaled(name, signal, reading.unit)
        layout = replace(layout, scale=sign * layout.scale, offset=sign * (layout.offset - reading.zero))
        lanes.append(replace(_lane(name, message, signal), layout=layout))
    return lanes


def find_signals(
    definitions: Definitions, name: SignalName, troubles: list[BindingIssue], path: str, line: int | None
) -> list[tuple[MessageDefinition, SignalDefinition]]:
    """Return the signal of a name; none or several messages that have it are a trouble, the first counts."""
    matches = [
        (message, signal)
        for message in definitions.by_id().values()
        if name.message in ("", message.name) and (signal := message.signal(name.signal)) is not None
    ]
    if not matches:
        troubles.append(BindingIssue(line, f"{path}.signal", Message("signal-not-in-dbc", name=str(name))))
    elif len(matches) > 1:
        names = tuple(message.name for message, _ in matches)
        troubles.append(BindingIssue(line, f"{path}.signal", Message("signal-of-several", name=str(name), names=names)))
    return matches[:1]


def _merged(lanes: list[SignalBinding]) -> list[SignalBinding]:
    """Lanes of one layout that differ only in the multiplexer's value become one with a table."""
    groups: dict[tuple[object, ...], list[SignalBinding]] = defaultdict(list)
    rest = []
    for lane in lanes:
        one = len(lane.conditions) == 1 and len(lane.conditions[0].values) == 1
        if (
            one
            and lane.entry is not None
            and not lane.numbers
            and 0 <= lane.conditions[0].values[0] < _MOST_MULTIPLEXED
        ):
            flag = lane.flag.layout if lane.flag else None
            multiplexer = lane.conditions[0].multiplexer
            groups[lane.kind, lane.can_id, lane.layout, multiplexer, id(lane.entry), flag].append(lane)
        else:
            rest.append(lane)
    for group in groups.values():
        values = [lane.conditions[0].values[0] for lane in group]
        if len(group) == 1 or len(set(values)) < len(values):
            rest += group
            continue
        table = np.full(max(values) + 2, -1, np.intp)
        table[values] = [lane.index for lane in group]
        names = tuple(lane.signal for lane in group)
        first = replace(group[0], conditions=(), multiplexer=group[0].conditions[0].multiplexer, table=table)
        rest.append(replace(first, signal_names=names))
    return rest
