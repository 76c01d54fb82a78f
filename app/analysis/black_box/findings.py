"""What a black box says: how far and how long, what the other cells did, when the shutdown circuit opened."""

from __future__ import annotations

from collections.abc import Sequence

from app.analysis.black_box.box import BlackBox
from app.analysis.root_cause.cause import Cause
from app.telemetry.cell_findings import Finding
from app.words import Cell, Message, Quantity, RenderedMessage, sentence


def findings_of(box: BlackBox, found: Sequence[Finding] = ()) -> list[RenderedMessage]:
    """Return what happened in a few sentences; `found`: what was known against cells then, its own cell first."""
    messages = [Message("box-event", event=box.message.message), *_beyond(box), *_peers(box)]
    own_first = sorted(found, key=lambda each: each.cell != box.cell)
    messages += [Message("box-finding", finding=each.message, evidence=each.evidence) for each in own_first]
    current_a, opened_s = box.cells.current_at_trip_a, box.cells.opened_s
    if current_a is not None:
        messages.append(Message("box-current", current=Quantity(current_a, "A", 1)))
    if opened_s is not None:
        time = Quantity(abs(opened_s), "s", 2)
        is_after = opened_s >= 0.0
        messages.append(Message("box-opened-after", time=time) if is_after else Message("box-opened-before", time=time))
    measured = (*box.cells.voltage_min_v, *box.cells.temperature_at_degc)
    if all(value is None for value in measured):
        messages.append(Message("box-no-cell"))
    if not box.is_complete:
        messages.append(Message("box-partial"))
    return [sentence(message, box.segments) for message in messages]


def cause_findings(cause: Cause | None, segments: Sequence[int]) -> list[RenderedMessage]:
    """Return the likeliest cause, what speaks for it, what it cannot be told apart from, and what else it could be."""
    if cause is None:
        return []
    if cause.code == "unknown":
        return [sentence(Message("box-no-cause"))]
    share = Quantity(100 * cause.confidence, "%", 0)
    messages = [Message("box-cause", cause=cause.message.message, share=share)]
    if cause.evidence:
        messages.append(Message("box-evidence", evidence=tuple(each.message for each in cause.evidence)))
    if cause.same:
        messages.append(Message("box-cause-same", causes=tuple(each.message for each in cause.same)))
    if cause.others:
        messages.append(Message("box-cause-others", causes=tuple(each.message.message for each in cause.others)))
    return [sentence(message, segments) for message in messages]


def _beyond(box: BlackBox) -> list[Message]:
    beyond = box.beyond
    if beyond is None:
        return []
    worst = Quantity(beyond.worst, box.unit)
    if beyond.since_s is None:
        return [Message("box-never-beyond", worst=worst)]
    what = Message("accumulator") if box.cell is None else Cell(box.cell)
    limit, lasted = Quantity(box.limit, box.unit), Quantity(beyond.lasted_s, "s", 1)
    if beyond.since_s >= 0.0:
        if beyond.ended:
            return [Message("box-beyond", what=what, limit=limit, lasted=lasted, worst=worst)]
        return [Message("box-still-beyond", what=what, limit=limit, lasted=lasted, worst=worst)]
    before = Quantity(-beyond.since_s, "s", 2)
    if beyond.ended:
        return [Message("box-beyond-before", what=what, limit=limit, lasted=lasted, before=before, worst=worst)]
    return [Message("box-still-beyond-before", what=what, limit=limit, lasted=lasted, before=before, worst=worst)]


def _peers(box: BlackBox) -> list[Message]:
    peers = box.peers
    if peers is None:
        return []
    low, mean, high, apart = (
        Quantity(value, box.unit, 3 if box.unit == "V" else 1)
        for value in (peers.low, peers.mean, peers.high, abs(peers.apart))
    )
    others = Message("box-others", n=peers.also_beyond) if peers.also_beyond else Message("box-no-other")
    if peers.apart >= 0.0:
        return [others, Message("box-peers-above", low=low, high=high, mean=mean, apart=apart)]
    return [others, Message("box-peers-below", low=low, high=high, mean=mean, apart=apart)]
