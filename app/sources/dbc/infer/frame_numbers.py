"""Frames that say themselves which cell they tell: a cell number, module and cell, a base number and k values."""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from app.battery.source import CellSignals
from app.sources.dbc.definitions import MessageDefinition, SignalDefinition
from app.sources.dbc.infer.bus_survey import (
    FIRST,
    GROUP,
    NO_NUMBER,
    NO_QUANTITY,
    NUMBER,
    SEGMENT,
    TEMPERATURE,
    VOLTAGE,
    BusSurvey,
    distinct,
    name_set,
    numbers,
    skeleton,
    tokens,
    words,
)
from app.sources.dbc.infer.packs import joined
from app.sources.dbc.infer.proposal import CellProposal, Member, judged
from app.words import Message, Text

_MOST_BITS = 16
MOST_NUMBERS = 1000
_LEAST_LONE = 8  # numbers of a pack signal that are rather those of cells
UNKNOWN_COUNT = 12  # cells of a pack, where neither frames nor the DBC tell how many there are
_NUMBER_WORDS = name_set("id ids idx index indices num number nr no nbr")
_OF_A_NUMBER = {"", "#", "id", "num", "number", "nr", "no", "count", "index", "-", "none"}  # what stands for a unit
_CELL_WORDS = name_set("cell zelle celle sensor therm thermistor ntc temp channel ch")


@dataclass(frozen=True, slots=True)
class _Number:
    """A signal that may number what its frame tells."""

    signal: SignalDefinition
    part: str  # pack, group, cell
    seen: tuple[int, ...]  # sorted; empty where nothing was received


def frame_number_proposals(survey: BusSurvey, kind: str) -> Iterator[CellProposal]:
    """Yield each message with a quantity of the cell that it numbers; messages alike count as one."""
    alike: dict[tuple[object, ...], list[CellProposal]] = defaultdict(list)
    for message in survey.definitions.by_id().values():
        for values in _value_signals(survey, kind, message):
            counted = _numbers(survey, message, values)
            proposal = _proposal(survey, kind, message, values, counted) if counted else None
            if proposal is not None:
                yield proposal
                if proposal.segments is None and survey.of(message) is not None:
                    alike[_shape(proposal)].append(proposal)
    for proposals in alike.values():
        together = joined(survey, kind, proposals) if len(proposals) > 1 else None
        if together is not None:
            yield together


def _shape(proposal: CellProposal) -> tuple[object, ...]:
    """What messages of the same signals have in common."""
    layouts = tuple((signal.name, signal.layout) for _, signal in proposal.members)
    return layouts, tuple(tuple(sorted(entry.numbers.items())) for entry in proposal.entries)


def _value_signals(survey: BusSurvey, kind: str, message: MessageDefinition) -> Iterator[list[SignalDefinition]]:
    """Signals of a message that can carry the quantity: those of one name but for its numbers, or one by itself."""
    families: dict[str, list[SignalDefinition]] = {}
    for signal in message.signals:
        if words(signal.name) & (_NUMBER_WORDS | NO_QUANTITY) or signal.is_multiplexer:
            continue
        if judged(survey, kind, ((message, signal),), 1) is not None:
            families.setdefault(_lettered(signal.name), []).append(signal)
    for family in families.values():
        by_layout = {signal.layout.length for signal in family}
        if len(by_layout) == 1 and len({signal.conditions for signal in family}) == 1:
            yield sorted(family, key=lambda s: (numbers(s.name), s.name))


def _lettered(name: str) -> str:
    """A name without its numbers and single letters, `volt_A` and `VoltB` alike."""
    return "".join(token for token in tokens(skeleton(name)) if len(token) > 1 or token in "vtu")


def _numbers(survey: BusSurvey, message: MessageDefinition, values: list[SignalDefinition]) -> list[_Number]:
    numbers = []
    for signal in message.signals:
        own = words(signal.name)
        numeric = signal.is_multiplexer or bool(own & (NUMBER | SEGMENT | GROUP))
        if values[0].conditions and (signal.is_multiplexer or signal.conditions != values[0].conditions):
            continue
        if signal in values or not numeric or signal.layout.length > _MOST_BITS or signal.layout.is_float:
            continue
        is_whole = signal.layout.scale == 1.0 and signal.layout.offset == int(signal.layout.offset)
        if signal.layout.length < 2 or not is_whole or signal.unit.lower() not in _OF_A_NUMBER or own & NO_NUMBER:
            continue
        if own & (VOLTAGE | TEMPERATURE) and not own & _NUMBER_WORDS:
            continue
        seen = distinct([survey.signal(message, signal.name)])
        if survey.of(message) is not None and len(seen) == 0:
            continue
        if len(seen) and (seen[0] < 0 or len(seen) > MOST_NUMBERS):
            continue
        numbers.append(_Number(signal, _part_of(signal, own), tuple(int(value) for value in seen)))
    return numbers


