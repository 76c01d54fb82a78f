"""Packs that messages alike stand for: one message, or one sender, of each pack."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby

from app.battery.source import CellSignals
from app.sources.dbc.infer.bus_survey import BusSurvey, numbers, skeleton
from app.sources.dbc.infer.proposal import CellProposal, Member, judged
from app.words import Message

LEAST_CELLS = 4  # cells of a pack, at least


def joined(survey: BusSurvey, kind: str, proposals: Sequence[CellProposal]) -> CellProposal | None:
    """Return messages with the same signals as one battery, a pack each; None where they can carry none.

    The number in the names of the messages is that of the pack; without one they are taken in the order of their ids.
    """
    ordered = sorted(proposals, key=lambda proposal: proposal.members[0][0].can_id)
    members: tuple[Member, ...] = tuple(member for proposal in ordered for member in proposal.members)
    total = sum(proposal.n for proposal in ordered)
    judgement = judged(survey, kind, members, total)
    if judgement is None:
        return None
    score, fitted = judgement
    names = [proposal.members[0][0].name for proposal in ordered]
    packs = _numbered(names)
    if packs is None:
        entries: list[CellSignals] = []
        first = 0
        for proposal in ordered:
            entries += [replace(entry, first=first) for entry in proposal.entries]
            first += proposal.n
        segments = tuple(proposal.n for proposal in ordered)
        reason = Message("infer-message-a-pack", n=len(ordered))
    else:
        pattern, of_message = packs
        sizes = dict(zip(of_message, (proposal.n for proposal in ordered), strict=True))
        lowest = min(sizes)
        segments = tuple(sizes.get(k, max(sizes.values())) for k in range(lowest, max(sizes) + 1))
        entries = [
            replace(entry, message=pattern, base=entry.base | ({"pack": lowest} if lowest else {}))
            for entry in ordered[0].entries
        ]
        reason = Message("infer-numbered-messages", n=len(ordered), pattern=pattern)
    reasons = (reason, *ordered[0].reasons)
    return CellProposal(kind, tuple(entries), sum(segments), segments, members, reasons, score + 1.0, fitted)


def _numbered(names: Sequence[str]) -> tuple[str, tuple[int, ...]] | None:
    """A pattern and the number of each name, where names differ in one number; None where they do not."""
    if len({skeleton(name) for name in names}) > 1:
        return None
    columns = list(zip(*(numbers(name) for name in names), strict=True))
    different = [place for place, column in enumerate(columns) if len(set(column)) > 1]
    if len(different) != 1 or len(set(columns[different[0]])) < len(names):
        return None
    values = columns[different[0]]
    if max(values) - min(values) >= 2 * len(names):
        return None
    pieces = skeleton(names[0]).split("#")
    filled = ["{pack}" if place == different[0] else str(column[0]) for place, column in enumerate(columns)]
    return "".join(piece + fill for piece, fill in zip(pieces, [*filled, ""], strict=True)), values


def packs_by_sender(members: Sequence[Member]) -> tuple[int, ...] | None:
    """Return the cells of each sender where several send as many cells as a pack has, one sender after the other."""
    runs = [(sender, len(list(run))) for sender, run in groupby(message.sender for message, _ in members)]
    senders = [sender for sender, _ in runs]
    if len(runs) < 2 or len(set(senders)) < len(runs) or "" in senders or min(n for _, n in runs) < LEAST_CELLS:
        return None
    return tuple(n for _, n in runs)
