"""The judge of causes: from hypotheses to the cause of each trip, and to faults without one."""

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
    """Return the kind of a trip; None for one that only repeats another."""
    condition = code.removeprefix("trip-")
    return condition if condition in EXPLAINS else None


def judge(trips: Sequence[Trigger], hypotheses: Iterable[Hypothesis], segments: Sequence[int]) -> list[Judgement]:
    """Return what explains each trip, then what is wrong without having tripped anything; trips in order.

    `segments` are the cells of each pack.
    """
    placed = (
        hypothesis if hypothesis.cell is None else replace(hypothesis, pack=pack_of(hypothesis.cell, segments))
        for hypothesis in hypotheses
    )
    left = _without_consequences(_strongest_each(placed))
    judgements: list[Judgement] = []
    explained: set[int | None] = set()  # cells of which it is known what they have
    used: set[tuple[str, int | None, int | None]] = set()
    for trip in trips:
        kind = trip_kind(trip.code)
        if kind is None:
            continue
        able = [
            hypothesis
            for hypothesis in left
            if hypothesis.code in EXPLAINS.get(kind, ()) and hypothesis.at_s <= trip.at_s + LATE_S
        ]
        pack = pack_of_event(trip, segments)
        named = [hypothesis for hypothesis in able if _fits_place(hypothesis, trip.cell, pack)]
        ranked = _ranked(
            named or [hypothesis for hypothesis in able if pack is None or hypothesis.pack in (None, pack)]
        )
        judgements.append(Judgement(trip.at_s, trip, ranked, confidences(ranked)))
        used |= {_key(hypothesis) for hypothesis in ranked}
        explained |= {hypothesis.cell for hypothesis in ranked[:1]} - {None}
    rest = [
        hypothesis
        for hypothesis in left
        if _key(hypothesis) not in used and hypothesis.weight >= ENOUGH and hypothesis.cell not in explained
    ]
    if any(
        judgement.ranked and judgement.ranked[0].code == "accumulator-empty" for judgement in judgements
    ):  # then small differences are large
        rest = [
            hypothesis for hypothesis in rest if hypothesis.code not in _CELL or hypothesis.weight >= SURE_WHEN_EMPTY
        ]
    for group in _places(rest):
        ranked = _ranked(group)
        judgements.append(Judgement(ranked[0].at_s, None, ranked, confidences(ranked)))
    return judgements


def _key(hypothesis: Hypothesis) -> tuple[str, int | None, int | None]:
    return hypothesis.code, *hypothesis.place


def _strongest_each(hypotheses: Iterable[Hypothesis]) -> list[Hypothesis]:
    best: dict[tuple[str, int | None, int | None], Hypothesis] = {}
    for hypothesis in hypotheses:
        before = best.get(_key(hypothesis))
        if before is None:
            best[_key(hypothesis)] = hypothesis
            continue
        stronger, other = (hypothesis, before) if hypothesis.weight > before.weight else (before, hypothesis)
        sized = other if stronger.sigma is None and other.size is not None else stronger  # the size with a band counts
        best[_key(hypothesis)] = replace(stronger, size=sized.size, sigma=sized.sigma, unit=sized.unit)
    return list(best.values())


def _without_consequences(hypotheses: list[Hypothesis]) -> list[Hypothesis]:
    def follows(hypothesis: Hypothesis) -> bool:
        return any(
            hypothesis.code in FOLLOWS.get(other.code, ())
            and (other.place[1] is None or hypothesis.place[1] in (None, other.place[1]))
            for other in hypotheses
        )

    return [hypothesis for hypothesis in hypotheses if not follows(hypothesis)]


def _fits_place(hypothesis: Hypothesis, cell: int | None, pack: int | None) -> bool:
    """The hypothesis is about the cell that tripped, or about its pack, or about no place."""
    if pack is None or hypothesis.pack is None:
        return True
    return hypothesis.cell == cell if cell is not None and hypothesis.cell is not None else hypothesis.pack == pack


