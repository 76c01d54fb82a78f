"""Current, pack voltage and SOC among all signals: by name, unit, and what the cells do meanwhile."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from app.battery.battery import SignalName
from app.battery.source import CURRENT_UNITS, SOC_UNITS, VOLTAGE_UNITS, ScalarSignal
from app.sources.dbc.bindings import known_conversion
from app.sources.dbc.current_sign import CLEAR, VoltageSeries, signed, step_correlation, wraps
from app.sources.dbc.definitions import MessageDefinition, SignalDefinition
from app.sources.dbc.infer.bus_survey import (
    CELL,
    CHARGER,
    CURRENT,
    NOT_THE_PACK,
    PACK,
    SOC,
    VOLTAGE,
    BusSurvey,
    name_set,
    words,
)
from app.sources.dbc.infer.proposal import Member
from app.words import Message, Quantity, Text

_LONG_S = 5.0
_CLOSE, _OFF = 0.02, 0.08  # relative distance from the sum of cells
_SENSORS = name_set("ivt shunt result string stack")
_OF_A_PART = name_set("module slave segment seg ic cmu chip board bmb")
_NO_PACK_VOLTAGE = name_set("cell cells zelle min max avg limit lim target soc power status state fault error counter")
_SUM = name_set("sum total summe")  # words of a sum over cells


@dataclass(frozen=True, slots=True)
class ReadingProposal:
    """A signal that may carry a quantity of the whole battery."""

    reading: ScalarSignal
    reasons: tuple[Text, ...]
    score: float
    low: float = float("nan")
    high: float = float("nan")
    is_unit_given: bool = True  # by the DBC, or by a scale


def pack_voltage_proposals(survey: BusSurvey, sum_v: float, used: set[tuple[int, str]]) -> list[ReadingProposal]:
    """Return signals that may be the voltage of all cells; `sum_v` of the cells, NaN where unknown. The best first."""
    proposals = []
    for message, signal in candidates(survey, used, "pack_voltage"):
        own, around = words(signal.name), words(message.name)
        is_sum = bool(own & _SUM and known_conversion("pack_voltage", signal.unit))
        is_named = is_sum or bool(own & VOLTAGE)
        if own & (_NO_PACK_VOLTAGE | CURRENT) - (CELL if is_sum else set()) or not (
            is_named or (own & PACK and not signal.unit)
        ):
            continue
        score = (
            2.0 * len(own & PACK - _SENSORS)
            + 0.7 * len(around & PACK - _SENSORS)
            - 2.0 * len(own & (NOT_THE_PACK - {"sum"}))
        )
        score -= 2.0 * len((own | around) & _OF_A_PART)
        score -= 1.0 * len(around & NOT_THE_PACK) + 1.5 * len({"bus", "dc", "link"} & own)
        score += 1.0 if {"pack", "total", "sum", "batt", "battery"} & own else 0.0
        reasons: list[Text] = []
        unit, low, high, mean = in_unit(survey, message, signal, "pack_voltage", VOLTAGE_UNITS, sum_v)
        if np.isfinite(mean) and np.isfinite(sum_v) and sum_v > 0:
            score += _near(survey, message, signal, mean, sum_v)
            reasons.append(Message("infer-pack-voltage-is", mean=Quantity(mean, "V", 1), sum=Quantity(sum_v, "V", 1)))
        elif survey.n_frames and not np.isfinite(mean):
            score -= not_received_penalty(survey)
        if not is_named:
            score -= 4.0
        if score > 1.5:
            name = signal_name(message, signal)
            proposals.append(
                ReadingProposal(ScalarSignal(name, unit), (*reasons, name_reason(signal, message)), score, low, high)
            )
    return sorted(proposals, key=lambda proposal: -proposal.score)


def current_proposals(
    survey: BusSurvey, pack: VoltageSeries | None, used: set[tuple[int, str]]
) -> list[ReadingProposal]:
    """Return signals that may be the current of all cells; the sign by what the voltage does. The best first."""
    proposals = []
    for message, signal in candidates(survey, used, "current"):
        own, around = words(signal.name), words(message.name)
        if not own & CURRENT and not ("ivt" in around | own and "i" in own):
            continue
        score = 2.0 + 1.5 * len(own & PACK) + 0.7 * len(around & PACK)
        score += 1.6 if "pack" in around and own <= CURRENT else 0.0
        score -= 2.5 * len(own & NOT_THE_PACK) + 1.0 * len(around & NOT_THE_PACK)
        score += 1.0 if signal.layout.is_signed or signal.layout.offset < 0 else -0.5
        score += 1.0 if known_conversion("current", signal.unit) else -0.5
        unit, low, high, mean = in_unit(survey, message, signal, "current", CURRENT_UNITS, float("nan"))
        reasons: list[Text] = [name_reason(signal, message)]
        positive: Literal["discharge", "charge"] = "discharge"
        received = survey.signal(message, signal.name)
        if received is not None and wraps(received.raw, signal.layout):
            values = signed(received.values, signal.layout)
            low, high = float(values.min()), float(values.max())
            reasons.append(Message("infer-unsigned", name=str(signal_name(message, signal))))
        if np.isfinite(mean):
            together = _correlation(survey, message, signal, pack)
            if abs(together) >= CLEAR:
                score += 4.0 * abs(together)
                positive = "charge" if together > 0 else "discharge"
                reasons.append(
                    Message("infer-sign-is", positive=_side(positive), correlation=Quantity(together, "", 2))
                )
            else:
                reasons.append(Message("infer-sign-unknown"))
            if low == high:
                score -= 0.5
        else:
            score -= not_received_penalty(survey) if survey.n_frames else 0.0
            reasons.append(Message("infer-sign-unknown"))
        if score > 1.5:
            name = signal_name(message, signal)
            is_scaled = known_conversion("current", signal.unit) is not None or signal.layout.scale != 1.0
            proposals.append(
                ReadingProposal(ScalarSignal(name, unit, positive), tuple(reasons), score, low, high, is_scaled)
            )
    return sorted(proposals, key=lambda proposal: -proposal.score)


def soc_proposals(survey: BusSurvey, used: set[tuple[int, str]]) -> list[ReadingProposal]:
    """Return signals that may be the SOC by the BMS. The best first."""
    proposals = []
    for message, signal in candidates(survey, used, "soc"):
        own, around = words(signal.name), words(message.name)
        is_soc = bool(own & SOC) or {"state", "charge"} <= own
        if not is_soc or own & {"limit", "target", "error", "fault", "status", "cell", "valid", "cells"}:
            continue
        score = (
            2.0
            + 0.5 * len(around & PACK - _SENSORS)
            - 0.6 * len(own & {"min", "max", "minimum", "maximum", "low", "high", "raw", "avg"})
        )
        unit, low, high, mean = in_unit(survey, message, signal, "soc", SOC_UNITS, float("nan"))
        if not unit and known_conversion("soc", signal.unit) is None:
            most = high if np.isfinite(high) else (signal.maximum or 100.0)
            unit = "fraction" if most <= 1.0 else ("percent" if most <= 110 else "0.1percent")
        if survey.n_frames and not np.isfinite(mean):
            score -= not_received_penalty(survey)
        if score > 0:
            name = signal_name(message, signal)
            proposals.append(
                ReadingProposal(ScalarSignal(name, unit), (name_reason(signal, message),), score, low, high)
            )
    return sorted(proposals, key=lambda proposal: -proposal.score)


def _near(
    survey: BusSurvey, message: MessageDefinition, signal: SignalDefinition, mean_v: float, sum_v: float
) -> float:
    """Score of a pack voltage that is the sum of the cells all the time: not behind a contactor."""
    off = abs(mean_v - sum_v) / sum_v
    received = survey.signal(message, signal.name)
    if off >= _OFF or received is None:
        return -4.0
    values = np.abs(received.values / np.median(received.values) - 1.0)
    return (6.0 if off < _CLOSE else 3.0) * float(np.mean(values < 2 * _OFF))


def candidates(survey: BusSurvey, used: set[tuple[int, str]], kind: str) -> Iterator[Member]:
    """Yield the signals that can carry a quantity by their unit and their bits."""
    for message in survey.definitions.by_id().values():
        for signal in message.signals:
            fits = not signal.unit or known_conversion(kind, signal.unit) is not None
            long_enough = signal.layout.length >= (7 if kind == "soc" else 8)
            if fits and long_enough and not signal.is_multiplexer and (message.can_id, signal.name) not in used:
                yield message, signal


def signal_name(message: MessageDefinition, signal: SignalDefinition) -> SignalName:
    """The name of a signal of a message, as a profile writes it."""
    return SignalName(message.name, signal.name)


def not_received_penalty(survey: BusSurvey) -> float:
    """Return the penalty of a signal that was not received: small after a short time."""
    return 4.0 if survey.duration_s > _LONG_S else 0.5


def name_reason(signal: SignalDefinition, message: MessageDefinition) -> Text:
    """The reason "by its name" for a signal."""
    return Message("infer-by-name", name=signal.name, message=message.name, unit=signal.unit or "-")


def _side(positive: str) -> Message:
    return Message("side-charge") if positive == "charge" else Message("side-discharge")


def in_unit(
    survey: BusSurvey,
    message: MessageDefinition,
    signal: SignalDefinition,
    kind: str,
    units: dict[str, float],
    wanted: float,
) -> tuple[str, float, float, float]:
    """Return the unit for the profile ("" = the DBC's), and the lowest, highest and mean that was received, or NaN."""
    received = survey.signal(message, signal.name)
    factor = (known_conversion(kind, signal.unit) or (1.0, 0.0))[0]
    if received is None:
        return "", float("nan"), float("nan"), float("nan")
    values = received.values * factor
    unit = ""
    mean = float(np.median(values))
    if np.isfinite(wanted) and mean > 0 and abs(mean - wanted) / wanted > 0.1:
        for name, scale in units.items():
            tried = float(np.median(received.values)) * scale
            if abs(tried - wanted) / wanted < 0.05:
                unit, values, mean = name, received.values * scale, tried
                break
    return unit, float(values.min()), float(values.max()), mean


def _correlation(
    survey: BusSurvey, message: MessageDefinition, signal: SignalDefinition, pack: VoltageSeries | None
) -> float:
    """Correlation of the steps of a current with those of the voltage: -1 where positive is discharge."""
    received = survey.signal(message, signal.name)
    if received is None or pack is None:
        return 0.0
    values = signed(received.values, signal.layout) if wraps(received.raw, signal.layout) else received.values
    return step_correlation(received.t_ns, values, pack)


_ASKED = name_set(
    "max maximum min minimum limit lim request requested req target set setpoint cmd command control desired allowed "
    "cell cells precharge dis discharge input ac in temp temperature fault error"
)
_LIMIT = name_set("limit limits lim max maximum allowed available peak ccl dcl capability")
_DISCHARGE = name_set("discharge discharging dis dcl dchg")
_CHARGE = name_set("charge charging chg ccl regen")
_LEAST = 2.0


def charger_proposals(survey: BusSurvey, kind: str, used: set[tuple[int, str]]) -> list[ReadingProposal]:
    """Return signals that may be what a charger gives; `kind` = charger_voltage or charger_current. The best first."""
    wanted = VOLTAGE if kind == "charger_voltage" else CURRENT
    proposals: list[ReadingProposal] = []
    for message, signal in candidates(survey, used, kind):
        own, around = words(signal.name), words(message.name)
        if not (own | around) & CHARGER or not own & wanted or own & _ASKED:
            continue
        score = 2.0 + 0.5 * len(own & CHARGER) - 1.5 * len(around & _ASKED)
        score += 1.0 if own & {"output", "out", "actual", "measured"} else 0.0
        score += 0.5 if known_conversion(kind, signal.unit) else 0.0
        _take(proposals, survey, message, signal, kind, score)
    return sorted(proposals, key=lambda proposal: -proposal.score)


def limit_proposals(survey: BusSurvey, name: str, used: set[tuple[int, str]]) -> list[ReadingProposal]:
    """Return signals that may carry a limit of current, by its name in a profile. The best first."""
    wanted, other = (_DISCHARGE, _CHARGE) if name.startswith("discharge") else (_CHARGE, _DISCHARGE)
    proposals: list[ReadingProposal] = []
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
        _take(proposals, survey, message, signal, "current", score)
    return sorted(proposals, key=lambda proposal: -proposal.score)


def _take(
    proposals: list[ReadingProposal],
    survey: BusSurvey,
    message: MessageDefinition,
    signal: SignalDefinition,
    kind: str,
    score: float,
) -> None:
    unit, low, high, mean = in_unit(survey, message, signal, kind, {}, float("nan"))
    if survey.n_frames and mean != mean:  # nothing was received of it
        score -= not_received_penalty(survey)
    if score >= _LEAST:
        reading = ScalarSignal(signal_name(message, signal), unit)
        proposals.append(ReadingProposal(reading, (name_reason(signal, message),), score, low, high))
