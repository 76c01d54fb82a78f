"""The shape of a cause: what is stored in a black box, sent and drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from app.analysis.root_cause.codes import NAMES, SAME, cause_message
from app.analysis.root_cause.judge import LEAST_OTHER, MOST_OTHERS, Judgement
from app.analysis.root_cause.recording import Suspicion
from app.telemetry import PossibleCause, TripCause
from app.words import RenderedMessage, sentence


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
        message = sentence(cause_message("unknown", None, None))
        return Cause(judgement.at_s, trip, "unknown", message, None, None, None, 0.0, [], [], [])
    main = judgement.ranked[0]
    cell, pack = main.place
    pairs = list(zip(judgement.ranked, judgement.confidence, strict=True))[1:]
    return Cause(
        at=judgement.at_s,
        trip=trip,
        code=main.code,
        message=sentence(cause_message(main.code, cell, pack), segments),
        cell=cell,
        pack=pack,
        since=main.at_s,
        confidence=round(judgement.confidence[0], 3),
        same=[sentence(NAMES[code]) for code in SAME.get(main.code, ())],
        evidence=[sentence(message, segments) for message in main.evidence],
        others=[_other(each, share, segments) for each, share in pairs if share >= LEAST_OTHER][:MOST_OTHERS],
    )


def trip_cause(cause: Cause) -> TripCause:
    """Return a cause as the alarm of the trip carries it."""
    others = tuple(
        PossibleCause(each.code, each.message.message, each.cell, each.pack, each.confidence) for each in cause.others
    )
    return TripCause(cause.code, cause.message.message, cause.cell, cause.pack, cause.confidence, others)


def cause_from_json(body: dict[str, Any] | None) -> Cause | None:
    """Return a stored cause; None for a box of before there were any.

    Raises:
        KeyError, TypeError: it is not one.
    """
    if body is None:
        return None
    parts = {
        "same": [RenderedMessage(**each) for each in body["same"]],
        "evidence": [RenderedMessage(**each) for each in body["evidence"]],
        "others": [OtherCause(**_with_message(each)) for each in body["others"]],
    }
    return Cause(**_with_message(body) | parts)


def _with_message(body: dict[str, Any]) -> dict[str, Any]:
    """A stored cause with its message; earlier versions kept the English text as `message` and this form beside it."""
    body = dict(body)
    message = body.pop("message_words", body["message"])
    return body | {"message": RenderedMessage(**message)}


def _other(each: Suspicion, share: float, segments: Sequence[int]) -> OtherCause:
    cell, pack = each.place
    return OtherCause(each.code, sentence(cause_message(each.code, cell, pack), segments), cell, pack, round(share, 3))