def _places(rest: list[Hypothesis]) -> list[list[Hypothesis]]:
    """Hypotheses of one place explain the same; the strongest place first."""
    groups: dict[object, list[Hypothesis]] = {}
    for hypothesis in rest:
        key: object = hypothesis.place if hypothesis.cell is not None else (hypothesis.code, hypothesis.place)
        groups.setdefault(key, []).append(hypothesis)
    return sorted(groups.values(), key=lambda group: -max(hypothesis.weight for hypothesis in group))


def _ranked(hypotheses: Sequence[Hypothesis]) -> tuple[Hypothesis, ...]:
    return tuple(sorted(hypotheses, key=lambda hypothesis: -hypothesis.weight))


def confidences(ranked: Sequence[Hypothesis]) -> tuple[float, ...]:
    """Return the probability of each hypothesis against the others and against none of them."""
    if not ranked:
        return ()
    odds = np.array([hypothesis.weight for hypothesis in ranked] + [0.0]) / TEMPER
    share = np.exp(odds - odds.max())
    return tuple(float(min(confidence, CONFIDENT)) for confidence in (share / share.sum())[:-1])


@dataclass(frozen=True)
class OtherCause:
    """Another possible cause; cell and pack count from 0."""

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
        others=[_other(hypothesis, share, segments) for hypothesis, share in pairs if share >= LEAST_OTHER][
            :MOST_OTHERS
        ],
        size=main.size,
        low=low,
        high=high,
        unit="" if main.size is None else main.unit,
        judged=judged_s,
    )


def _own_evidence(hypothesis: Hypothesis) -> list[Message]:
    """What was seen; what a finding says stands with the finding, unless nothing else was seen."""
    seen = [message for message in hypothesis.evidence if not message.code.startswith("finding-")]
    return seen or list(hypothesis.evidence)


def _band(hypothesis: Hypothesis) -> tuple[float | None, float | None]:
    """The ends of its size's band, as `CellFinding.band`."""
    if hypothesis.size is None or hypothesis.sigma is None:
        return None, None
    return max(hypothesis.size - BAND_SIGMAS * hypothesis.sigma, 0.0), hypothesis.size + BAND_SIGMAS * hypothesis.sigma


def trip_cause(cause: Cause) -> TripCause:
    """Return a cause as the alarm of the trip carries it."""
    others = tuple(
        PossibleCause(other.code, other.message.message, other.cell, other.pack, other.confidence)
        for other in cause.others
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
        "same": [rendered_from_json(same) for same in body["same"]],
        "evidence": [rendered_from_json(evidence) for evidence in body["evidence"]],
        "others": [OtherCause(**_named(other)) for other in body["others"]],
    }
    return Cause(**_named(body) | parts)


def _named(body: dict[str, Any]) -> dict[str, Any]:
    """A stored cause with its message; earlier versions kept the English text as `message` and this form next to it."""
    message = rendered_from_json(body["message_words"] if "message_words" in body else body["message"])
    kept = {name: value for name, value in body.items() if name != "message_words"}
    return kept | {"code": condition_of(body["code"]), "message": message}


def _message(hypothesis: Hypothesis) -> Message:
    """Return a cause with its place."""
    name, (cell, pack) = condition(hypothesis.code), hypothesis.place
    if cell is not None:
        size = None if hypothesis.size is None else size_of(hypothesis.code, hypothesis.size)
        if size is None:
            return Message("cause-at-cell", cause=name, cell=Cell(cell))
        return Message("cause-of-size", cause=name, cell=Cell(cell), size=size)
    return name if pack is None else Message("cause-in-pack", cause=name, pack=Pack(pack))


def _other(hypothesis: Hypothesis, share: float, segments: Sequence[int]) -> OtherCause:
    cell, pack = hypothesis.place
    return OtherCause(hypothesis.code, sentence(_message(hypothesis), segments), cell, pack, round(share, 3))
