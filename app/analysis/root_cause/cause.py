"""The shape of a cause: what is stored in a black box, sent and drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from app.analysis.root_cause.judge import LEAST_OTHER, MOST_OTHERS, SAME, Judgement
from app.analysis.root_cause.recording import Suspicion
from app.telemetry import PossibleCause, TripCause
from app.telemetry.cell_findings import Finding
from app.words import Cell, Message, Pack, RenderedMessage, condition, condition_of, rendered_from_json, sentence


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
        confidence: 0..1, beside the others and beside none of them.
        same: what the recording cannot tell apart, where `code` stands for several.
        evidence: what speaks for it.
        others: what else it could be, the likelier first.
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


def cause_of(judgement: Judgement, segments: Sequence[int]) -> Cause:
    """Return a judgement in words; `segments` are the cells of each pack."""
    trip = None if judgement.trip is None else judgement.trip.code
    if not judgement.ranked:
        message = sentence(Message("cause-unknown"))
        return Cause(judgement.at_s, trip, "unknown", message, None, None, None, 0.0, [], [], [])
    main = judgement.ranked[0]
    cell, pack = main.place
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
        evidence=[sentence(message, segments) for message in main.evidence],
        others=[_other(each, share, segments) for each, share in pairs if share >= LEAST_OTHER][:MOST_OTHERS],
    )


def trip_cause(cause: Cause) -> TripCause:
    """Return a cause as the alarm of the trip carries it."""
    others = tuple(
        PossibleCause(each.code, each.message.message, each.cell, each.pack, each.confidence) for each in cause.others
    )
    return TripCause(cause.code, cause.message.message, cause.cell, cause.pack, cause.confidence, others)


def agreeing(found: Sequence[Finding], causes: Sequence[Cause]) -> list[Finding]:
    """Return the findings without those of a cell that a cause explains by another condition."""
    explained = {cause.cell: cause.code for cause in reversed(causes) if cause.cell is not None}
    return [each for each in found if explained.get(each.cell, each.code) == each.code]


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


def _message(each: Suspicion) -> Message:
    """Return a cause with its place."""
    name, (cell, pack) = condition(each.code), each.place
    if cell is not None:
        return Message("cause-at-cell", cause=name, cell=Cell(cell))
    return name if pack is None else Message("cause-in-pack", cause=name, pack=Pack(pack))


def _other(each: Suspicion, share: float, segments: Sequence[int]) -> OtherCause:
    cell, pack = each.place
    return OtherCause(each.code, sentence(_message(each), segments), cell, pack, round(share, 3))
