"""A suggested profile as TOML, with its reasons as comments, for a person to confirm or correct."""

import json
from collections.abc import Iterable, Iterator

from app.battery.battery import Battery, each_cell, spread, spread_in_packs
from app.battery.source import CellSignals, ScalarSignal
from app.sources.dbc.infer.inference import InferredProfile
from app.sources.dbc.infer.lines import SIGNED, ProfileLine, title
from app.sources.dbc.infer.proposal import CellProposal
from app.sources.dbc.infer.readings import ReadingProposal
from app.sources.dbc.infer.states import StateProposal
from app.words import Message, Text, render


def profile_text(inferred: InferredProfile, language: str = "en") -> str:
    """Return the TOML of a suggestion."""
    return "\n".join(_lines(inferred, language)) + "\n"


def _lines(inferred: InferredProfile, language: str) -> Iterator[str]:
    battery = inferred.battery
    yield "# Suggested by `voltwall battery learn`. Read the reasons, correct what is wrong; then"
    yield "# `voltwall battery check` this file."
    yield from _comments(inferred.questions, language)
    yield "[battery]"
    yield f"name = {_text(battery.name)}"
    yield f"packs = {list(battery.segments)}"
    yield f"parallel = {battery.parallel}  # cells in parallel that are measured as one: not on the bus"
    yield f"cell = {_text(battery.cell)}  # the model of what is measured as one: not on the bus"
    yield ""
    yield "[battery.temperatures]"
    yield from _sensors(battery)
    yield ""
    yield "[source]"
    dbc = inferred.source.dbc
    yield f"dbc = {_text(dbc[0]) if len(dbc) == 1 else _list(dbc)}"
    for kind, entries in inferred.source.cells.items():
        proposal = inferred.voltage if kind == "voltage" else inferred.temperature
        for i, entry in enumerate(entries):
            yield ""
            if i == 0 and proposal is not None:
                yield from _comments(proposal.reasons, language)
            yield f"[[source.{kind}]]"
            yield from _cell_signals(entry)
    for key, line in inferred.lines.items():
        if key not in ("voltage", "temperature") and not key.startswith("limit."):
            yield ""
            yield from _line(key, line, language)
    yield from _limits([line for key, line in inferred.lines.items() if key.startswith("limit.")], language)
    for key, line in inferred.lines.items():
        others = [candidate for candidate in line.candidates if title(candidate) != title(line.chosen)]
        if others:
            yield ""
            yield f"# also possible as {key}, less likely:"
            for other in others:
                yield f"#   {_one_line(title(other))}"


def _line(key: str, line: ProfileLine, language: str) -> Iterator[str]:
    """A table of a reading or a state; in comments where nobody took it yet."""
    chosen = line.chosen
    assert not isinstance(chosen, CellProposal)
    yield from _comments(chosen.reasons, language)
    mark = "" if line.is_taken else "# "
    if not line.is_taken:
        yield f"# {render(Message('infer-confirm'), language=language)}"
    yield f"{mark}[source.{key}]"
    if isinstance(chosen, StateProposal):
        yield f"{mark}signal = {_text(str(chosen.state.signal))}"
        yield (
            f"{mark}mask = {chosen.state.mask}" if chosen.state.mask else f"{mark}equals = {list(chosen.state.equals)}"
        )
    else:
        for text in _reading(key, chosen.reading):
            yield mark + text


def _limits(lines: list[ProfileLine], language: str) -> Iterator[str]:
    """The table of limits that signals carry."""
    if not lines:
        return
    yield ""
    if not all(line.is_taken for line in lines):
        yield f"# {render(Message('infer-confirm'), language=language)}"
    yield f"{'' if any(line.is_taken for line in lines) else '# '}[battery.limits]"
    for line in lines:
        assert isinstance(line.chosen, ReadingProposal)
        yield from _comments(line.chosen.reasons, language)
        signal = _text(str(line.chosen.reading.signal))
        yield f"{'' if line.is_taken else '# '}{line.key.rpartition('.')[2]} = {{ signal = {signal} }}"


def _comments(texts: Iterable[Text], language: str) -> Iterator[str]:
    for text in texts:
        yield f"# {_one_line(render(text, language=language))}"


def _one_line(text: str) -> str:
    """What a DBC says may hold line ends: a comment may not."""
    return "".join(character if character.isprintable() else " " for character in text)


def _sensors(battery: Battery) -> Iterator[str]:
    yield f"sensors = {battery.n_sensors}"
    if not battery.n_sensors or battery.sensors == each_cell(battery.n_cells):
        return
    if (
        battery.n_sensors % battery.n_packs == 0
        and spread_in_packs(battery.n_sensors, battery.segments) == battery.sensors
    ):
        yield 'cells = "pack"  # a guess: which cells each stands for is not on the bus'
    elif spread(battery.n_sensors, range(battery.n_cells)) == battery.sensors:
        yield 'cells = "spread"  # a guess: which cells each stands for is not on the bus'
    else:
        yield f"cells = {[[cell + 1 for cell in cells] for cells in battery.sensors]}"


def _cell_signals(entry: CellSignals) -> Iterator[str]:
    if entry.message != "*":
        yield f"message = {_text(entry.message)}"
    yield f"signal = {_text(entry.signal)}"
    if entry.numbers:
        yield f"numbers = {_table(entry.numbers)}"
    base = {part: low for part, low in entry.base.items() if low}
    if base:
        yield f"base = {_table(base)}"
    if entry.group_cells != 1:
        yield f"group_cells = {entry.group_cells}"
    if entry.first:
        yield f"first = {entry.first + 1}"
    for name in ("unit", "invalid_signal", "valid_signal", "checksum"):
        if getattr(entry, name):
            yield f"{name} = {_text(getattr(entry, name))}"
    if entry.invalid:
        yield f"invalid = {list(entry.invalid)}"


def _reading(name: str, reading: ScalarSignal) -> Iterator[str]:
    yield f"signal = {_text(str(reading.signal))}"
    if reading.unit:
        yield f"unit = {_text(reading.unit)}"
    if name in SIGNED:
        yield f"positive = {_text(reading.positive)}"


def _table(values: dict[str, str] | dict[str, int]) -> str:
    return (
        "{ "
        + ", ".join(f"{name} = {_text(value) if isinstance(value, str) else value}" for name, value in values.items())
        + " }"
    )


def _list(texts: Iterable[str]) -> str:
    return f"[{', '.join(map(_text, texts))}]"


def _text(text: str) -> str:
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")  # TOML has no bare DEL
