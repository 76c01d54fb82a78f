"""Errors and warnings about a profile, its DBC, and what a log says of both."""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

from app.battery.battery import Battery
from app.battery.source import DbcMapping
from app.sources.dbc.battery_decoder import BatteryDecoder
from app.sources.dbc.bindings import SignalBindings
from app.sources.dbc.definitions import Definitions
from app.sources.dbc.frames import Frames
from app.sources.dbc.log_check import listed, log_issues
from app.words import Message, Quantity, Text

_GRAVEST = (  # warnings in this order, any other after them
    "check-unsigned-current",
    "check-current-implausible",
    "check-wrong-sign",
    "check-overwritten",
    "check-two-messages",
    "check-not-read",
    "check-sum-off",
    "check-implausible",
    "check-never-moves",
)
_ERRORS = ("no-signal-fits", "signal-not-in-dbc", "no-such-placeholder", "pattern-too-long")


@dataclass(frozen=True, slots=True)
class ProfileIssue:
    """One thing to look at; `is_error` = the profile cannot work so."""

    file: str
    line: int | None
    field: str
    what: Text
    is_error: bool = False


def issues_of(
    battery: Battery, source: DbcMapping, definitions: Definitions, file: str, frames: Frames | None
) -> list[ProfileIssue]:
    """Return what is doubtful, errors first, then the gravest.

    Args:
        battery: what the profile says of the battery.
        source: its mapping of signals.
        definitions: of its DBCs.
        file: the profile's name.
        frames: of a log, None where there is none.
    """
    issues = oddities_of(definitions)
    decoder = BatteryDecoder(battery, source, definitions)
    for trouble in decoder.lanes.troubles:
        is_error = isinstance(trouble.what, Message) and trouble.what.code in _ERRORS
        issues.append(ProfileIssue(file, trouble.line, trouble.field, trouble.what, is_error))
    issues += [ProfileIssue(file, None, field, what) for field, what in _of_profile(battery, source, decoder.lanes)]
    if frames is not None:
        issues += [ProfileIssue(file, None, field, what) for field, what in log_issues(decoder, frames, definitions)]
    return sorted(issues, key=_gravity)


def _gravity(issue: ProfileIssue) -> tuple[bool, int]:
    code = issue.what.code if isinstance(issue.what, Message) else ""
    return not issue.is_error, _GRAVEST.index(code) if code in _GRAVEST else len(_GRAVEST)


def oddities_of(definitions: Definitions) -> list[ProfileIssue]:
    """Return what was odd in the DBCs."""
    return [ProfileIssue(oddity.file, oddity.line, "DBC", oddity.what) for oddity in definitions.oddities]


def _of_profile(battery: Battery, source: DbcMapping, lanes: SignalBindings) -> Iterator[tuple[str, Text]]:
    if not source.cells.get("voltage"):
        yield "source.voltage", Message("check-no-voltages")
    if source.current is None:
        yield "source.current", Message("check-no-current")
    for kind, size in lanes.sizes.items():
        signals = _signals_of_channels(lanes, kind)
        is_numbered = any(lane.numbers for bindings in lanes.by_id.values() for lane in bindings if lane.kind == kind)
        missing = [i for i in range(size) if i not in signals]
        if missing and not is_numbered:
            yield f"source.{kind}", Message("check-without-signal", kind=kind, numbers=listed(missing), n=len(missing))
        for i, names in signals.items():
            if len(names) > 1:
                yield f"source.{kind}", Message("check-two-signals", kind=kind, number=i + 1, names=tuple(names[:4]))
    if battery.sensors:
        without = sorted(set(range(battery.n_cells)) - {cell for cells in battery.sensors for cell in cells})
        if without:
            yield "battery.temperatures", Message("check-no-sensor", numbers=listed(without), n=len(without))
        empty = [i for i, cells in enumerate(battery.sensors) if not cells]
        if empty:
            yield "battery.temperatures", Message("check-sensor-of-nothing", numbers=listed(empty), n=len(empty))
    yield from _of_rules(battery)


def _of_rules(battery: Battery) -> Iterator[tuple[str, Text]]:
    highest = battery.limits.get("cell_voltage_max_v")
    for name, rule in battery.rules.items():
        limit = battery.limits.get(name)
        if isinstance(limit, float) and (limit < rule if "_min_" in name else limit > rule):
            yield f"battery.limits.{name}", Message("check-beyond-rule", limit=limit, rule=rule)
        cells = {"segment_voltage_max_v": max(battery.segments), "pack_voltage_max_v": battery.n_cells}.get(name)
        if cells is not None and isinstance(highest, float) and cells * highest > rule:
            full = Quantity(cells * highest, "V", 1)
            yield f"battery.rules.{name}", Message("check-cells-beyond-rule", cells=cells, full=full, rule=rule)


def _signals_of_channels(lanes: SignalBindings, kind: str) -> dict[int, list[str]]:
    """The signals that tell each channel, where names or multiplexers tell it."""
    signals: dict[int, list[str]] = defaultdict(list)
    for can_id, bindings in lanes.by_id.items():
        message = lanes.messages[can_id].name
        for lane in bindings:
            if lane.kind != kind or lane.numbers:
                continue
            channels = [lane.index] if lane.table is None else [int(i) for i in lane.table if i >= 0]
            names = lane.signal_names if lane.table is not None else (lane.signal,)
            if lane.table is None:
                signals[lane.index].append(f"{message}.{names[0]}")
            else:
                for i in channels:
                    signals[i].append(message)
    return signals
