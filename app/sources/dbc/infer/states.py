"""States of the battery among all signals: closed, pre-charge, fault, charging, balancing; a person confirms them.

Evidence for a signal: its name, the texts of its values (`VAL_`), how few values it takes, and the current: what
is `closed` must be so while a heavy current flows.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.battery.battery import SignalName
from app.battery.source import STATES, StateSignal
from app.estimation.arrays import BoolArray
from app.sources.dbc.definitions import MessageDefinition, SignalDefinition
from app.sources.dbc.infer.bus_survey import BusSurvey, ReceivedSignal, name_set, words
from app.sources.dbc.infer.readings import not_received_penalty
from app.words import Message, Text

_MOST_BITS = 16  # bits of a state; a wider word is a set of flags
_FEW = 8  # values that a state without texts takes
_HEAVY = 0.3  # share of the highest current: only closed contactors carry it
_STATE = name_set("state states status mode stato zustand tilstand fsm sm machine")
_OF_PACK = name_set("bms ams accumulator accu acc akku batt battery bat pack pacco hv hvs ts tractive bmu bmc master")
_NOT = name_set(
    "imd inverter inv mc mcu motor cell cells vcu dash dcu pdu lv lvs gps charger next new last previous request req "
    "cmd command counter cnt crc timer time led lamp event ecu pump fan brake pedal allowed enable enabled ok ready "
    "warning warn count module slave segment comm communication"
)
_OF_OTHERS = name_set("next last event interlock hvil shutdown sdc imd")
_CONTACTOR = name_set(
    "air airs airp airn contactor contactors kontaktor schuetz schütz schutz relay relays relais tsactive hvactive main"
)
_SIDE = name_set("minus neg negative n")
_PRECHARGE = name_set(
    "precharge precharging prechg prechrg pre prech precarica vorladen vorladung vorlade vorladerelais forlading pcr pc"
)
_FAULT = name_set(
    "fault faults error errors err fail failure failed fatal fehler errore errori feil trip tripped alarm"
)
_CHARGING = name_set("charging charge laden laedt carica lading chg")
_BALANCING = name_set("balancing balance balancer balanciert bilanciamento equalizing")
_CLOSED_TEXTS = name_set(
    "closed close active drive driving run running on discharge discharging charge charging normal operate operation "
    "operational rtd energized enable enabled hvon tson geschlossen ein"
)
_NO_TEXTS = name_set(
    "allowed inactive open off not no dis disable disabled invalid stuck welded ready done finished complete stop "
    "stopped"
)
_ENDED = name_set("done finished complete completed ok timeout success no not off")


@dataclass(frozen=True, slots=True)
class StateProposal:
    """A signal that may tell a state."""

    state: StateSignal
    reasons: tuple[Text, ...]
    score: float


@dataclass(frozen=True, slots=True)
class Flow:
    """The current over time, reduced to where it is heavy."""

    t_ns: NDArray[np.int64]
    is_heavy: BoolArray

    @classmethod
    def of(cls, received: ReceivedSignal | None) -> "Flow | None":
        """The flow of a current that was received; None where none is ever heavy."""
        if received is None or not len(received.values):
            return None
        size = np.abs(received.values)
        most = float(np.max(size))
        if not most > 0 or float(np.median(size)) > 0.9 * most:
            return None
        return cls(received.t_ns, size > _HEAVY * most)

    def during(self, received: ReceivedSignal) -> BoolArray:
        """(n,) values of another signal that came while the current was heavy."""
        at = np.clip(np.searchsorted(self.t_ns, received.t_ns, side="right") - 1, 0, len(self.t_ns) - 1)
        return np.asarray(self.is_heavy[at] & (received.t_ns >= self.t_ns[0]), np.bool_)


def state_proposals(survey: BusSurvey, flow: Flow | None, used: set[tuple[int, str]]) -> dict[str, list[StateProposal]]:
    """Return the signals that may carry each state, the best first, without states that have none."""
    proposals: dict[str, list[StateProposal]] = {}
    for message in survey.definitions.by_id().values():
        for signal in message.signals:
            if (message.can_id, signal.name) in used or not _may_carry(signal):
                continue
            for name in STATES:
                proposal = _proposal(survey, flow, name, message, signal)
                if proposal is not None:
                    proposals.setdefault(name, []).append(proposal)
    return {
        name: sorted(proposals[name], key=lambda suggested: -suggested.score) for name in STATES if name in proposals
    }


def _may_carry(signal: SignalDefinition) -> bool:
    layout = signal.layout
    is_whole = layout.scale == 1.0 and layout.offset == 0.0 and not layout.is_float
    return is_whole and not signal.unit and not signal.is_multiplexer and layout.length <= 32


def _proposal(
    survey: BusSurvey, flow: Flow | None, name: str, message: MessageDefinition, signal: SignalDefinition
) -> StateProposal | None:
    received = survey.signal(message, signal.name)
    by_texts = _by_texts(name, message, signal) if len(signal.choices) > 1 else None
    proposal = by_texts or _by_name(name, message, signal, received, flow)
    if proposal is None:
        return None
    equals, mask, score, reasons = proposal
    if received is not None:
        is_so = np.isin(received.raw, equals) if not mask else (received.raw & mask) != 0
        if len(np.unique(received.raw)) > _FEW and not mask:
            return None
        heavy = None if flow is None else flow.during(received)
        if heavy is not None and heavy.any() and name in ("closed", "precharge"):
            share = float(np.mean(is_so[heavy]))
            if (share < 0.9) == (name == "closed"):
                return None
            score += 2.0
            reasons.append(Message("infer-state-flows") if name == "closed" else Message("infer-state-rests"))
        if name == "fault" and np.mean(is_so) > 0.5:
            score -= 1.0
        if not is_so.any() or is_so.all():
            reasons.append(_unverified(received, is_so=bool(is_so.all())))
            score -= 0.2
    elif survey.n_frames:
        score -= not_received_penalty(survey)
    if score < 1.0:
        return None
    state = StateSignal(SignalName(message.name, signal.name), equals or (1,), mask)
    return StateProposal(state, tuple(reasons), score)


def _unverified(received: ReceivedSignal, *, is_so: bool) -> Message:
    """Why a state that was the same in all frames is not verified."""
    values = np.unique(received.raw)
    if len(values) == 1:
        return Message("infer-state-constant", value=int(values[0]))
    shown = ", ".join(map(str, values[:_FEW].tolist()))
    return Message("infer-state-always", values=shown) if is_so else Message("infer-state-never", values=shown)


_Found = tuple[tuple[int, ...], int, float, list[Text]]


def _by_texts(name: str, message: MessageDefinition, signal: SignalDefinition) -> _Found | None:
    """The values whose texts say the state."""
    own, around = words(signal.name), words(message.name)
    of_battery = len((own | around) & _OF_PACK)
    is_contactor = bool(own & _CONTACTOR)
    is_precharge = bool(own & _PRECHARGE)
    yes = tuple(
        sorted(
            n for n, text in signal.choices.items() if _text_names_state(name, words(text), is_contactor, is_precharge)
        )
    )
    if not yes or len(yes) == len(signal.choices):
        return None
    if not (own | around) & (_STATE | _CONTACTOR | _PRECHARGE | _FAULT) or (own | around) & _OF_OTHERS:
        return None
    score = 2.0 + min(of_battery, 2) - 2.0 * len(own & _NOT) - 1.0 * len(around & _NOT - {"master"})
    score += 1.0 if own & _STATE else 0.0
    score += 1.0 if (name == "closed" and is_contactor) or (name == "fault" and own & _STATE) else 0.0
    score += 1.5 if name == "precharge" and is_precharge else 0.0
    score -= 0.3 if own & _SIDE else 0.0
    texts = ", ".join(f"{n} {signal.choices[n]}" for n in yes)
    return yes, 0, score, [Message("infer-state-texts", name=signal.name, message=message.name, texts=texts)]


def _text_names_state(name: str, text: frozenset[str], is_contactor: bool, is_precharge: bool) -> bool:
    is_fault = bool(text & _FAULT)
    pre = bool(text & (_PRECHARGE - {"pc"}))
    if name == "fault":
        return is_fault and not text & {"no", "none", "not", "ok"} and not is_contactor
    if is_fault:
        return False
    if name == "precharge":
        if is_precharge and text & {"active", "running", "on", "closed"}:
            return True
        return pre and not text & _ENDED
    if pre:
        return False
    if name == "charging":
        return bool(text & (_CHARGING - {"chg"})) and not text & ({"discharge", "discharging"} | _NO_TEXTS)
    if name == "balancing":
        return bool(text & _BALANCING) and not text & _NO_TEXTS
    return not is_precharge and bool(text & _CLOSED_TEXTS) and not text & _NO_TEXTS


def _by_name(
    name: str, message: MessageDefinition, signal: SignalDefinition, received: ReceivedSignal | None, flow: Flow | None
) -> _Found | None:
    """A bit, or a number without texts, whose name says the state."""
    own, around = words(signal.name), words(message.name)
    score = _score_of_name(name, own, around)
    if score is None or (own | around) & _OF_OTHERS:
        return None
    score += 0.5 * min(len(own & _OF_PACK), 2) + 0.3 * min(len(around & _OF_PACK), 1)
    score -= 1.0 * len(own & _NOT) + 0.7 * len(around & _NOT - {"master"})
    reasons: list[Text] = [Message("infer-state-name", name=signal.name, message=message.name)]
    if signal.layout.length == 1:
        return (1,), 0, score + 1.0, reasons
    if signal.layout.length > _MOST_BITS and name != "fault":
        return None
    if name == "fault":  # a number or a set of flags: 0 is none
        return (), (1 << signal.layout.length) - 1, score, [*reasons, Message("infer-state-any-bit")]
    if received is None or signal.choices:
        return None
    seen = np.unique(received.raw)
    if len(seen) <= 2 and set(seen.tolist()) <= {0, 1}:
        return (1,), 0, score + 0.5, reasons
    heavy = None if flow is None else flow.during(received)
    if name != "closed" or heavy is None or not heavy.any() or len(seen) > _FEW:
        return None
    during = np.unique(received.raw[heavy])
    if len(during) > 2 or 0 in during or len(during) == len(seen):
        return None
    return tuple(int(number) for number in during), 0, score, reasons


def _score_of_name(name: str, own: frozenset[str], around: frozenset[str]) -> float | None:
    pre = bool(own & (_PRECHARGE - {"pc"})) or {"pc", "relay"} <= own
    ended = own & (_ENDED | {"open"})
    if name == "precharge":
        return 2.0 if pre and not ended and not own & (_FAULT | {"voltage", "v", "current", "charger"}) else None
    if name == "fault":
        if not own & _FAULT or own & {"under", "over", "temp", "temperature", "voltage", "current", "code", "cell"}:
            return None
        return 2.0 if (own | around) & _OF_PACK else 0.5
    if pre:
        return None
    if name == "closed":
        if not own & _CONTACTOR or ended or own & _FAULT:
            return None
        score = 2.0 - (0.3 if own & _SIDE or "airn" in own else 0.0)
        return score + (0.3 if own & {"closed", "state", "status", "feedback", "fb", "aux", "is"} else 0.0)
    if name == "charging":
        is_it = bool(own & (_CHARGING - {"charge", "chg"})) or ("charge" in own and bool(own & (_STATE | {"en"})))
        is_it = is_it or ("charger" in own and bool(own & {"present", "connected", "active"}))
        return (
            2.0
            if is_it and not own & (ended | _FAULT | name_set("soc limit max min voltage current allowed dis"))
            else None
        )
    return (
        2.0 if own & _BALANCING and not own & (ended | _FAULT | name_set("cell cells rate allowed voltage v")) else None
    )
