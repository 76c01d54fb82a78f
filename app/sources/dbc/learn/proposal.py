"""A proposed way in which cells or sensors are spoken, and how much speaks for it."""

from dataclasses import dataclass, replace
from math import log2

from app.battery.source import CellSignals
from app.sources.dbc.definitions import MessageDefinition, Signal
from app.sources.dbc.learn.quantity import Fit, declared_fit, fit, fits
from app.sources.dbc.learn.survey import Heard, Survey
from app.sources.dbc.learn.words_of_names import CELL, NOT_A_CELL, TEMPERATURE, VOLTAGE, name_set, words
from app.words import Text

Member = tuple[MessageDefinition, Signal]
_HARD = name_set(
    "min max minimum maximum avg average mean limit limits threshold delta diff sum total motor inverter bal "
    "balance balancing soc soh resist resistance ocv open lowest highest low high over under ov uv ot ut "
    "current"
)
_MANY = 24  # of one unit are hardly anything but cells
_INNER = name_set("afe debug sim simulation test dummy raw request req rx")  # messages that are rather not the car's


@dataclass(frozen=True, slots=True)
class CellProposal:
    """Signals that may carry cell voltages or temperatures."""

    kind: str
    entries: tuple[CellSignals, ...]
    n: int  # cells or sensors
    segments: tuple[int, ...] | None  # cells of each where names or numbers tell
    members: tuple[Member, ...]
    reasons: tuple[Text, ...]
    score: float
    fit: Fit | None  # of the values that were heard
    mean: float = float("nan")  # V or degC of all that was heard

    def with_reason(self, *reasons: Text) -> "CellProposal":
        """The same with more reasons."""
        return replace(self, reasons=(*self.reasons, *reasons))


def heard_of(survey: Survey, members: tuple[Member, ...]) -> list[tuple[Signal, Heard]]:
    """Return the signals of which something was heard."""
    found = [(signal, survey.signal(message, signal.name)) for message, signal in members]
    return [(signal, heard) for signal, heard in found if heard is not None]


def judged(survey: Survey, kind: str, members: tuple[Member, ...], n: int) -> tuple[float, Fit | None] | None:
    """Return how much speaks for members to carry a quantity, None where they cannot."""
    message, signal = members[0]
    own, around = words(signal.name), words(message.name)
    wanted = VOLTAGE if kind == "voltage" else TEMPERATURE
    other = TEMPERATURE if kind == "voltage" else VOLTAGE
    declared = declared_fit(kind, signal)
    if declared < 0 or own & _HARD:
        return None
    score = log2(max(n, 1)) + 2.0 * declared
    score += 3.0 if own & CELL else (1.5 if around & CELL else 0.0)
    score += 2.5 if own & wanted else (1.5 if around & wanted else 0.0)
    if not (own | around) & (CELL | wanted):
        score -= 3.0 if declared < 1.0 or n < _MANY else 1.5
    if own & other and not own & wanted:
        score -= 4.0
    score -= 2.0 * len(own & NOT_A_CELL) + 1.5 * len(around & NOT_A_CELL & _HARD)
    score -= 0.3 * len(around & _INNER)
    heard = heard_of(survey, members)
    found = fit(kind, heard) if heard else None
    if heard:
        score += 4.0 if fits(found) else -8.0
        score += log2(max(len(heard) / len(members), 0.05))
    elif survey.n_frames:
        score -= 5.0
    return score, found
