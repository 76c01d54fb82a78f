"""The lines of a suggestion: what each could be, what was chosen, and how a person's correction changes it."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from app.battery.battery import SignalName
from app.battery.source import CURRENT_UNITS, SOC_UNITS, TEMPERATURE_UNITS, VOLTAGE_UNITS, ScalarSignal, StateSignal
from app.sources.dbc.definitions import Definitions, MessageDefinition, SignalDefinition
from app.sources.dbc.infer.proposal import CellProposal
from app.sources.dbc.infer.readings import ReadingProposal
from app.sources.dbc.infer.states import StateProposal
from app.words import Message

Candidate = CellProposal | ReadingProposal | StateProposal
UNITS: dict[str, tuple[str, ...]] = {
    "voltage": tuple(VOLTAGE_UNITS),
    "temperature": tuple(TEMPERATURE_UNITS),
    "current": tuple(CURRENT_UNITS),
    "pack_voltage": tuple(VOLTAGE_UNITS),
    "soc": tuple(SOC_UNITS),
    "charger_voltage": tuple(VOLTAGE_UNITS),
    "charger_current": tuple(CURRENT_UNITS),
}
LINE_UNITS = {
    "voltage": "V",
    "temperature": "degC",
    "current": "A",
    "pack_voltage": "V",
    "charger_voltage": "V",
    "charger_current": "A",
    "limit": "A",
}  # units of a line, by the first word of its key
SIGNED = ("current", "charger_current")
CONFIRMED_FIRST = ("state.", "limit.")  # lines that raise alarms: nobody's before a person took them


@dataclass(frozen=True, slots=True)
class Choice:
    """A person's choice for a line; empty: as suggested."""

    signal: str = ""  # title of a candidate, or MESSAGE.SIGNAL
    is_taken: bool | None = None
    unit: str = ""
    positive: str = ""  # sign of a current: discharge or charge
    equals: tuple[int, ...] = ()  # values of a state that mean yes


@dataclass(frozen=True, slots=True)
class ProfileLine:
    """One thing that a profile says: `chosen` of the candidates, left out where it is not taken."""

    key: str
    candidates: tuple[Candidate, ...]
    chosen: Candidate
    is_taken: bool


def title(candidate: Candidate) -> str:
    """Return what tells a candidate from the others of its line."""
    if isinstance(candidate, CellProposal):
        entry = candidate.entries[0]
        return entry.signal if entry.message == "*" else f"{entry.message}: {entry.signal}"
    return str(candidate.state.signal if isinstance(candidate, StateProposal) else candidate.reading.signal)


def line_of(
    key: str, candidates: Sequence[Candidate], choices: Mapping[str, Choice], definitions: Definitions
) -> ProfileLine | None:
    """Return a line by its candidates, the best first, and what a person chose; None where there is nothing."""
    choice = choices.get(key, Choice())
    offered = list(candidates)
    chosen = next((candidate for candidate in offered if title(candidate) == choice.signal), None)
    if chosen is None and choice.signal and key not in ("voltage", "temperature"):
        chosen = _any_signal(key, choice, definitions)
        offered += [chosen] if chosen is not None else []
    if chosen is None:
        if not offered:
            return None
        chosen = offered[0]
    usual = not key.startswith(CONFIRMED_FIRST)
    return ProfileLine(
        key, tuple(offered), _corrected(key, chosen, choice), usual if choice.is_taken is None else choice.is_taken
    )


def _corrected(key: str, candidate: Candidate, choice: Choice) -> Candidate:
    if isinstance(candidate, CellProposal):
        if choice.unit not in UNITS[key]:
            return candidate
        return replace(candidate, entries=tuple(replace(entry, unit=choice.unit) for entry in candidate.entries))
    if isinstance(candidate, StateProposal):
        if not choice.equals:
            return candidate
        return replace(candidate, state=replace(candidate.state, equals=choice.equals, mask=0))
    reading = candidate.reading
    if choice.unit in UNITS.get(key, ()):
        reading = replace(reading, unit=choice.unit)
    if choice.positive in ("charge", "discharge"):
        reading = replace(reading, positive="charge" if choice.positive == "charge" else "discharge")
    return replace(candidate, reading=reading)


def _any_signal(key: str, choice: Choice, definitions: Definitions) -> Candidate | None:
    """Whatever signal a person names."""
    signal = find_signal(definitions, choice.signal)
    if signal is None:
        return None
    name = SignalName(signal[0].name, signal[1].name)
    reasons = (Message("infer-by-person"),)
    if key.startswith("state."):
        return StateProposal(StateSignal(name), reasons, 0.0)
    return ReadingProposal(ScalarSignal(name), reasons, 0.0)


def find_signal(definitions: Definitions, name: str) -> tuple[MessageDefinition, SignalDefinition] | None:
    """Return a signal by MESSAGE.SIGNAL."""
    message_name, _, signal_name = re.sub(r"\s", "", name).rpartition(".")
    for message in definitions.by_id().values():
        signal = message.signal(signal_name) if message.name == message_name else None
        if signal is not None:
            return message, signal
    return None