def _part_of(signal: SignalDefinition, own: frozenset[str]) -> str:
    if own & SEGMENT and not own & _CELL_WORDS:
        return "pack"
    if own & GROUP:
        return "group"
    if own & SEGMENT and any(f"{word}_" in signal.name.lower() for word in SEGMENT) and not own & {"cell", "zelle"}:
        return "pack"
    return "cell"


def _proposal(
    survey: BusSurvey, kind: str, message: MessageDefinition, values: list[SignalDefinition], counted: list[_Number]
) -> CellProposal | None:
    pack = _best([number for number in counted if number.part == "pack"])
    cells = [number for number in counted if number.part == "cell"]
    group = _best([number for number in counted if number.part == "group"])
    members: tuple[Member, ...] = tuple((message, signal) for signal in values)
    if len(values) > 1 and len(cells) == len(values):  # each value with its own number
        entries = tuple(
            CellSignals(
                signal=signal.name,
                message=message.name,
                numbers=_segment_names(pack) | {"cell": cell.signal.name},
                base=_bases(pack, cells),
            )
            for signal, cell in zip(values, _paired(values, cells), strict=True)
        )
        n, segments = _size(survey, message, pack, cells, 1, 1)
        reason = Message("infer-own-numbers", message=message.name, k=len(values))
        return _built(survey, kind, entries, n, segments, members, [reason, *_unknown(cells)])
    cell = _best(cells)
    if len(values) == 1:
        if len(cells) > 1 and pack is not None:  # several cells have a number, the one value is of all of them
            cell, pack = pack, None
        number = cell or group
        if number is None and pack is not None and len(pack.seen) >= _LEAST_LONE:
            pack, number = None, pack
        if number is None:
            return None
        entry = CellSignals(
            values[0].name,
            message.name,
            numbers=_segment_names(pack) | {"cell": number.signal.name},
            base=_bases(pack, [number]),
        )
        n, segments = _size(survey, message, pack, [number], 1, 1)
        return _built(
            survey, kind, (entry,), n, segments, members, [_reason(message, pack, number), *_unknown([number])]
        )
    number = group or cell or pack
    if number is None:
        return None
    pack = None if number is pack else pack
    step = 1 if _counts_cells(number, len(values)) else len(values)
    pattern, lowest = _cell_pattern(values)
    if not pattern:
        return None
    base = _bases(pack, []) | {"group": _lowest(number), "cell": lowest}
    named = _segment_names(pack) | {"group": number.signal.name}
    entries = (CellSignals(pattern, message.name, named, {k: v for k, v in base.items() if v}, group_cells=step),)
    n, segments = _size(survey, message, pack, [number], step, len(values))
    reason = Message("infer-base-number", message=message.name, number=number.signal.name, k=len(values), step=step)
    return _built(survey, kind, entries, n, segments, members, [reason, *_unknown([number])])


def _unknown(numbers: list[_Number]) -> list[Text]:
    """The question to a person where the number of cells is unknown."""
    is_known = any(number.seen or number.signal.choices or _declares(number) for number in numbers)
    return [] if is_known else [Message("infer-count-unknown", number=numbers[0].signal.name)]


def _declares(number: _Number) -> bool:
    most = number.signal.maximum
    return most is not None and 1 <= most < 2**number.signal.layout.length - 1


def _built(
    survey: BusSurvey,
    kind: str,
    entries: tuple[CellSignals, ...],
    n: int,
    segments: tuple[int, ...] | None,
    members: tuple[Member, ...],
    reasons: list[Text],
) -> CellProposal | None:
    if not 2 <= n <= MOST_NUMBERS:
        return None
    message, signal = members[0]
    if survey.of(message) is None:  # a number that the DBC declares says little: names must say more than a `V`
        spelled = {word for word in words(signal.name) | words(message.name) if len(word) > 1}
        if not spelled & (_CELL_WORDS | (VOLTAGE if kind == "voltage" else TEMPERATURE)):
            return None
    judgement = judged(survey, kind, members, n if survey.of(message) is not None else min(n, UNKNOWN_COUNT))
    if judgement is None:
        return None
    score, fitted = judgement
    if fitted is not None:
        entries = tuple(_with_fit(entry, fitted.unit, fitted.invalid) for entry in entries)
    return CellProposal(kind, entries, n, segments, members, tuple(reasons), score + 1.0, fitted)


def _with_fit(entry: CellSignals, unit: str, invalid: tuple[int, ...]) -> CellSignals:
    return CellSignals(
        entry.signal, entry.message, entry.numbers, entry.base, entry.group_cells, unit=unit, invalid=invalid
    )


def _best(numbers: list[_Number]) -> _Number | None:
    """The one with most numbers; of those that were not received the widest."""
    return max(numbers, key=lambda number: (len(number.seen), number.signal.layout.length), default=None)


def _segment_names(pack: _Number | None) -> dict[str, str]:
    return {} if pack is None else {"pack": pack.signal.name}


