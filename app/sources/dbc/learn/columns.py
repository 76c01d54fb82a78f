"""The numbers in the names of signals and messages, as columns; which of them tell cells apart."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

from app.sources.dbc.learn.proposal import Member
from app.sources.dbc.learn.words_of_names import GROUP, SEGMENT, tokens

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
    for found in _PART.finditer(name):
        pieces.append(name[at : found.start()])
        texts.append(found[0])
        at = found.end()
    pieces.append(name[at:])
    values = tuple(int(text) if text.isdigit() else ord(text.upper()) - ord("A") for text in texts)
    return Name(tuple(pieces), tuple(texts), values)


@dataclass(frozen=True, slots=True)
class Column:
    """One number of all members: of the message's name, the signal's, or the multiplexer's value."""

    where: str  # message, signal, mux
    place: int
    values: tuple[int, ...]
    texts: tuple[str, ...]
    word: str  # in front of it

    @property
    def is_letter(self) -> bool:
        """Whether letters stand for its numbers."""
        return bool(self.texts) and self.texts[0].isalpha()

    @property
    def varies(self) -> bool:
        """Whether members differ in it."""
        return len(set(self.values)) > 1


def columns_of(members: Sequence[Member]) -> list[Column]:
    """Return the numbers that differ between members: of their messages, their names, their multiplexer."""
    of_message = [cut_name(message.name) for message, _ in members]
    of_signal = [cut_name(signal.name) for _, signal in members]
    found = []
    for where, names in (("message", of_message), ("signal", of_signal)):
        if len({name.skeleton for name in names}) > 1:
            continue
        for place in range(len(names[0].values)):
            before = tokens(names[0].pieces[place])
            values = tuple(name.values[place] for name in names)
            texts = tuple(name.texts[place] for name in names)
            found.append(Column(where, place, values, texts, before[-1] if before else ""))
    conditions = [signal.conditions for _, signal in members]
    if all(len(each) == 1 and len(each[0].values) == 1 for each in conditions):
        values = tuple(each[0].values[0] for each in conditions)
        word = tokens(conditions[0][0].multiplexer)
        found.insert(0, Column("mux", 0, values, (), next((w for w in word if w in SEGMENT), word[-1] if word else "")))
    return [column for column in found if column.varies]


def telling(columns: list[Column], n: int) -> list[Column] | None:
    """Return the fewest columns that tell all members apart; those of the signal's name first."""
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


def _effort(columns: tuple[Column, ...]) -> tuple[int, int]:
    """How far fetched it is that these columns number the cells: less is better."""
    places = sum(("signal", "message", "mux").index(column.where) for column in columns)
    outer = columns[0]
    full = sum(len(set(column.values)) for column in columns)
    return (0 if len(columns) == 1 or outer.word in SEGMENT else 1) + places, full


def roles_of(columns: list[Column]) -> list[str]:
    """Return what each column counts, from the outermost to the cell."""
    if len(columns) == 1:
        return ["cell"]
    outer = "segment" if _is_segment(columns[0]) else "group"
    if len(columns) == 2:
        return [outer, "cell"]
    return ["segment", "group", "cell"]


def _is_segment(column: Column) -> bool:
    if column.word in SEGMENT:
        return True
    return column.word not in GROUP and column.where == "signal"
