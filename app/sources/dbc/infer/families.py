"""Families of signals: the same name but for its numbers, one signal a cell, with or without a multiplexer."""

import re
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from math import prod

from app.battery.source import CellSignals
from app.sources.dbc.definitions import MessageDefinition
from app.sources.dbc.infer.bus_survey import (
    CELL,
    FIRST,
    GROUP,
    NO_QUANTITY,
    SEGMENT,
    TEMPERATURE,
    VOLTAGE,
    BusSurvey,
    tokens,
    words,
)
from app.sources.dbc.infer.proposal import CellProposal, Member, judged
from app.words import Message, Text

_PART = re.compile(
    r"(?P<number>\d+)"
    r"|(?<=_)(?P<letter>[A-H](?=_|$)|[a-h]$)"
    r"|(?:(?<=[Ss]eg)|(?<=[Ss]egment)|(?<=SEG)|(?<=SEGMENT)|(?<=[Mm]od)|(?<=[Mm]odule)|(?<=[Ss]tack)|(?<=[Bb]ox)|(?<=[Ss]tring))"
    r"(?P<near>[A-Z])(?=[A-Z\d_]|$)"
)


@dataclass(frozen=True, slots=True)
class Name:
    """A name cut at its numbers and letters."""

    pieces: tuple[str, ...]  # one more than there are numbers
    texts: tuple[str, ...]
    values: tuple[int, ...]

    @property
    def skeleton(self) -> str:
        """The name with `#` for each number."""
        return "#".join(self.pieces)


def cut_name(name: str) -> Name:
    """Return a name cut at its numbers, and at letters that stand for one."""
    pieces, texts, at = [], [], 0
    for match in _PART.finditer(name):
        pieces.append(name[at : match.start()])
        texts.append(match[0])
        at = match.end()
    pieces.append(name[at:])
    values = tuple(int(text) if text.isdigit() else ord(text.upper()) - ord("A") for text in texts)
    return Name(tuple(pieces), tuple(texts), values)


@dataclass(frozen=True, slots=True)
class NameColumn:
    """One number of all members: of the message's name, the signal's, or the multiplexer's value."""

    where: str  # message, signal, mux
    place: int
    values: tuple[int, ...]
    texts: tuple[str, ...]
    word: str  # in front of it

    @property
    def is_letter(self) -> bool:
        """Return whether letters stand for its numbers."""
        return bool(self.texts) and self.texts[0].isalpha()

    @property
    def varies(self) -> bool:
        """Return whether members differ in it."""
        return len(set(self.values)) > 1


def columns_of(members: Sequence[Member]) -> list[NameColumn]:
    """Return the numbers that differ between members: of their messages, their names, their multiplexer."""
    of_message = [cut_name(message.name) for message, _ in members]
    of_signal = [cut_name(signal.name) for _, signal in members]
    columns = []
    for where, names in (("message", of_message), ("signal", of_signal)):
        if len({name.skeleton for name in names}) > 1:
            continue
        for place in range(len(names[0].values)):
            before = tokens(names[0].pieces[place])
            values = tuple(name.values[place] for name in names)
            texts = tuple(name.texts[place] for name in names)
            columns.append(NameColumn(where, place, values, texts, before[-1] if before else ""))
    conditions = [signal.conditions for _, signal in members]
    if all(len(condition) == 1 and len(condition[0].values) == 1 for condition in conditions):
        values = tuple(condition[0].values[0] for condition in conditions)
        word = tokens(conditions[0][0].multiplexer)
        columns.insert(
            0, NameColumn("mux", 0, values, (), next((w for w in word if w in SEGMENT), word[-1] if word else ""))
        )
    return [column for column in columns if column.varies]


def most_informative(columns: list[NameColumn], n: int) -> list[NameColumn] | None:
    """Return the fewest columns that tell all members apart; those of the signal's name first."""
    ranked = sorted(columns, key=lambda c: ("signal", "message", "mux").index(c.where))
    for size in (1, 2, 3):
        candidates = []
        for some in combinations(ranked, size):
            if len(set(zip(*(column.values for column in some), strict=True))) == n:
                candidates.append(some)
        if size == 1:  # numbers of one column run on, or nearly so
            candidates = [some for some in candidates if max(some[0].values) - min(some[0].values) < 2 * n + 8]
        if candidates:
            best = min(candidates, key=_search_cost)
            return sorted(best, key=columns.index)
    return None


