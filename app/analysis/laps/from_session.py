"""The laps of a session: as somebody settled them, else found again out of the file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from app.analysis.laps.detection import laps_by_marks, laps_by_pattern, rises_s, stints
from app.analysis.laps.figures import DriverFigures, Lap, LapFigures, compare_drivers, figures_of, overlay, with_drivers
from app.analysis.laps.place import Ways
from app.analysis.session_survey import read_totals
from app.analysis.totals import Totals, number
from app.errors import ConfigError
from app.estimation.arrays import FloatArray
from app.sessions.errors import NotASession
from app.sessions.info import Marker
from app.sessions.reading.reader import MAX_POINTS, SessionFile
from app.sessions.reading.session_info import write_note
from app.words import Message

Source = Literal["settled", "markers", "pattern", "can", "signal"]
NOTE = "laps"
LAP_KINDS = ("lap", "laps")
DRIVER_KIND = "driver"  # and kinds that begin with it
TOTALS = {"power_w": "W", "current_a": "A", "voltage_v": "V", "v_min_v": "V", "t_max_degc": "degC", "soc": "1"}
MAX_LAPS = 2000
SAMPLES_A_PART = 2  # samples a part of overlaid laps: a part without one is a gap; by distance the double
MAX_TEXT = 200


@dataclass(frozen=True)
class CanCounter:
    """A byte of a CAN frame that goes up when a lap begins: a lap counter, or the bit of a beacon."""

    can_id: int  # bit 31 marks a 29-bit id
    byte: int
    mask: int = 0xFF


@dataclass(frozen=True)
class CounterSamples:
    """A number that goes up when a lap begins, as somebody decoded it: (n,) rising unix times [s] and values."""

    time_s: FloatArray
    values: FloatArray


Counter = CanCounter | CounterSamples | str  # the name of a signal of the session that goes up in the same way


@dataclass(frozen=True)
class LapTrace:
    """One signal over equal parts of a lap; None where there is no sample."""

    lap: int
    minimum: list[float | None]
    maximum: list[float | None]


@dataclass(frozen=True)
class Overlay:
    """Laps on each other: part k of every lap begins at k / points of its way, or of its time."""

    signal: str
    unit: str
    points: int
    laps: list[LapTrace]
    along: str | None  # the speed or place that tells the way; None: by time
    places: list[str]  # signals that sound like one


@dataclass(frozen=True)
class LapTable:
    """Laps with what they cost, and where they come from."""

    source: Source
    laps: list[LapFigures]
    drivers: list[DriverFigures]


def lap_table(session: SessionFile, source: Source | None = None, counter: Counter | None = None) -> LapTable:
    """Return the laps of a session with their figures.

    Without a source the first that there is counts: what was settled, the markers of kind `lap`, the pattern of the
    power.

    Raises:
        ConfigError: the source needs a counter or a signal, which was not named.
        UnknownSignal: the name means nothing.
        NotASession: what the file keeps as settled laps is no table of laps.
    """
    totals = read_totals(session)
    chosen, laps = find_laps(session, totals, source, counter)
    figures = [figures_of(lap, totals) for lap in laps]
    return LapTable(chosen, figures, compare_drivers(figures))


def lap_times(session: SessionFile) -> list[float]:
    """Return the unix times at which laps meet: as they were settled, else all marks, else as seen in the power.

    Every mark counts here, also those before and after a stop, between which there is no lap that could be compared. A
    single mark counts where the power tells nothing.
    """
    source, laps = find_laps(session, read_totals(session), None, None)
    if source == "markers" or (source == "pattern" and not laps):
        return sorted(set(_marks(session.markers(), session)))
    ends = {lap.end_s for lap in laps if not lap.is_partial}  # where a lap was cut off, none meet
    return sorted({lap.start_s for lap in laps} | ends)


def find_laps(
    session: SessionFile, totals: Totals, source: Source | None, counter: Counter | None
) -> tuple[Source, list[Lap]]:
    """Return where the laps come from, and them."""
    if source in (None, "settled"):
        settled = session.note(NOTE)
        if settled is not None:
            return "settled", _from_note(settled, session)
        if source == "settled":
            return "settled", []
    markers = session.markers()
    marks = _marks(markers, session)
    if source == "can":
        if isinstance(counter, CanCounter):
            counter = _counted(session, counter)
        if not isinstance(counter, CounterSamples):
            raise ConfigError("can_id", None, Message("name-lap-frame"))
        marks = rises_s(counter.time_s, counter.values)
    elif source == "signal":
        if not isinstance(counter, str):
            raise ConfigError("lap_signal", None, Message("name-lap-signal"))
        risen = _sampled(session, counter)
        marks = rises_s(risen.time_s, risen.values)
    elif source is None:
        source = "markers" if len(marks) > 1 else "pattern"
    power_w = totals.power_w
    if source == "pattern":
        pattern_laps = laps_by_pattern(totals.time_s, power_w)
        laps = [Lap(start, end, counts=not partial, is_partial=partial) for start, end, partial in pattern_laps]
    else:
        laps = [Lap(*span) for span in laps_by_marks(marks, stints(totals.time_s, power_w))]
    return source, with_drivers(laps, driver_changes(session, markers))


def _marks(markers: Sequence[Marker], session: SessionFile) -> list[float]:
    return [session.unix_s(marker.t_mono_ns) for marker in markers if marker.kind in LAP_KINDS]


def driver_changes(session: SessionFile, markers: Sequence[Marker]) -> list[tuple[float, str]]:
    """Return when somebody took over and who: markers of kind `driver`, and the driver named at the start."""
    changes = [
        (session.unix_s(marker.t_mono_ns), _driver_name(marker.text))
        for marker in markers
        if marker.kind.startswith(DRIVER_KIND)
    ]
    first = session.info.metadata.get("driver")
    return [(0.0, str(first)), *changes] if first else changes


def overlay_laps(
    session: SessionFile,
    laps: Sequence[Lap],
    chosen: Sequence[int],
    signal: str,
    points: int,
    along: str | None = None,
) -> Overlay:
    """Return one signal over the chosen laps, place by place.

    Args:
        session: that the laps are of.
        laps: all of it.
        chosen: their indices from 0.
        signal: one of TOTALS, or any signal of the session.
        points: parts of a lap, at most; fewer where a lap has fewer than SAMPLES_A_PART samples in each.
        along: see `Ways`.

    Raises:
        ConfigError: there is no such lap, or `along` tells no way.
        UnknownSignal: the name means nothing.
    """
    recorded = []
    unit = TOTALS.get(signal, "")
    for index in chosen:
        if not 0 <= index < len(laps):
            raise ConfigError("lap", index, f"0..{len(laps) - 1}" if laps else Message("no-laps"))
        lap = laps[index]
        if signal in TOTALS:
            totals = read_totals(session, lap.start_s, lap.end_s)
            time_s, values = totals.time_s, getattr(totals, signal)
        else:
            series = session.series([signal], lap.start_s, lap.end_s, points=MAX_POINTS)[signal]
            time_s, values, unit = series.time_s, series.maximum, series.unit
        recorded.append((index, time_s, values))
    ways = Ways(session, [laps[index] for index in chosen], along)
    fewest = min((len(time_s) for _, time_s, _ in recorded), default=0)
    points = max(1, min(points, fewest // (SAMPLES_A_PART * (2 if ways.along else 1))))
    traces = []
    for k, (index, time_s, values) in enumerate(recorded):
        low, high = overlay(laps[index], time_s, values, points, ways.shares(k, time_s)).T
        traces.append(LapTrace(index, *([number(v) for v in side.tolist()] for side in (low, high))))
    return Overlay(signal, unit, points, traces, ways.along, ways.places)


def settle_laps(path: Path, laps: Sequence[Lap] | None, *, t_wall_ns: int, who: str | None) -> None:
    """Keep laps in the session's file; None takes them back, so that they are found again.

    Raises:
        ConfigError: too many, one that ends before it begins, or two that overlap; names the lap.
        SessionError: the file cannot take it.
    """
    value: Any = None
    if laps is not None:
        value = [asdict(lap) for lap in _checked(laps)]
    write_note(path, NOTE, value, t_wall_ns=t_wall_ns, who=who)


def _checked(laps: Sequence[Lap]) -> list[Lap]:
    if len(laps) > MAX_LAPS:
        raise ConfigError("laps", len(laps), Message("at-most", value=MAX_LAPS))
    ordered = sorted(laps, key=lambda lap: lap.start_s)
    for count, lap in enumerate(ordered, 1):
        if not lap.end_s > lap.start_s:
            raise ConfigError(f"laps[{count}].end", lap.end_s, Message("after-start", start=str(lap.start_s)))
        if len(lap.driver) > MAX_TEXT or len(lap.note) > MAX_TEXT:
            raise ConfigError(f"laps[{count}]", "(text)", Message("driver-and-note", count=MAX_TEXT))
        if count < len(ordered) and ordered[count].start_s < lap.end_s - 1e-6:
            limit = Message("not-before", time=str(lap.end_s))
            raise ConfigError(f"laps[{count + 1}].start", ordered[count].start_s, limit)
    return ordered


def _from_note(rows: Any, session: SessionFile) -> list[Lap]:
    """Return settled laps as the file holds them.

    Raises:
        NotASession: another program wrote something else there.
    """
    try:
        laps = [Lap(**row) for row in rows]
        return _checked([replace(lap, start_s=float(lap.start_s), end_s=float(lap.end_s)) for lap in laps])
    except (TypeError, ValueError, ConfigError) as error:
        raise NotASession(session.info.id, Message("laps-damaged", error=str(error))) from error


def _counted(session: SessionFile, counter: CanCounter) -> CounterSamples:
    times, values = [], []
    for frame in session.can_frames():
        if frame.can_id == counter.can_id and counter.byte < len(frame.data):
            times.append(session.unix_s(frame.t_mono_ns))
            values.append(frame.data[counter.byte] & counter.mask)
    return CounterSamples(np.array(times), np.array(values, dtype=np.float64))


def _sampled(session: SessionFile, name: str) -> CounterSamples:
    signal = session.signals.find(name)
    (samples,) = session.samples([signal])
    values = signal.physical(samples.counts)
    is_finite = np.isfinite(values)
    times_s = [session.unix_s(int(us) * 1000) for us in samples.track.times_us[is_finite]]
    return CounterSamples(np.array(times_s), values[is_finite])


def _driver_name(text: str) -> str:
    """The name in "Anna", "driver: Anna" or "driver change: Anna"; the text itself where there is no colon."""
    return text.rpartition(":")[2].strip() or text.strip()
