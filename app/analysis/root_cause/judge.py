"""From hypotheses to causes: what explains each trip, and what is wrong without one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from app.analysis.incidents import Trigger
from app.analysis.root_cause.recording import Hypothesis, pack_of, pack_of_event
from app.estimation.health.cell_finding import BAND_SIGMAS
from app.telemetry import PossibleCause, TripCause
from app.telemetry.cell_findings import size_of
from app.words import Cell, Message, Pack, RenderedMessage, condition, condition_of, rendered_from_json, sentence

LATE_S: Final = 1.5  # what is seen first after a trip may have been there before it
ENOUGH: Final = 6.0  # log odds from which a hypothesis without a trip is reported
SURE_WHEN_EMPTY: Final = 40.0
CONFIDENT: Final = 0.99
TEMPER: Final = 4.0  # the odds are products of models; they count by so much less
UNEXPLAINED: Final = "unknown"  # code of a cause that is none
MOST_OTHERS: Final = 4
LEAST_OTHER: Final = 0.02

_CELL = (
    "joint-resistance-high",
    "cell-resistance-high",
    "capacity-low",
    "self-discharge-high",
    "cell-imbalance",
    "cell-voltage-stuck",
    "cell-voltage-noisy",
)
_BOARD = ("isospi-noise", "slave-reference-drift", "slave-adc-fault", "slave-multiplexer-fault", "slave-lost")
_SENSORS = ("temperature-sensor-fault", "external-heating", "temperature-sensor-open", "sense-wire-open")
_LOST = ("sense-wire-open", "temperature-sensor-open", *_BOARD)
_WARM = (
    "external-heating",
    "self-discharge-high",
    "joint-resistance-high",
    "cell-resistance-high",
    "temperature-sensor-fault",
    "cooling-failed",
    "ambient-temperature",
    "accumulator-hot",
)
EXPLAINS: Final[dict[str, tuple[str, ...]]] = {
    "cell-undervoltage": (
        *_CELL,
        *_BOARD,
        "sense-wire-open",
        "accumulator-empty",
        "accumulator-cold",
        "ambient-temperature",
    ),
    "cell-overvoltage": (*_CELL, *_BOARD, "sense-wire-open"),  # a loose input reads high or low until its test finds it
    "cell-overtemperature": (*_WARM, *_LOST),
    "cell-undertemperature": ("accumulator-cold", "ambient-temperature", "temperature-sensor-fault", *_LOST),
    "discharge-overcurrent": ("overload", "current-sensor-offset", "current-sensor-open"),
    "charge-overcurrent": ("overload", "current-sensor-offset", "current-sensor-open"),
    "slave-lost": _BOARD,
    "sensor-lost": (*_LOST, "current-sensor-open", "temperature-sensor-fault"),
}
# A code that stands for several things of which the recording holds the same; why: docs/reference/causes.md
SAME: Final[dict[str, tuple[str, ...]]] = {
    "contactors-not-closed": ("precharge-failed", "external-shutdown", "hv-not-switched-on"),
    "can-silent": ("can-short", "can-adapter-off"),
    "can-master-silent": ("can-short", "can-master-bus-off", "can-adapter-off"),
}
# What follows from another cause when both are seen: the first is reported, the second is not
_CAN: Final = ("can-silent", "can-master-bus-off", "can-master-silent")
_RESTART: Final = (
    "external-shutdown",
    "serial-silent",
    "can-master-silent",
    "can-master-bus-off",
    "charger-silent",
)
FOLLOWS: Final[dict[str, tuple[str, ...]]] = {
    "can-babbling-node": ("charger-silent", *_CAN, "can-noise"),
    "can-silent": ("charger-silent", "can-noise"),
    "can-master-bus-off": ("charger-silent",),
    "can-master-silent": ("charger-silent",),
    "can-noise": ("charger-silent",),
    "serial-silent": ("can-master-silent",),
    "serial-noise": ("serial-silent",),  # so much noise that no frame is left
    "master-watchdog-reset": _RESTART,
    "master-supply-lost": _RESTART,
    "isospi-noise": (
        *("slave-lost", "cell-voltage-noisy", "temperature-sensor-open", "temperature-sensor-fault"),
        "sense-wire-open",
    ),
    "slave-adc-fault": (*_CELL, *_SENSORS),
    "slave-multiplexer-fault": (*_CELL, *_SENSORS),
    "slave-reference-drift": (*_CELL, *_SENSORS),
    "slave-lost": (*_CELL, *_SENSORS),
    "sense-wire-open": (*_CELL, *(code for code in _SENSORS if code != "sense-wire-open")),
    "current-sensor-open": ("current-sensor-offset", "overload"),
    "current-sensor-offset": _CELL,
    "ambient-temperature": ("external-heating", "cooling-failed", "accumulator-hot", "accumulator-cold"),
    "cooling-failed": ("accumulator-hot", "self-discharge-high"),
}


@dataclass(frozen=True)
class Judgement:
    """One thing that happened and what explains it, the likeliest first; `trip` None: it tripped nothing."""

    at_s: float
    trip: Trigger | None
    ranked: tuple[Hypothesis, ...]
    confidence: tuple[float, ...]


def trip_kind(code: str) -> str | None:
    """What a trip is about; None for one that only repeats another."""
    condition = code.removeprefix("trip-")
    return condition if condition in EXPLAINS else None


def judge(trips: Sequence[Trigger], hypotheses: Iterable[Hypothesis], segments: Sequence[int]) -> list[Judgement]:
    """Return what explains each trip, then what is wrong without having tripped anything; trips in order.

    `segments` are the cells of each pack.
    """
    placed = (each if each.cell is None else replace(each, pack=pack_of(each.cell, segments)) for each in hypotheses)
    left = _without_consequences(_strongest_each(placed))
    found: list[Judgement] = []
    explained: set[int | None] = set()  # cells of which it is known what they have
    used: set[tuple[str, int | None, int | None]] = set()
    for trip in trips:
        kind = trip_kind(trip.code)
        if kind is None:
            continue
        able = [each for each in left if each.code in EXPLAINS.get(kind, ()) and each.at_s <= trip.at_s + LATE_S]
        pack = pack_of_event(trip, segments)
        named = [each for each in able if _fits_place(each, trip.cell, pack)]
        ranked = _ranked(named or [each for each in able if pack is None or each.pack in (None, pack)])
        found.append(Judgement(trip.at_s, trip, ranked, confidences(ranked)))
        used |= {_key(each) for each in ranked}
        explained |= {each.cell for each in ranked[:1]} - {None}
    rest = [each for each in left if _key(each) not in used and each.weight >= ENOUGH and each.cell not in explained]
    if any(
        each.ranked and each.ranked[0].code == "accumulator-empty" for each in found
    ):  # then small differences are large
        rest = [each for each in rest if each.code not in _CELL or each.weight >= SURE_WHEN_EMPTY]
    for group in _places(rest):
        ranked = _ranked(group)
        found.append(Judgement(ranked[0].at_s, None, ranked, confidences(ranked)))
    return found


def _key(each: Hypothesis) -> tuple[str, int | None, int | None]:
    return each.code, *each.place


def _strongest_each(hypotheses: Iterable[Hypothesis]) -> list[Hypothesis]:
    best: dict[tuple[str, int | None, int | None], Hypothesis] = {}
    for each in hypotheses:
        known = best.get(_key(each))
        if known is None:
            best[_key(each)] = each
            continue
        stronger, other = (each, known) if each.weight > known.weight else (known, each)
        sized = other if stronger.sigma is None and other.size is not None else stronger  # the size with a band counts
        best[_key(each)] = replace(stronger, size=sized.size, sigma=sized.sigma, unit=sized.unit)
    return list(best.values())


def _without_consequences(found: list[Hypothesis]) -> list[Hypothesis]:
    def follows(each: Hypothesis) -> bool:
        return any(
            each.code in FOLLOWS.get(other.code, ())
            and (other.place[1] is None or each.place[1] in (None, other.place[1]))
            for other in found
        )

    return [each for each in found if not follows(each)]


def _fits_place(each: Hypothesis, cell: int | None, pack: int | None) -> bool:
    """The hypothesis is about the cell that tripped, or about its pack, or about no place."""
    if pack is None or each.pack is None:
        return True
    return each.cell == cell if cell is not None and each.cell is not None else each.pack == pack


def _places(rest: list[Hypothesis]) -> list[list[Hypothesis]]:
    """Hypotheses of one place explain the same; the strongest place first."""
    groups: dict[object, list[Hypothesis]] = {}
    for each in rest:
        key: object = each.place if each.cell is not None else (each.code, each.place)
        groups.setdefault(key, []).append(each)
    return sorted(groups.values(), key=lambda group: -max(each.weight for each in group))


def _ranked(found: Sequence[Hypothesis]) -> tuple[Hypothesis, ...]:
    return tuple(sorted(found, key=lambda each: -each.weight))


def confidences(ranked: Sequence[Hypothesis]) -> tuple[float, ...]:
    """Return the probability of each hypothesis against the others and against none of them."""
    if not ranked:
        return ()
    odds = np.array([each.weight for each in ranked] + [0.0]) / TEMPER
    share = np.exp(odds - odds.max())
    return tuple(float(min(each, CONFIDENT)) for each in (share / share.sum())[:-1])


@dataclass(frozen=True)
class OtherCause:
    """What else it could be; cell and pack count from 0."""

    code: str
    message: RenderedMessage
    cell: int | None
    pack: int | None
    confidence: float


@dataclass(frozen=True)
class Cause:
    """The likeliest cause of a trip, or of something that is wrong without one.

    Attributes:
        at: of the trip, or since when it is wrong; unix time [s].
        trip: code of the trip's event, None without one.
        code: of the cause, `unknown` where nothing that is known explains the trip.
        cell, pack: where, from 0; None where it has no place.
        since: since when it can be seen; unix time [s].
        confidence: 0..1, against the others and against none of them.
        same: what the recording cannot distinguish, where `code` stands for several.
        evidence: what was seen.
        others: what else it could be, the likelier first.
        size, low, high: how much, and the ends of its band, in `unit`; None where it has no size.
        judged: up to when the recording was looked at; unix time [s], None in verdicts of earlier versions.
        revised: it takes the place of an earlier verdict.
    """

    at: float
    trip: str | None
    code: str
    message: RenderedMessage
    cell: int | None
    pack: int | None
    since: float | None
    confidence: float
    same: list[RenderedMessage]
    evidence: list[RenderedMessage]
    others: list[OtherCause]
    size: float | None = None
    low: float | None = None
    high: float | None = None
    unit: str = ""
    judged: float | None = None
    revised: bool = False


def cause_of(judgement: Judgement, segments: Sequence[int], judged_s: float) -> Cause:
    """Return a judgement in words; `segments` are the cells of each pack, `judged_s`: by what there was then."""
    judged_s = round(judged_s, 3)
    trip = None if judgement.trip is None else judgement.trip.code
    if not judgement.ranked:
        message = sentence(Message("cause-unknown"))
        return Cause(judgement.at_s, trip, UNEXPLAINED, message, None, None, None, 0.0, [], [], [], judged=judged_s)
    main = judgement.ranked[0]
    (cell, pack), (low, high) = main.place, _band(main)
    pairs = list(zip(judgement.ranked, judgement.confidence, strict=True))[1:]
    return Cause(
        at=judgement.at_s,
        trip=trip,
        code=main.code,
        message=sentence(_message(main), segments),
        cell=cell,
        pack=pack,
        since=main.at_s,
        confidence=round(judgement.confidence[0], 3),
        same=[sentence(condition(code)) for code in SAME.get(main.code, ())],
        evidence=[sentence(message, segments) for message in _own_evidence(main)],
        others=[_other(each, share, segments) for each, share in pairs if share >= LEAST_OTHER][:MOST_OTHERS],
        size=main.size,
        low=low,
        high=high,
        unit="" if main.size is None else main.unit,
        judged=judged_s,
    )


def _own_evidence(each: Hypothesis) -> list[Message]:
    """What was seen; what a finding says stands with the finding, unless nothing else was seen."""
    seen = [message for message in each.evidence if not message.code.startswith("finding-")]
    return seen or list(each.evidence)


def _band(each: Hypothesis) -> tuple[float | None, float | None]:
    """The ends of its size's band, as `CellFinding.band`."""
    if each.size is None or each.sigma is None:
        return None, None
    return max(each.size - BAND_SIGMAS * each.sigma, 0.0), each.size + BAND_SIGMAS * each.sigma