def _search_cost(columns: tuple[NameColumn, ...]) -> tuple[int, int]:
    """How far fetched it is that these columns number the cells: less is better."""
    places = sum(("signal", "message", "mux").index(column.where) for column in columns)
    outer = columns[0]
    full = sum(len(set(column.values)) for column in columns)
    return (0 if len(columns) == 1 or outer.word in SEGMENT else 1) + places, full


def roles_of(columns: list[NameColumn]) -> list[str]:
    """Return what each column counts, from the outermost to the cell."""
    if len(columns) == 1:
        return ["cell"]
    outer = "pack" if _is_pack(columns[0]) else "group"
    if len(columns) == 2:
        return [outer, "cell"]
    return ["pack", "group", "cell"]


def _is_pack(column: NameColumn) -> bool:
    if column.word in SEGMENT:
        return True
    return column.word not in GROUP and column.where == "signal"


_MOST_IN_A_MESSAGE = 36
_BY_ID = 0.5  # penalty for cells by the order of ids
_LONG_S, _OFTEN = 5.0, 5  # length of a log, and frames in it, that show which messages are not sent
_FEWEST_RECEIVED = 8
_FEWEST = {"voltage": 4, "temperature": 2, "balancing": 8}


def family_proposals(survey: BusSurvey, kind: str) -> Iterator[CellProposal]:
    """Yield each family of signals that may carry a quantity."""
    by_skeleton: dict[str, list[Member]] = defaultdict(list)
    for message in survey.definitions.by_id().values():
        for signal in message.signals:
            if words(signal.name) & NO_QUANTITY and not words(signal.name) & (CELL | VOLTAGE | TEMPERATURE):
                continue
            if not signal.is_multiplexer and signal.layout.length > (1 if kind != "balancing" else 0):
                by_skeleton[cut_name(signal.name).skeleton].append((message, signal))
    for members in by_skeleton.values():
        if len(members) < _FEWEST[kind]:
            continue
        whole = _received_part(survey, kind, members) or _proposal(survey, kind, members)
        if whole is not None:
            yield whole
            continue
        in_order = _by_id(survey, kind, members)
        if in_order is not None:
            yield in_order
        for part in _split(members):
            if len(part) >= _FEWEST[kind] and len(part) < len(members):
                proposal = _proposal(survey, kind, part)
                if proposal is not None:
                    yield proposal


def _received_part(survey: BusSurvey, kind: str, members: Sequence[Member]) -> CellProposal | None:
    """The members that speak, where the DBC has room for more than the battery has; None where nothing tells so.

    Something does where each came several times and their numbers have no hole: a cell that is silent among others
    is missing, modules that never spoke are not there.
    """
    if survey.duration_s < _LONG_S:
        return None
    here = []
    for message, signal in members:
        received = survey.signal(message, signal.name)
        if received is not None and len(received.t_ns) < _OFTEN:
            return None
        if received is not None:
            here.append((message, signal))
    if not _FEWEST_RECEIVED <= len(here) < len(members):
        return None
    chosen = most_informative(columns_of(here), len(here))
    if chosen is None or prod(len(set(column.values)) for column in chosen) != len(here):
        return None
    if any(max(column.values) - min(column.values) >= len(set(column.values)) for column in chosen):
        return None
    proposal = _proposal(survey, kind, here)
    return proposal and proposal.with_reason(Message("infer-never-received", n=len(members) - len(here)))


def _split(members: Sequence[Member]) -> Iterator[list[Member]]:
    """Members by the skeleton of their message, then by message."""
    by_message: dict[str, list[Member]] = defaultdict(list)
    by_id: dict[int, list[Member]] = defaultdict(list)
    for message, signal in members:
        by_message[cut_name(message.name).skeleton].append((message, signal))
        by_id[message.can_id].append((message, signal))
    yield from by_message.values()
    if len(by_id) != len(by_message):
        yield from by_id.values()