def _run(seen: tuple[int, ...]) -> tuple[int, ...]:
    """The numbers up to which at least half are there: a lone 255 is no cell, cells that were not received yet are."""
    low = min(seen[0], 1) if seen else 0
    step = float(np.median(np.diff(seen))) if len(seen) > 1 else 1.0
    full = [n for n, value in enumerate(seen, 1) if 2 * n * step >= value - low + 1]
    return seen[: full[-1]] if full else seen[:1]


def _lowest(number: _Number) -> int:
    if number.seen:
        return number.seen[0] if number.seen[0] <= 1 else 0
    low = number.signal.minimum
    return 1 if low == 1 else 0


def _bases(pack: _Number | None, cells: list[_Number]) -> dict[str, int]:
    bases = {} if pack is None else {"pack": _lowest(pack)}
    if cells:
        bases["cell"] = min(_lowest(cell) for cell in cells)
    return {part: low for part, low in bases.items() if low}


def _counts_cells(number: _Number, k: int) -> bool:
    """Whether a base number is that of its first cell."""
    if len(number.seen) > 1:
        gaps = np.diff(_run(number.seen))
        return bool(len(gaps) and k > 1 and np.median(gaps) == k)
    return bool(words(number.signal.name) & FIRST)


def _size(
    survey: BusSurvey, message: MessageDefinition, pack: _Number | None, cells: list[_Number], step: int, k: int
) -> tuple[int, tuple[int, ...] | None]:
    """Number of cells, and of the cells of each pack if the frame numbers packs."""
    low = min(_lowest(cell) for cell in cells)
    if pack is None:
        if any(cell.seen for cell in cells):
            last = max(_run(cell.seen)[-1] for cell in cells if cell.seen)
        else:
            last = int(max(_declared_last(cell) for cell in cells))
        return (last - low) * step + k, None
    received = survey.of(message)
    if received is None:
        n_packs, n_cells = (
            int(_declared_last(pack)) + 1,
            int(max(_declared_last(cell) for cell in cells)) - low + 1,
        )
        n_packs -= _lowest(pack)
        return n_packs * ((n_cells - 1) * step + k), (((n_cells - 1) * step + k),) * max(n_packs, 1)
    of_pack = received.group.raw(pack.signal.name).astype(np.int64) + round(pack.signal.layout.offset)
    sizes: dict[int, int] = {}
    for cell in cells:
        run = _run(cell.seen)
        of_cell = received.group.raw(cell.signal.name).astype(np.int64) + round(cell.signal.layout.offset)
        for one in _run(pack.seen):
            here = of_cell[(of_pack == one) & (of_cell <= run[-1])]
            last = (int(here.max()) - low) * step + k if len(here) else 0
            sizes[one] = max(sizes.get(one, 0), last)
    counts = tuple(sizes.get(i, 0) for i in range(_lowest(pack), max(sizes, default=-1) + 1))
    filled = tuple(count or max(counts, default=0) for count in counts)
    return sum(filled), filled


def _declared_last(number: _Number) -> float:
    """The highest number that the DBC declares, where it declares one that means something."""
    if number.signal.choices:
        return max(number.signal.choices)
    if number.signal.maximum is not None and _declares(number):
        return number.signal.maximum
    return UNKNOWN_COUNT - 1 + _lowest(number)


def _paired(values: list[SignalDefinition], cells: list[_Number]) -> list[_Number]:
    """The number of each value: of the same letter or digit at its end, else in the order of the frame."""
    ends = {_end(cell.signal.name): cell for cell in cells}
    if len(ends) == len(cells) and all(_end(signal.name) in ends for signal in values):
        return [ends[_end(signal.name)] for signal in values]
    return sorted(cells, key=lambda cell: cell.signal.name)


def _end(name: str) -> str:
    parts = [token for token in tokens(name) if token.isdigit() or (len(token) == 1 and token not in "vtu")]
    return parts[-1] if parts else ""


def _cell_pattern(values: list[SignalDefinition]) -> tuple[str, int]:
    """Pattern of names that differ in one number or letter which runs on, and the lowest; "" where they do not."""
    names = [signal.name for signal in values]
    head = _same_start(names).rstrip("0123456789")
    tail = _same_start([name[len(head) :][::-1] for name in names])[::-1].lstrip("0123456789")
    ends = [name[len(head) : len(name) - len(tail)] for name in names]
    if all(end.isdigit() for end in ends):
        lowest = int(ends[0])
        if [int(end) - lowest for end in ends] == list(range(len(ends))):
            return f"{head}{{cell}}{tail}", lowest
    if "".join(ends) in ("abcdefgh"[: len(ends)], "ABCDEFGH"[: len(ends)]):
        return f"{head}{{cell:a}}{tail}", 0
    return "", 0


def _same_start(names: list[str]) -> str:
    length = 0
    while length < min(map(len, names)) and len({name[length] for name in names}) == 1:
        length += 1
    return names[0][:length]


def _reason(message: MessageDefinition, pack: _Number | None, number: _Number) -> Text:
    if pack is None:
        return Message("infer-cell-number", message=message.name, number=number.signal.name)
    return Message("infer-two-numbers", message=message.name, pack=pack.signal.name, number=number.signal.name)
