"""The shape of a cause: what is stored in a black box, sent and drawn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from app.analysis.finding import AnalysisFinding, finding
from app.analysis.root_cause.codes import NAMES, SAME, cause_message
from app.analysis.root_cause.judge import LEAST_OTHER, MOST_OTHERS, Judgement
from app.analysis.root_cause.recording import Suspicion
from app.telemetry import PossibleCause, TripCause
from app.words import Message


@dataclass(frozen=True)
class OtherCause:
    """What else it could be; cell and pack count from 0."""

    code: str
    message: str
    message_words: AnalysisFinding
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
        message, message_words: in English, and as code with arguments.
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
    message: str
    message_words: AnalysisFinding
    cell: int | None
    pack: int | None
    since: float | None
    confidence: float
    same: list[AnalysisFinding]
    evidence: list[AnalysisFinding]
    others: list[OtherCause]


def cause_of(judgement: Judgement) -> Cause:
    """Return a judgement in words."""
    trip = None if judgement.trip is None else judgement.trip.code
    if not judgement.ranked:
        words = finding(cause_message("unknown", None, None))
        return Cause(judgement.at_s, trip, "unknown", words.text, words, None, None, None, 0.0, [], [], [])
    main = judgement.ranked[0]
    cell, pack = main.place
    words = finding(_message(main))
    pairs = list(zip(judgement.ranked, judgement.confidence, strict=True))[1:]
    return Cause(
        at=judgement.at_s,
        trip=trip,
        code=main.code,
        message=words.text,
        message_words=words,
        cell=cell,
        pack=pack,
        since=main.at_s,
        confidence=round(judgement.confidence[0], 3),
        same=[finding(NAMES[code]) for code in SAME.get(main.code, ())],
        evidence=[finding(message) for message in main.evidence],
        others=[_other(each, share) for each, share in pairs if share >= LEAST_OTHER][:MOST_OTHERS],
    )


def trip_cause(cause: Cause) -> TripCause:
    """Return a cause as the alarm of the trip carries it."""
    others = tuple(
        PossibleCause(each.code, each.message_words.message, each.cell, each.pack, each.confidence)
        for each in cause.others
    )
    return TripCause(cause.code, cause.message_words.message, cause.cell, cause.pack, cause.confidence, others)


def cause_from_json(body: dict[str, Any] | None) -> Cause | None:
    """Return a stored cause; None for a box of before there were any.

    Raises:
        KeyError, TypeError: it is not one.
    """
    if body is None:
        return None
    parts = {
        "message_words": AnalysisFinding(**body["message_words"]),
        "same": [AnalysisFinding(**each) for each in body["same"]],
        "evidence": [AnalysisFinding(**each) for each in body["evidence"]],
        "others": [
            OtherCause(**each | {"message_words": AnalysisFinding(**each["message_words"])}) for each in body["others"]
        ],
    }
    return Cause(**body | parts)


def _message(each: Suspicion) -> Message:
    return cause_message(each.code, *each.place)


def _other(each: Suspicion, share: float) -> OtherCause:
    words, (cell, pack) = finding(_message(each)), each.place
    return OtherCause(each.code, words.text, words, cell, pack, round(share, 3))