def _by_id(survey: BusSurvey, kind: str, members: Sequence[Member]) -> CellProposal | None:
    """Messages whose signals have the same names: taken in the order of their ids."""
    by_id: dict[int, list[Member]] = defaultdict(list)
    for message, signal in members:
        by_id[message.can_id].append((message, signal))
    most = max(map(len, by_id.values()))
    if len(by_id) < 2 or most < 2 or len(members) <= (len(by_id) - 1) * most or most > _MOST_IN_A_MESSAGE:
        return None
    judgement = judged(survey, kind, tuple(members), len(members)) if kind != "balancing" else None
    if judgement is None:
        return None
    score, fitted = judgement
    entries, first = [], 0
    for can_id in sorted(by_id):
        part = by_id[can_id]
        columns = [column for column in columns_of(part) if column.where == "signal"]
        chosen: list[NameColumn] | None = most_informative(columns, len(part)) if len(part) > 1 else []
        if chosen is None or len(chosen) > 1:
            return None
        low = min(chosen[0].values) if chosen else 0
        entries.append(
            CellSignals(
                _pattern(part, chosen, ["cell"] if chosen else [], "signal"),
                part[0][0].name,
                base={"cell": low} if low else {},
                first=first,
                unit=fitted.unit if fitted else "",
                invalid=fitted.invalid if fitted else (),
            )
        )
        first += len(part)
    reason = Message("infer-by-id", messages=len(by_id), pattern=entries[0].signal)
    return CellProposal(kind, tuple(entries), first, None, tuple(members), (reason,), score - _BY_ID, fitted)


def _proposal(survey: BusSurvey, kind: str, members: Sequence[Member]) -> CellProposal | None:
    """The family as a way to speak, None where names and multiplexer do not tell its members apart."""
    columns = columns_of(members)
    chosen = most_informative(columns, len(members))
    if chosen is None:
        return None
    roles = roles_of(chosen)
    members = sorted(members, key=_order(members, chosen))
    columns = columns_of(members)
    judgement = judged(survey, kind, tuple(members), len(members)) if kind != "balancing" else (0.0, None)
    if judgement is None:
        return None
    score, fitted = judgement
    chosen = [next(c for c in columns if (c.where, c.place) == (old.where, old.place)) for old in chosen]
    segments = _segments(chosen, roles, columns)
    base = {role: 0 if column.is_letter else min(column.values) for column, role in zip(chosen, roles, strict=True)}
    base = {role: low if low <= 1 or role != "cell" or len(chosen) == 1 else 0 for role, low in base.items()}
    message_names = {message.name for message, _ in members}
    signal_pattern = _pattern(members, chosen, roles, "signal")
    message_pattern = _pattern(members, chosen, roles, "message")
    if "{" not in message_pattern and not _is_needed(survey, members):
        message_pattern = "*"
    numbers = {
        role: members[0][1].conditions[0].multiplexer
        for column, role in zip(chosen, roles, strict=True)
        if column.where == "mux"
    }
    group_cells = _group_cells(chosen, roles)
    reasons: list[Text] = [Message("infer-names", n=len(members), pattern=signal_pattern, messages=len(message_names))]
    multiplexers = [signal.conditions[0].multiplexer for _, signal in members if signal.conditions]
    if multiplexers:
        reasons.append(Message("infer-multiplexed", name=multiplexers[0]))
    entry = CellSignals(
        signal=signal_pattern,
        message=message_pattern,
        numbers=numbers,
        base={role: number for role, number in base.items() if number},
        group_cells=group_cells,
        unit=fitted.unit if fitted else "",
        invalid=fitted.invalid if fitted else (),
        invalid_signal=_flag(members, chosen, roles, ("invalid", "inval", "err", "error", "fault", "open")),
    )
    n = _count(chosen, roles, base, group_cells, segments)
    return CellProposal(kind, (entry,), n, segments, tuple(members), tuple(reasons), score, fitted)


