"""Signals of the charger, and limits that the battery tells: by name and unit."""

from app.battery.source import Reading
from app.sources.dbc.definitions import MessageDefinition, Signal
from app.sources.dbc.learn.readings import ReadingProposal, candidates, in_unit, name_reason, signal_name, unheard
from app.sources.dbc.learn.survey import Survey
from app.sources.dbc.learn.words_of_names import CHARGER, CURRENT, VOLTAGE, name_set, words
from app.sources.dbc.units import known_conversion

_ASKED = name_set(
    "max maximum min minimum limit lim request requested req target set setpoint cmd command control desired allowed "
    "cell cells precharge dis discharge input ac in temp temperature fault error"
)
_LIMIT = name_set("limit limits lim max maximum allowed available peak ccl dcl capability")
_DISCHARGE = name_set("discharge discharging dis dcl dchg")
_CHARGE = name_set("charge charging chg ccl regen")
_LEAST = 2.0


def charger_proposals(survey: Survey, kind: str, used: set[tuple[int, str]]) -> list[ReadingProposal]:
    """Return signals that may be what a charger gives; `kind` = charger_voltage or charger_current. The best first."""
    wanted = VOLTAGE if kind == "charger_voltage" else CURRENT
    found: list[ReadingProposal] = []
    for message, signal in candidates(survey, used, kind):
        own, around = words(signal.name), words(message.name)
        if not (own | around) & CHARGER or not own & wanted or own & _ASKED:
            continue
        score = 2.0 + 0.5 * len(own & CHARGER) - 1.5 * len(around & _ASKED)
        score += 1.0 if own & {"output", "out", "actual", "measured"} else 0.0
        score += 0.5 if known_conversion(kind, signal.unit) else 0.0
        _take(found, survey, message, signal, kind, score)
    return sorted(found, key=lambda each: -each.score)


def limit_proposals(survey: Survey, name: str, used: set[tuple[int, str]]) -> list[ReadingProposal]:
    """Return signals that may carry a limit of current, by its name in a profile. The best first."""
    wanted, other = (_DISCHARGE, _CHARGE) if name.startswith("discharge") else (_CHARGE, _DISCHARGE)
    found: list[ReadingProposal] = []
    for message, signal in candidates(survey, used, "current"):
        own, around = words(signal.name), words(message.name)
        is_limit = bool(own & _LIMIT) or bool(around & _LIMIT)
        if not is_limit or not own & wanted or own & other - {"charge"} or own & {"cell", "charger", "voltage"}:
            continue
        if not (own & (CURRENT | {"ccl", "dcl"}) or known_conversion("current", signal.unit) == (1.0, 0.0)):
            continue
        score = 2.0 + (1.0 if own & {"ccl", "dcl"} or own & _LIMIT else 0.0)
        score -= 0.5 * len(own & {"peak", "pulse", "short"}) + 1.0 * len((own | around) & {"inverter", "mc", "motor"})
        score -= 0.5 * len(around & CHARGER)
        _take(found, survey, message, signal, "current", score)
    return sorted(found, key=lambda each: -each.score)


def _take(
    found: list[ReadingProposal], survey: Survey, message: MessageDefinition, signal: Signal, kind: str, score: float
) -> None:
    unit, low, high, mean = in_unit(survey, message, signal, kind, {}, float("nan"))
    if survey.n_frames and mean != mean:  # nothing was heard of it
        score -= unheard(survey)
    if score >= _LEAST:
        reading = Reading(signal_name(message, signal), unit)
        found.append(ReadingProposal(reading, (name_reason(signal, message),), score, low, high))
