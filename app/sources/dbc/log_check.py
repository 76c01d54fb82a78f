"""Checks of a profile by a log: values that cannot be, signs, sums, channels that are not received."""

from collections.abc import Iterator

import numpy as np

from app.battery.battery import Battery
from app.estimation.arrays import FloatArray
from app.sources.dbc.battery_decoder import ABSENT_DEGC, BatteryDecoder, ChannelValues
from app.sources.dbc.current_sign import CLEAR, VoltageSeries, cells_together, step_correlation, wraps
from app.sources.dbc.decoder import MessageFrames
from app.sources.dbc.definitions import Definitions, SignalDefinition
from app.sources.dbc.frames import Frames
from app.sources.dbc.overwritten import overwritten_issues
from app.words import Message, Quantity, Text

BRIDGED_S = 10.0  # what the filter can go without a cell's voltage before its figures are not shown
SUM_OFF = 0.02  # share of the pack voltage
MOST_A = 3000.0  # more than any battery of a vehicle carries
_PLAUSIBLE_V = (1.0, 5.0)
_STILL_S = (45.0, 600.0)  # a reading of fine, and of coarse, resolution moves within so long
_FINE_DEGC = 0.11  # a resolution below is fine
_MANY, _LEAST_VALUES = 4, 10  # sensors, and values of one
_SHOWN = 8


def log_issues(decoder: BatteryDecoder, frames: Frames, definitions: Definitions) -> Iterator[tuple[str, Text]]:
    """Yield field and text of what the frames of a log show against a profile."""
    if not len(frames):
        yield "log", Message("check-empty-log")
        return
    values = decoder.decode(frames)
    yield from _of_current(decoder, frames, values)
    yield from overwritten_issues(decoder, frames, values, definitions)
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
    if decoder.absent.any():
        numbers, n = listed(np.flatnonzero(decoder.absent).tolist()), int(np.count_nonzero(decoder.absent))
        what = Message("check-absent", n=n, numbers=numbers, values=int(decoder.absent.sum()), degc=ABSENT_DEGC)
        yield "source.temperature", what
    yield from _of_sum(decoder.battery, values)


def _of_current(
    decoder: BatteryDecoder, frames: Frames, values: dict[str, ChannelValues]
) -> Iterator[tuple[str, Text]]:
    """A sign that the definition left out, more than a battery carries, or steps with the voltage, not against it."""
    current, reading = values.get("current"), decoder.source.current
    if current is None or reading is None:
        return
    name = str(reading.signal)
    most = float(np.nanmax(np.abs(current.value), initial=0.0))
    signal = _unsigned(decoder, frames)
    if signal is not None:
        what = Message("check-unsigned-current", name=name, most=Quantity(most, "A", 1))
        yield "source.current", what
        return
    if most > MOST_A:
        yield "source.current", Message("check-current-implausible", name=name, most=Quantity(most, "A", 1))
        return
    together = _steps_with_voltage(decoder.battery, current, values)
    if together >= CLEAR:
        positive = "charge" if reading.positive == "discharge" else "discharge"
        correlation = Quantity(together, "", 2)
        yield "source.current", Message("check-wrong-sign", name=name, correlation=correlation, positive=positive)


def _unsigned(decoder: BatteryDecoder, frames: Frames) -> SignalDefinition | None:
    """The signal of the current, where its definition is unsigned and its raw numbers are not."""
    for can_id, bindings in decoder.lanes.by_id.items():
        message = decoder.lanes.messages[can_id]
        for binding in bindings:
            signal = message.signal(binding.signal) if binding.kind == "current" else None
            if signal is None or signal.layout.end_byte > frames.data.shape[1]:
                continue
            group = MessageFrames(message, frames.part(np.flatnonzero(frames.can_id == can_id)))
            carrying = group.carrying(signal)
            raw = group.raw(signal.name)
            if wraps(raw if carrying is None else raw[carrying], signal.layout):
                return signal
    return None


def _steps_with_voltage(battery: Battery, current: ChannelValues, values: dict[str, ChannelValues]) -> float:
    """Correlation of steps, by the cells, else by the pack voltage; 0 where neither shows it."""
    together = 0.0
    if "voltage" in values:
        together = step_correlation(current.t_ns, current.value, cells_together(values["voltage"], battery.n_cells))
    if abs(together) < CLEAR and "pack_voltage" in values:
        pack = values["pack_voltage"]
        together = step_correlation(current.t_ns, current.value, VoltageSeries(pack.t_ns, pack.value))
    return together


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
        yield field, Message("check-cells-not-received", kind=kind, numbers=listed(silent), n=len(silent))
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
    if kind == "temperature":
        yield from _still(decoder, values, size)
    if kind == "voltage":
        low, high = _PLAUSIBLE_V
        wrong = is_finite & ((values.value < low) | (values.value > high))
        if wrong.any():
            cells = sorted(set(values.index[wrong].tolist()))
            worst = Quantity(float(values.value[wrong][0]), "V", 3)
            yield field, Message("check-implausible", numbers=listed(cells), n=len(cells), worst=worst)


def _still(decoder: BatteryDecoder, values: ChannelValues, size: int) -> Iterator[tuple[str, Text]]:
    """Sensors that read one number all the time: a sensor of fine resolution never does, many never read the same."""
    is_measured = np.isfinite(values.value)
    index, degc = values.index[is_measured], values.value[is_measured]
    lowest, highest = np.full(size, np.inf), np.full(size, -np.inf)
    np.minimum.at(lowest, index, degc)
    np.maximum.at(highest, index, degc)
    still = np.flatnonzero((lowest == highest) & (np.bincount(index, minlength=size) >= _LEAST_VALUES))
    span_s = float(np.ptp(values.t_ns)) / 1e9 if len(values.t_ns) else 0.0
    bindings = [binding for of_id in decoder.lanes.by_id.values() for binding in of_id if binding.kind == "temperature"]
    is_fine = all(abs(binding.layout.scale) < _FINE_DEGC for binding in bindings)
    are_one = len(still) == size >= _MANY and np.ptp(lowest) == 0
    if len(still) and span_s >= _STILL_S[not (is_fine or are_one)]:
        reads, span = Quantity(float(lowest[still[0]]), "degC", 1), Quantity(span_s, "s", 0)
        what = Message("check-never-moves", n=len(still), numbers=listed(still.tolist()), reads=reads, span=span)
        yield "source.temperature", what


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


def listed(indices: list[int]) -> Text:
    """Return numbers from 1, runs as from-to, shortened."""
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