def trip_cause(cause: Cause) -> TripCause:
    """Return a cause as the alarm of the trip carries it."""
    others = tuple(
        PossibleCause(each.code, each.message.message, each.cell, each.pack, each.confidence) for each in cause.others
    )
    return TripCause(
        cause.code,
        cause.message.message,
        cause.cell,
        cause.pack,
        cause.confidence,
        others,
        size=cause.size,
        low=cause.low,
        high=cause.high,
        unit=cause.unit,
        since=cause.since,
        judged=cause.judged,
        revised=cause.revised,
    )


def cause_from_json(body: dict[str, Any] | None) -> Cause | None:
    """Return a stored cause; None for a box of before there were any.

    Raises:
        KeyError, TypeError: it is not one.
    """
    if body is None:
        return None
    parts = {
        "trip": None if body["trip"] is None else condition_of(body["trip"]),
        "same": [rendered_from_json(each) for each in body["same"]],
        "evidence": [rendered_from_json(each) for each in body["evidence"]],
        "others": [OtherCause(**_named(each)) for each in body["others"]],
    }
    return Cause(**_named(body) | parts)


def _named(body: dict[str, Any]) -> dict[str, Any]:
    """A stored cause with its message; earlier versions kept the English text as `message` and this form next to it."""
    message = rendered_from_json(body["message_words"] if "message_words" in body else body["message"])
    kept = {name: value for name, value in body.items() if name != "message_words"}
    return kept | {"code": condition_of(body["code"]), "message": message}


def _message(each: Hypothesis) -> Message:
    """Return a cause with its place."""
    name, (cell, pack) = condition(each.code), each.place
    if cell is not None:
        size = None if each.size is None else size_of(each.code, each.size)
        if size is None:
            return Message("cause-at-cell", cause=name, cell=Cell(cell))
        return Message("cause-of-size", cause=name, cell=Cell(cell), size=size)
    return name if pack is None else Message("cause-in-pack", cause=name, pack=Pack(pack))


def _other(each: Hypothesis, share: float, segments: Sequence[int]) -> OtherCause:
    cell, pack = each.place
    return OtherCause(each.code, sentence(_message(each), segments), cell, pack, round(share, 3))
