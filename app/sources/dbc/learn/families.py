"""Families of signals: the same name but for its numbers, one signal a cell, with or without a multiplexer."""

import re
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

from app.battery.source import CellSignals
from app.sources.dbc.definitions import MessageDefinition
from app.sources.dbc.learn.proposal import CellProposal, Member, judged
from app.sources.dbc.learn.survey import Survey
from app.sources.dbc.learn.words_of_names import FIRST, GROUP, SEGMENT, tokens
from app.words import Message, Text

_PART = re.compile(
    r"(?P<number>\d+)"
    r"|(?<=_)(?P<letter>[A-H])(?=_|$)"
    r"|(?:(?<=[Ss]eg)|(?<=[Ss]egment)|(?<=SEG)|(?<=SEGMENT)|(?<=[Mm]od)|(?<=[Mm]odule)|(?<=[Ss]tack)|(?<=[Bb]ox)|(?<=[Ss]tring))"
    r"(?P<near>[A-Z])(?=[A-Z\d_]|$)"
)
_FEWEST = {"voltage": 4, "temperature": 2, "balancing": 8}


@dataclass(frozen=True, slots=True)
class _Name:
    """A name cut at its numbers and letters."""

    pieces: tuple[str, ...]  # one more than there are numbers
    texts: tuple[str, ...]
    values: tuple[int, ...]

    @property
    def skeleton(self) -> str:
        return "#".join(self.pieces)


def _cut(name: str) -> _Name:
    pieces, texts, at = [], [], 0
    for found in _PART.finditer(name):
        pieces.append(name[at : found.start()])
        texts.append(found[0])
        at = found.end()
    pieces.append(name[at:])
    values = tuple(int(text) if text.isdigit() else ord(text) - ord("A") for text in texts)
    return _Name(tuple(pieces), tuple(texts), values)


@dataclass(frozen=True, slots=True)
class _Column:
    """One number of all members: of the message's name, the signal's, or the multiplexer's value."""

    where: str  # message, signal, mux
    place: int
    values: tuple[int, ...]
    texts: tuple[str, ...]
    word: str  # in front of it

    @property
    def is_letter(self) -> bool:
        return bool(self.texts) and self.texts[0].isalpha()

    @property
    def varies(self) -> bool:
        return len(set(self.values)) > 1


def family_proposals(survey: Survey, kind: str) -> Iterator[CellProposal]:
    """Yield each family of signals that may carry a quantity."""
    by_skeleton: dict[str, list[Member]] = defaultdict(list)
    for message in survey.definitions.by_id().values():
        for signal in message.signals:
            if not signal.is_multiplexer and signal.layout.length > (1 if kind != "balancing" else 0):
                by_skeleton[_cut(signal.name).skeleton].append((message, signal))
    for members in by_skeleton.values():
        if len(members) < _FEWEST[kind]:
            continue
        whole = _proposal(survey, kind, members)
        if whole is not None:
            yield whole
            continue
        for part in _split(members):
            if len(part) >= _FEWEST[kind] and len(part) < len(members):
                found = _proposal(survey, kind, part)
                if found is not None:
                    yield found


def _split(members: Sequence[Member]) -> Iterator[list[Member]]:
    """Members by the skeleton of their message, then by message."""
    by_message: dict[str, list[Member]] = defaultdict(list)
    by_id: dict[int, list[Member]] = defaultdict(list)
    for message, signal in members:
        by_message[_cut(message.name).skeleton].append((message, signal))
        by_id[message.can_id].append((message, signal))
    yield from by_message.values()
    if len(by_id) != len(by_message):
        yield from by_id.values()


def _columns(members: Sequence[Member]) -> list[_Column]:
    of_message = [_cut(message.name) for message, _ in members]
    of_signal = [_cut(signal.name) for _, signal in members]
    found = []
    for where, names in (("message", of_message), ("signal", of_signal)):
        if len({name.skeleton for name in names}) > 1:
            continue
        for place in range(len(names[0].values)):
            before = tokens(names[0].pieces[place])
            values = tuple(name.values[place] for name in names)
            texts = tuple(name.texts[place] for name in names)
            found.append(_Column(where, place, values, texts, before[-1] if before else ""))
    conditions = [signal.conditions for _, signal in members]
    if all(len(each) == 1 and len(each[0].values) == 1 for each in conditions):
        values = tuple(each[0].values[0] for each in conditions)
        word = tokens(conditions[0][0].multiplexer)
        found.insert(
            0, _Column("mux", 0, values, (), next((w for w in word if w in SEGMENT), word[-1] if word else ""))
        )
    return [column for column in found if column.varies]


