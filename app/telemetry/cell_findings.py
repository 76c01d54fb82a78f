"""A cell's finding as it is shown: with its words, its band and unix times."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import Annotated, Final, cast, get_args

from app.estimation.health.cell_finding import BAND_SIGMAS, CellFinding, FindingCode
from app.telemetry.events import TripCause
from app.telemetry.fields import Unit
from app.words import Cell, Message, Quantity

Number = float | None
Sensors = tuple[tuple[int, ...], ...]
HOURS_S = 5400.0  # from here on a time is shown in hours


@dataclass(frozen=True, slots=True)
class Finding:
    """A fault of one cell: its size, since when, by which evidence, and how sure it is."""

    code: FindingCode
    cell: int
    message: Message
    evidence: Message  # when, at which current, against which neighbours
    size: Annotated[Number, Unit("", "how much, in `unit`; missing where it has no size", None)]
    low: Annotated[Number, Unit("", "lower end of its band, in `unit`", None)]
    high: Annotated[Number, Unit("", "upper end of its band, in `unit`", None)]
    unit: str
    since: Annotated[float, Unit("s", "when the evidence first sufficed, in unix time", 1)]
    seen: Annotated[float, Unit("s", "the latest evidence, in unix time", 1)]
    current_a: Annotated[Number, Unit("A", "current of that evidence", 1)]
    value: Annotated[Number, Unit("", "what the cell shows, in `unit`", None)]
    usual: Annotated[Number, Unit("", "what its neighbours show, in `unit`", None)]
    neighbours: tuple[int, ...]  # the cells that it was compared with
    confidence: Annotated[float, Unit("1", "probability that it is so", 3)]


def findings_in_words(findings: Iterable[CellFinding], sensors: Sensors | None = None) -> tuple[Finding, ...]:
    """Return findings in their words; what is wrong with a temperature sensor is listed once, with its cells.

    Args:
        findings: by a watch that was fed with unix times.
        sensors: of each temperature sensor the cells that it stands for; None: one a cell.
    """
    listed: list[Finding] = []
    named: set[int] = set()  # sensors
    for finding in findings:
        if not finding.code.startswith("temperature-sensor") or sensors is None:
            listed.append(finding_of(finding))
            continue
        of_cell = [number for number, cells in enumerate(sensors) if finding.cell in cells and number not in named]
        named.update(of_cell)
        listed += [finding_of(finding, _sensor(number, sensors[number])) for number in of_cell[:1]]
    return tuple(listed)


def sensors_of(battery_sensors: Sensors, n_cells: int) -> Sensors | None:
    """Return temperature sensors to name findings by; None where each cell has its own."""
    return None if battery_sensors == tuple((cell,) for cell in range(n_cells)) else battery_sensors


def _sensor(number: int, cells: tuple[int, ...]) -> Message:
    return Message("sensor-of-cells", sensor=number + 1, first=Cell(cells[0]), last=Cell(cells[-1]), n=len(cells))


def finding_of(finding: CellFinding, name: Message | None = None) -> Finding:
    """Return a finding of a watch that was fed with unix times; `name` takes the place of the cell's name."""
    low, high = finding.band
    return Finding(
        code=finding.code,
        cell=finding.cell,
        message=what_of(finding, name),
        evidence=evidence_of(finding),
        size=_finite(finding.size),
        low=_finite(low) if isfinite(finding.size) else None,
        high=_finite(high),
        unit=finding.unit,
        since=finding.since_s,
        seen=finding.seen_s,
        current_a=_finite(finding.current_a),
        value=_finite(finding.value),
        usual=_finite(finding.usual),
        neighbours=finding.neighbours,
        confidence=finding.confidence,
    )


_SIZED: Final = (
    "joint-resistance-high",
    "cell-resistance-high",
    "capacity-low",
    "self-discharge-high",
    "cell-imbalance",
    "cell-voltage-noisy",
    "external-heating",
)  # their message has no argument but the size