def _order(members: Sequence[Member], columns: list[NameColumn]):  # type: ignore[no-untyped-def]  # noqa: ANN202
    keys = {
        (message.can_id, signal.name): tuple(column.values[i] for column in columns)
        for i, (message, signal) in enumerate(members)
    }
    return lambda member: keys[member[0].can_id, member[1].name]


def _segments(chosen: list[NameColumn], roles: list[str], columns: list[NameColumn]) -> tuple[int, ...] | None:
    """Cells of each pack, if a column numbers the packs."""
    if "pack" in roles:
        column = chosen[roles.index("pack")]
        low = 0 if column.is_letter else min(column.values)
        return tuple(column.values.count(value) for value in range(low, max(column.values) + 1))
    in_turns = any(column.where == "mux" and column not in chosen for column in columns)
    if "group" in roles and in_turns and chosen[roles.index("group")].where == "message":  # a message for each module
        groups = chosen[roles.index("group")].values
        runs = [groups.count(value) for value in sorted(set(groups))]
        return tuple(runs) if min(runs) >= 4 else None
    for column in columns:
        if column not in chosen and column.word in SEGMENT:
            runs = [column.values.count(value) for value in sorted(set(column.values))]
            if list(column.values) == sorted(column.values) and min(runs) >= 4:
                return tuple(runs)
    return None


def _group_cells(chosen: list[NameColumn], roles: list[str]) -> int:
    if "group" not in roles:
        return 1
    groups, cells = chosen[roles.index("group")], chosen[roles.index("cell")]
    width = max(cells.values) - min(cells.values) + 1
    steps = sorted(set(groups.values))
    is_first = groups.word in FIRST or (len(steps) > 1 and all(b - a == width for a, b in pairwise(steps)))
    return 1 if is_first and width > 1 and len(steps) > 1 and steps[1] - steps[0] == width else width


def _count(
    chosen: list[NameColumn], roles: list[str], base: dict[str, int], group_cells: int, segments: tuple[int, ...] | None
) -> int:
    if "pack" in roles and segments is not None:
        return sum(segments)
    at = {role: column.values for role, column in zip(roles, chosen, strict=True)}
    group = max(at["group"]) - base["group"] if "group" in at else 0
    last = max(
        (g - base.get("group", 0)) * group_cells + c - base.get("cell", 0)
        for g, c in zip(at.get("group", (base.get("group", 0),) * len(at["cell"])), at["cell"], strict=True)
    )
    return last + 1 if group >= 0 else 0


def _pattern(members: Sequence[Member], chosen: list[NameColumn], roles: list[str], where: str) -> str:
    names = [cut_name((message if where == "message" else signal).name) for message, signal in members]
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


def _is_needed(survey: BusSurvey, members: Sequence[Member]) -> bool:
    """Whether signals of other messages would fit too."""
    skeleton = cut_name(members[0][1].name).skeleton
    ids = {message.can_id for message, _ in members}
    return any(
        cut_name(signal.name).skeleton == skeleton
        for message in survey.definitions.by_id().values()
        if message.can_id not in ids
        for signal in message.signals
    )


def _flag(members: Sequence[Member], chosen: list[NameColumn], roles: list[str], texts: tuple[str, ...]) -> str:
    """The pattern of each signal's bit for "invalid"; "" where there is none."""
    place = next(
        (c.place for c, role in zip(chosen, roles, strict=True) if c.where == "signal" and role == "cell"), None
    )
    if place is None:
        return ""
    message, signal = members[0]
    text = cut_name(signal.name).texts[place]
    for flag in message.signals:
        cut = cut_name(flag.name)
        if flag.layout.length == 1 and text in cut.texts and any(word in flag.name.lower() for word in texts[:2]):
            at = cut.texts.index(text)
            pattern = "".join(
                piece + ("{cell}" if i == at else (cut.texts[i] if i < len(cut.texts) else ""))
                for i, piece in enumerate(cut.pieces)
            )
            if all(_has(m, pattern, cut_name(s.name).texts[place]) for m, s in members):
                return pattern
    return ""


def _has(message: MessageDefinition, pattern: str, text: str) -> bool:
    return message.signal(pattern.replace("{cell}", text)) is not None