def _proposal(survey: Survey, kind: str, members: Sequence[Member]) -> CellProposal | None:
    """The family as a way to speak, None where names and multiplexer do not tell its members apart."""
    columns = _columns(members)
    chosen = _telling(columns, len(members))
    if chosen is None:
        return None
    roles = _roles(chosen)
    members = sorted(members, key=_order(members, chosen))
    columns = _columns(members)
    judgement = judged(survey, kind, tuple(members), len(members)) if kind != "balancing" else (0.0, None)
    if judgement is None:
        return None
    score, found = judgement
    chosen = [next(c for c in columns if (c.where, c.place) == (old.where, old.place)) for old in chosen]
    segments = _segments(chosen, roles, columns)
    base = {role: 0 if column.is_letter else min(column.values) for column, role in zip(chosen, roles, strict=True)}
    base = {role: low if low <= 1 or role != "cell" or len(chosen) == 1 else 0 for role, low in base.items()}
    message_names = {message.name for message, _ in members}
    signal_pattern = _pattern(members, chosen, roles, "signal")
    message_pattern = _pattern(members, chosen, roles, "message")
    if "{" not in message_pattern and not _is_needed(survey, members, signal_pattern):
        message_pattern = "*"
    numbers = {
        role: members[0][1].conditions[0].multiplexer
        for column, role in zip(chosen, roles, strict=True)
        if column.where == "mux"
    }
    group_cells = _group_cells(chosen, roles)
    reasons: list[Text] = [Message("learn-names", n=len(members), pattern=signal_pattern, messages=len(message_names))]
    if any(signal.conditions for _, signal in members):
        reasons.append(Message("learn-multiplexed", name=members[0][1].conditions[0].multiplexer))
    entry = CellSignals(
        signal=signal_pattern,
        message=message_pattern,
        numbers=numbers,
        base={role: each for role, each in base.items() if each},
        group_cells=group_cells,
        unit=found.unit if found else "",
        invalid=found.invalid if found else (),
        invalid_signal=_flag(members, chosen, roles, ("invalid", "inval", "err", "error", "fault", "open")),
    )
    n = _count(chosen, roles, base, group_cells, segments)
    return CellProposal(kind, (entry,), n, segments, tuple(members), tuple(reasons), score, found)


def _telling(columns: list[_Column], n: int) -> list[_Column] | None:
    """The fewest columns that tell all members apart; those of the signal's name first."""
    ranked = sorted(columns, key=lambda c: ("signal", "message", "mux").index(c.where))
    for size in (1, 2, 3):
        found = []
        for some in combinations(ranked, size):
            if len(set(zip(*(column.values for column in some), strict=True))) == n:
                found.append(some)
        if size == 1:  # numbers of one column run on, or nearly so
            found = [some for some in found if max(some[0].values) - min(some[0].values) < 2 * n + 8]
        if found:
            best = min(found, key=_effort)
            return sorted(best, key=columns.index)
    return None


def _effort(columns: tuple[_Column, ...]) -> tuple[int, int]:
    """How far fetched it is that these columns number the cells: less is better."""
    places = sum(("signal", "message", "mux").index(column.where) for column in columns)
    outer = columns[0]
    full = sum(len(set(column.values)) for column in columns)
    return (0 if len(columns) == 1 or outer.word in SEGMENT else 1) + places, full


def _roles(columns: list[_Column]) -> list[str]:
    """What each column counts, from the outermost to the cell."""
    if len(columns) == 1:
        return ["cell"]
    outer = "segment" if _is_segment(columns[0]) else "group"
    if len(columns) == 2:
        return [outer, "cell"]
    return ["segment", "group", "cell"]


def _is_segment(column: _Column) -> bool:
    if column.word in SEGMENT:
        return True
    return column.word not in GROUP and column.where == "signal"