def agreeing(findings: Iterable[Finding], causes: Sequence[TripCause]) -> tuple[Finding, ...]:
    """Return findings that agree with the verdicts on trips: of a cell that one explains there is that finding alone.

    It has the verdict's size, band and confidence; where the judge of the cells has not found it yet, it is added.
    """
    by_time = sorted(causes, key=lambda cause: cause.judged or 0.0)  # the newest counts
    explained = {cause.cell: cause for cause in by_time if cause.cell is not None and cause.code != "unknown"}
    listed: list[Finding] = []
    for finding in findings:
        cause = explained.get(finding.cell)
        if cause is None:
            listed.append(finding)
        elif cause.code == finding.code:
            listed.append(_by_verdict(cause, finding))
    named = {finding.cell for finding in listed}
    left = [cause for cell, cause in explained.items() if cell not in named and cause.code in get_args(FindingCode)]
    return (*listed, *(_by_verdict(cause, None) for cause in left))


def _by_verdict(cause: TripCause, by_judge: Finding | None) -> Finding:
    """The verdict on a trip as a finding of its cell; `known` by the judge of the cells, None: not found by it."""
    assert cause.cell is not None
    sure = Quantity(100 * cause.confidence, "%", 0)
    by_recording = Message("evidence-verdict", sure=sure)
    since, judged = cause.since or 0.0, cause.judged or 0.0
    if by_judge is None:
        by_judge = Finding(
            code=cast(FindingCode, cause.code),
            cell=cause.cell,
            message=cause.message,
            evidence=by_recording,
            size=None,
            low=None,
            high=None,
            unit=cause.unit,
            since=since,
            seen=judged,
            current_a=None,
            value=None,
            usual=None,
            neighbours=(),
            confidence=cause.confidence,
        )
    message, evidence = (
        by_judge.message,
        by_recording if by_judge.size != cause.size else by_judge.evidence.having(sure=sure),
    )
    size, high = cause.size, cause.high
    if size is not None and high is not None and cause.code in _SIZED:
        nan, sigma = float("nan"), (high - size) / BAND_SIGMAS
        arguments = (by_judge.code, cause.cell, size, sigma, cause.unit, since, judged, nan, nan, nan, nan, (), nan)
        message = what_of(CellFinding(*arguments))
    return replace(
        by_judge,
        message=message,
        evidence=evidence,
        size=by_judge.size if size is None else size,
        low=by_judge.low if size is None else cause.low,
        high=by_judge.high if size is None else high,
        confidence=cause.confidence,
    )


def size_of(code: str, size: float) -> Quantity | None:
    """Return a size as it is shown; None of what has none that says more than its name."""
    match code:
        case "joint-resistance-high" | "cell-resistance-high":
            return _milliohm(size)
        case "capacity-low" | "cell-imbalance":
            return _percent(size)
        case "self-discharge-high":
            return _leak(size)
        case "cell-voltage-noisy":
            return Quantity(1000 * size, "mV", 0)
        case "external-heating":
            return Quantity(size, "W", 0)
    return None


