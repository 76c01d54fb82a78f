"""Errors and warnings about a profile, its DBC, and what a log says of both."""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from app.battery.battery import Battery
from app.battery.source import DbcMapping
from app.estimation.arrays import FloatArray
from app.sources.dbc.battery_decoder import BatteryDecoder, ChannelValues
from app.sources.dbc.bindings import SignalBindings
from app.sources.dbc.definitions import Definitions
from app.sources.dbc.frames import Frames
from app.words import Message, Quantity, Text

BRIDGED_S = 10.0  # what the filter can go without a cell's voltage before its figures are not shown
SUM_OFF = 0.02  # share of the pack voltage
_PLAUSIBLE_V = (1.0, 5.0)
_ERRORS = ("no-signal-fits", "signal-not-in-dbc", "no-such-placeholder", "pattern-too-long")
_SHOWN = 8


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
    """Return what is doubtful, errors first.

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
        issues += [ProfileIssue(file, None, field, what) for field, what in _of_log(decoder, frames)]
    return sorted(issues, key=lambda issue: not issue.is_error)


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
            yield f"source.{kind}", Message("check-without-signal", kind=kind, numbers=_listed(missing), n=len(missing))
        for i, names in signals.items():
            if len(names) > 1:
                yield f"source.{kind}", Message("check-two-signals", kind=kind, number=i + 1, names=tuple(names[:4]))
    if battery.sensors:
        without = sorted(set(range(battery.n_cells)) - {cell for cells in battery.sensors for cell in cells})
        if without:
            yield "battery.temperatures", Message("check-no-sensor", numbers=_listed(without), n=len(without))
        empty = [i for i, cells in enumerate(battery.sensors) if not cells]
        if empty:
            yield "battery.temperatures", Message("check-sensor-of-nothing", numbers=_listed(empty), n=len(empty))
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


def _of_log(decoder: BatteryDecoder, frames: Frames) -> Iterator[tuple[str, Text]]:
    if not len(frames):
        yield "log", Message("check-empty-log")
        return
    values = decoder.decode(frames)
    for kind, size in decoder.lanes.sizes.items():
        yield from _of_channels(decoder, kind, size, values.get(kind))
    for name in ("current", "pack_voltage", "soc"):
        reading = getattr(decoder.source, name)
        if reading is not None and name not in values:
            yield f"source.{name}", Message("check-not-received", name=str(reading.signal))
    if decoder.bad_checksums:
        yield "source.voltage", Message("check-bad-checksums", n=decoder.bad_checksums)
    for name, count in decoder.beyond.items():
        yield "source", Message("check-numbers-beyond", name=name, n=count)
    yield from _of_sum(decoder.battery, values)


def _of_channels(
    decoder: BatteryDecoder, kind: str, size: int, values: ChannelValues | None
) -> Iterator[tuple[str, Text]]:
    field = f"source.{kind}"
    if values is None:
        yield field, Message("check-nothing-of-it", kind=kind)
        return
    is_finite = np.isfinite(values.value)
    received = np.bincount(values.index[is_finite], minlength=size)
    silent = np.flatnonzero(received == 0).tolist()
    if silent:
        yield field, Message("check-cells-not-received", kind=kind, numbers=_listed(silent), n=len(silent))
    if kind not in ("voltage", "temperature"):
        return
    periods_s = _periods(values, size)
    slow = np.flatnonzero(periods_s > BRIDGED_S)
    if len(slow) and kind == "voltage":
        longest = Quantity(float(np.nanmax(periods_s)), "s", 1)
        yield field, Message("check-slow", n=len(slow), longest=longest, bridged=Quantity(BRIDGED_S, "s"))
    for entry in decoder.source.cells.get(kind, ()):
        if entry.max_age_s is not None and np.nanmax(periods_s, initial=0.0) > entry.max_age_s:
            longest = Quantity(float(np.nanmax(periods_s)), "s", 2)
            yield f"{field}.max_age_s", Message("check-age-too-short", age=entry.max_age_s, longest=longest)
    if kind == "voltage":
        low, high = _PLAUSIBLE_V
        wrong = is_finite & ((values.value < low) | (values.value > high))
        if wrong.any():
            cells = sorted(set(values.index[wrong].tolist()))
            worst = Quantity(float(values.value[wrong][0]), "V", 3)
            yield field, Message("check-implausible", numbers=_listed(cells), n=len(cells), worst=worst)


def _periods(values: ChannelValues, size: int) -> FloatArray:
    """(size,) median time between two values of a channel [s], NaN where it was received less than twice."""
    order = np.lexsort((values.t_ns, values.index))
    index, t_ns = values.index[order], values.t_ns[order]
    same = index[1:] == index[:-1]
    gaps, of = (np.diff(t_ns) / 1e9)[same], index[1:][same]
    periods_s = np.full(size, np.nan)
    for i in np.unique(of):
        periods_s[i] = np.median(gaps[of == i])
    return periods_s


def _of_sum(battery: Battery, values: dict[str, ChannelValues]) -> Iterator[tuple[str, Text]]:
    if "voltage" not in values or "pack_voltage" not in values:
        return
    cells = values["voltage"]
    is_finite = np.isfinite(cells.value)
    count = np.bincount(cells.index[is_finite], minlength=battery.n_cells)
    if not (count > 0).all():
        return
    total = np.bincount(cells.index[is_finite], weights=cells.value[is_finite], minlength=battery.n_cells)
    sum_v, pack_v = float((total / count).sum()), float(np.nanmean(values["pack_voltage"].value))
    if pack_v and abs(sum_v - pack_v) > SUM_OFF * abs(pack_v):
        yield (
            "source.pack_voltage",
            Message("check-sum-off", sum=Quantity(sum_v, "V", 1), pack=Quantity(pack_v, "V", 1)),
        )


def _listed(indices: list[int]) -> Text:
    """Numbers from 1, runs as from-to, shortened."""
    runs: list[str] = []
    start = before = None
    for i in [*(index + 1 for index in indices), None]:
        if before is not None and i == before + 1:
            before = i
            continue
        if start is not None:
            runs.append(f"{start}" if start == before else f"{start}-{before}")
        start = before = i
    return ", ".join(runs[:_SHOWN]) + (", ..." if len(runs) > _SHOWN else "")