def _order(members: Sequence[Member], columns: list[_Column]):  # type: ignore[no-untyped-def]  # noqa: ANN202
    keys = {
        (message.can_id, signal.name): tuple(column.values[i] for column in columns)
        for i, (message, signal) in enumerate(members)
    }
    return lambda member: keys[member[0].can_id, member[1].name]


def _segments(chosen: list[_Column], roles: list[str], columns: list[_Column]) -> tuple[int, ...] | None:
    """Cells of each segment, where a column tells segments."""
    if "segment" in roles:
        column = chosen[roles.index("segment")]
        low = 0 if column.is_letter else min(column.values)
        return tuple(column.values.count(value) for value in range(low, max(column.values) + 1))
    for column in columns:
        if column not in chosen and column.word in SEGMENT:
            runs = [column.values.count(value) for value in sorted(set(column.values))]
            if list(column.values) == sorted(column.values) and min(runs) >= 4:
                return tuple(runs)
    return None


def _group_cells(chosen: list[_Column], roles: list[str]) -> int:
    if "group" not in roles:
        return 1
    groups, cells = chosen[roles.index("group")], chosen[roles.index("cell")]
    width = max(cells.values) - min(cells.values) + 1
    steps = sorted(set(groups.values))
    is_first = groups.word in FIRST or (len(steps) > 1 and all(b - a == width for a, b in pairwise(steps)))
    return 1 if is_first and width > 1 and len(steps) > 1 and steps[1] - steps[0] == width else width


def _count(
    chosen: list[_Column], roles: list[str], base: dict[str, int], group_cells: int, segments: tuple[int, ...] | None
) -> int:
    if "segment" in roles and segments is not None:
        return sum(segments)
    at = {role: column.values for role, column in zip(roles, chosen, strict=True)}
    group = max(at["group"]) - base["group"] if "group" in at else 0
    last = max(
        (g - base.get("group", 0)) * group_cells + c - base.get("cell", 0)
        for g, c in zip(at.get("group", (base.get("group", 0),) * len(at["cell"])), at["cell"], strict=True)
    )
    return last + 1 if group >= 0 else 0


def _pattern(members: Sequence[Member], chosen: list[_Column], roles: list[str], where: str) -> str:
    names = [_cut((message if where == "message" else signal).name) for message, signal in members]
    if len({name.skeleton for name in names}) > 1:
        return "*"
    role_of = {column.place: role for column, role in zip(chosen, roles, strict=True) if column.where == where}
    text = names[0].pieces[0]
    for place, piece in enumerate(names[0].pieces[1:]):
        here = {name.texts[place] for name in names}
        if place in role_of:
            letter = ":a" if names[0].texts[place].isalpha() else ""
            text += "{" + role_of[place] + letter + "}"
        else:
            text += here.pop() if len(here) == 1 else "*"
        text += piece
    return text


def _is_needed(survey: Survey, members: Sequence[Member], pattern: str) -> bool:
    """Whether signals of other messages would fit too."""
    skeleton = _cut(members[0][1].name).skeleton
    ids = {message.can_id for message, _ in members}
    return any(
        _cut(signal.name).skeleton == skeleton
        for message in survey.definitions.by_id().values()
        if message.can_id not in ids
        for signal in message.signals
    )


def _flag(members: Sequence[Member], chosen: list[_Column], roles: list[str], said: tuple[str, ...]) -> str:
    """The pattern of a bit beside each signal that tells that it is invalid; "" where there is none."""
    place = next(
        (c.place for c, role in zip(chosen, roles, strict=True) if c.where == "signal" and role == "cell"), None
    )
    if place is None:
        return ""
    message, signal = members[0]
    text = _cut(signal.name).texts[place]
    for each in message.signals:
        cut = _cut(each.name)
        if each.layout.length == 1 and text in cut.texts and any(word in each.name.lower() for word in said[:2]):
            at = cut.texts.index(text)
            pattern = "".join(
                piece + ("{cell}" if i == at else (cut.texts[i] if i < len(cut.texts) else ""))
                for i, piece in enumerate(cut.pieces)
            )
            if all(_has(m, pattern, _cut(s.name).texts[place]) for m, s in members):
                return pattern
    return ""


def _has(message: MessageDefinition, pattern: str, text: str) -> bool:
    return message.signal(pattern.replace("{cell}", text)) is not None