def what_of(finding: CellFinding, name: Message | None = None) -> Message:
    """Return what is wrong, with the cell's name, or another one, and the size."""
    cell, (low, high) = name or Cell(finding.cell), finding.band
    match finding.code:
        case "joint-resistance-high":
            size, band = _milliohm(finding.size), _span(1000 * low, 1000 * high, "mohm")
            return Message("finding-joint-resistance-high", cell=cell, size=size, band=band)
        case "cell-resistance-high":
            size, band = _milliohm(finding.size), _span(1000 * low, 1000 * high, "mohm")
            return Message("finding-cell-resistance-high", cell=cell, size=size, band=band)
        case "capacity-low":
            size, band = _percent(finding.size), _span(100 * low, min(100 * high, 100.0), "%")
            return Message("finding-capacity-low", cell=cell, size=size, band=band)
        case "self-discharge-high":
            size, band = _leak(finding.size), _leak_span(low, high)
            return Message(
                "finding-self-discharge-high", cell=cell, size=size, band=band, resistance=_leak_ohm(finding.size)
            )
        case "temperature-sensor-open":
            return Message("finding-temperature-sensor-open", cell=cell)
        case "temperature-sensor-fault":
            shown, usual = Quantity(finding.value, "degC", 0), Quantity(finding.usual, "degC", 0)
            return Message("finding-temperature-sensor-fault", cell=cell, shown=shown, usual=usual)
        case "cell-voltage-missing":
            return Message("finding-cell-voltage-missing", cell=cell)
        case "cell-voltage-stuck":
            shown, moved = Quantity(finding.value, "V", 3), Quantity(finding.size, "V", 2)
            return Message("finding-cell-voltage-stuck", cell=cell, shown=shown, moved=moved)
        case "cell-voltage-noisy":
            return Message("finding-cell-voltage-noisy", cell=cell, size=Quantity(1000 * finding.size, "mV", 0))
        case "sense-wire-open":
            return Message("finding-sense-wire-open", cell=cell)
        case "cell-imbalance":
            return Message("finding-cell-imbalance", cell=cell, size=_percent(finding.size))
        case "external-heating":
            return Message("finding-external-heating", cell=cell, heat=Quantity(finding.size, "W", 0))


def evidence_of(finding: CellFinding) -> Message:
    """Return its evidence: how long, at which current, against which neighbours, and how sure that is."""
    lasted, sure = _time(finding.evidence_s), Quantity(100 * finding.confidence, "%", 0)
    others = _neighbour_range(finding.neighbours)
    current = Quantity(finding.current_a, "A", 0)
    match finding.code:
        case "joint-resistance-high" | "cell-resistance-high":
            value, usual = _milliohm(finding.value), _milliohm(finding.usual)
            return Message(
                "evidence-resistance",
                lasted=lasted,
                current=current,
                value=value,
                usual=usual,
                others=others,
                sure=sure,
            )
        case "capacity-low":
            return Message("evidence-charge", lasted=lasted, current=current, others=others, sure=sure)
        case "self-discharge-high":
            return Message("evidence-drift", lasted=lasted, current=current, others=others, sure=sure)
        case _:
            return Message("evidence-sensor", lasted=lasted, others=others, sure=sure)


def _neighbour_range(cells: tuple[int, ...]) -> Message:
    if not cells:
        return Message("evidence-others-none")
    return Message("evidence-others", n=len(cells), first=Cell(cells[0]), last=Cell(cells[-1]))


def _finite(value: float) -> Number:
    return value if isfinite(value) else None


def _milliohm(ohm: float) -> Quantity:
    return Quantity(1000 * ohm, "mohm", 2)


def _percent(fraction: float) -> Quantity:
    return Quantity(100 * fraction, "%", 0)


def _span(low: float, high: float, unit: str) -> Message:
    digits = 2 if unit == "mohm" else 0
    return Message("finding-band", low=Quantity(low, "", digits), high=Quantity(high, unit, digits))


def _leak(ampere: float) -> Quantity:
    return Quantity(1000 * ampere, "mA", 0) if ampere < 1.0 else Quantity(ampere, "A", 1)


def _leak_span(low_a: float, high_a: float) -> Message:
    if high_a < 1.0:
        return Message("finding-band", low=Quantity(1000 * low_a, "", 0), high=Quantity(1000 * high_a, "mA", 0))
    return Message("finding-band", low=Quantity(low_a, "", 1), high=Quantity(high_a, "A", 1))


def _leak_ohm(ampere: float) -> Quantity:
    ohm = 3.7 / max(ampere, 1e-6)
    return Quantity(ohm, "ohm", 0 if ohm >= 10.0 else 1)


def _time(seconds: float) -> Quantity:
    if seconds < 120.0:
        return Quantity(seconds, "s", 0)
    return Quantity(seconds / 60, "min", 0) if seconds < HOURS_S else Quantity(seconds / 3600, "h", 1)
