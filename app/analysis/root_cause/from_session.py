"""The causes of what went wrong in a session, from its file alone: an old session gains what is new in it."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from app.analysis.incidents import AFTER_S, Trigger, incidents, is_trigger, main_trigger, trigger_of_event
from app.analysis.root_cause.air import pack_hypotheses
from app.analysis.root_cause.judge import UNEXPLAINED, Cause, Judgement, cause_of, judge, trip_kind
from app.analysis.root_cause.kept_verdict import keep_verdict, kept_verdicts
from app.analysis.root_cause.links import board_hypotheses, charger_hypotheses, link_hypotheses
from app.analysis.root_cause.read_stretch import read_stretch
from app.analysis.root_cause.recording import Hypothesis, SessionStretch
from app.analysis.root_cause.relays import current_hypotheses, relay_hypotheses
from app.analysis.session_cell import cell_of
from app.estimation.cell_model.circuit import CellModel
from app.estimation.health.cell_finding import CellFinding
from app.estimation.health.stretch_judge import judge_stretch
from app.sessions.errors import SessionError
from app.sessions.reading.reader import SessionFile
from app.words import Cell, Message, Quantity

log = logging.getLogger(__name__)
BACK_S = 900.0  # that much before an instant is looked at
SETTLED_S = AFTER_S + 0.2  # and that much after it: what recovers when the current stops; then a black box is made
LATER_S = 60.0  # after a black box without a cause: then it is looked for again
SHORT_S = 1.0  # a verdict that lacks no more is not revised
RECENT_S, LEAST_S = 300.0, 20.0  # what is looked at of a recording that goes on, and how much there has to be
LOAD_A = 10.0  # shows joints, resistances and noise
OF_CHARGE, SURE_OF_CHARGE = ("capacity-low", "cell-imbalance", "self-discharge-high"), 40.0  # log odds
FINDING, FINDING_ENDED = "finding-", "finding-ended"  # codes of events
FOUND_LIVE = 5.0  # log odds: the verdict over the stretch, where there is one, weighs more
FOUND_WITHIN_S = 6.0  # it takes the judge so long to be sure
MOST_TRIPS = 12  # trips of a session; more are repetitions


def causes_of(session: SessionFile, cell: CellModel | None = None) -> list[Cause]:
    """Return the verdict on each trip of a session, in order, then what is wrong without having tripped anything."""
    model, info = cell or cell_of(session)[0], session.info
    start_s = info.started_wall_ns / 1e9
    end_s = start_s + info.duration_s
    groups = [group for group in incidents_of(session) if _is_trip(_explained(group))][:MOST_TRIPS]
    causes = [cause for group in groups if (cause := verdict_of(session, group, model)) is not None]
    explained = {(cause.code, cause.cell, cause.pack) for cause in causes if cause.code != UNEXPLAINED}
    first_s = session.unix_s(round(_explained(groups[0]).mono_s * 1e9)) if groups else end_s
    for from_s, to_s in ((start_s, first_s),) if groups else pairwise(_edges(start_s, end_s)):
        rest = _judged(session, model, None, max(from_s, to_s - BACK_S), to_s)
        new = [judgement for judgement in rest if judgement.ranked and not _is_known(judgement, explained)]
        explained |= _places(new)
        causes += [cause_of(judgement, session.battery.segments, to_s) for judgement in new]
    return causes


def causes_without_trip(path: Path) -> list[Cause] | None:
    """Return what is wrong in the last minutes of a recording without having tripped anything; it may still go on.

    None: too little was recorded since its start, or since its last trip, which has a verdict of its own; or nothing
    was found and no current flowed, which says nothing against what needs one to be seen.
    """
    with SessionFile(path) as session:
        end_s = _end_s(session)
        from_s = end_s - RECENT_S
        for group in incidents_of(session):
            if _is_trip(_explained(group)):
                from_s = max(from_s, session.unix_s(round(group[-1].mono_s * 1e9)) + SETTLED_S)
        if end_s - max(from_s, session.info.started_wall_ns / 1e9) < LEAST_S:
            return None
        judged = _judged(session, cell_of(session)[0], None, from_s, end_s)
        sure = [judgement for judgement in judged if judgement.ranked and not _is_small_charge(judgement)]
        if not sure and not _has_load(session, from_s, end_s):
            return None
        return [cause_of(judgement, session.battery.segments, end_s) for judgement in sure]


def _has_load(session: SessionFile, from_s: float, to_s: float) -> bool:
    currents = [piece["i_fs"].values for piece in session.fields(("i_fs",), from_s, to_s) if "i_fs" in piece]
    return any(bool((np.abs(values) >= LOAD_A).any()) for values in currents)


def _is_small_charge(judgement: Judgement) -> bool:
    """Minutes show so small a difference of charge by chance: the watch of the cells waits for more."""
    first = judgement.ranked[0]
    return first.code in OF_CHARGE and first.weight < SURE_OF_CHARGE


def incidents_of(session: SessionFile) -> list[list[Trigger]]:
    """Return what deserves a black box in a session, in groups: see `incidents`."""
    return incidents(
        [
            trigger_of_event(event, event["t_wall_ns"] / 1e9, event["t_mono_ns"] / 1e9)
            for event in session.events()
            if is_trigger(event["severity"], event["code"])
        ]
    )


def verdict_of(session: SessionFile, group: Sequence[Trigger], cell: CellModel | None = None) -> Cause | None:
    """Return the verdict on an incident: the one that is kept with the session, made now where there is none.

    One that was made before the seconds after the incident were recorded is revised, one that explains nothing by what
    came later. None: nothing to be explained.
    """
    kept = kept_verdicts(session, group)
    verdict, end_s = kept[-1] if kept else None, _end_s(session)
    for k, to_s in enumerate(_stretch_ends_s(session, group)):
        if verdict is not None and (verdict.judged is None or verdict.judged >= min(to_s, end_s) - SHORT_S):
            continue
        if k and verdict is not None and verdict.code != UNEXPLAINED:
            break
        made = _verdict(session, group, cell, to_s)
        if made is None:
            return None
        if verdict is None:
            verdict = made
        elif k == 0 or made.code != UNEXPLAINED:
            verdict = replace(made, revised=True)
    return verdict


def make_verdict(session: SessionFile, group: Sequence[Trigger], cell: CellModel, t_wall_ns: int) -> Cause | None:
    """Return the verdict on an incident, and keep it with the session; None: nothing to be explained."""
    before, verdict = kept_verdicts(session, group), verdict_of(session, group, cell)
    if verdict is not None and verdict not in before:
        try:
            keep_verdict(session.path, group, verdict, before, t_wall_ns=t_wall_ns)
        except SessionError as error:
            log.warning("the verdict on a trip was not written: %s", error)
    return verdict


def cause_at(session: SessionFile, at_s: float) -> Cause | None:
    """Return the verdict on the last trip that was recorded before a unix time; None where there was none."""
    groups = [group for group in incidents_of(session) if _is_trip(_explained(group))]
    begun = [group for group in groups if session.unix_s(round(_explained(group).mono_s * 1e9)) <= at_s + SETTLED_S]
    return verdict_of(session, begun[-1]) if begun else None


def _verdict(session: SessionFile, group: Sequence[Trigger], cell: CellModel | None, to_s: float) -> Cause | None:
    trigger = _explained(group)
    trip = replace(trigger, at_s=session.unix_s(round(trigger.mono_s * 1e9)))
    if trip.severity == "trip" and not _is_trip(trip):
        return None
    asked = trip if _is_trip(trip) else None
    judgements = _judged(session, cell or cell_of(session)[0], asked, trip.at_s - BACK_S, to_s)
    about = [
        judgement for judgement in judgements if asked is not None or trip.cell in (None, judgement.ranked[0].cell)
    ]
    return cause_of(about[0], session.battery.segments, min(to_s, _end_s(session))) if about else None


def _judged(
    session: SessionFile,
    model: CellModel,
    trip: Trigger | None,
    from_s: float,
    to_s: float,
) -> list[Judgement]:
    recording = read_stretch(session, from_s, to_s)
    if trip is None:
        return judge([], _hypotheses(recording, model, recording.end_s), recording.segments)
    return judge([trip], _hypotheses(recording, model, trip.at_s), recording.segments)


def _stretch_ends_s(session: SessionFile, group: Sequence[Trigger]) -> list[float]:
    """Up to when an incident is looked at, in order: for its black box, and later while nothing explains it."""
    end_s = _end_s(session)
    due_s = session.unix_s(round(group[-1].mono_s * 1e9)) + SETTLED_S
    cell = _explained(group).cell
    ends_s = [
        session.unix_s(event["t_mono_ns"])
        for event in session.events()
        if is_later_evidence(event["code"], event["cell"], cell)
    ]
    later = sorted(time_s for time_s in (due_s + LATER_S, *ends_s) if due_s < time_s <= end_s)
    return [due_s, *later]


def is_later_evidence(code: str, cell: int | None, tripped: int | None) -> bool:
    """An event may explain a trip that nothing explained: what was found of the cell that tripped."""
    return code.startswith(FINDING) and code != FINDING_ENDED and cell is not None and cell == tripped


def _end_s(session: SessionFile) -> float:
    return session.info.started_wall_ns / 1e9 + session.info.duration_s


def _explained(group: Sequence[Trigger]) -> Trigger:
    """What of an incident is explained: its trip, the master's own where there is one, else the warning."""
    trips = [trigger for trigger in group if _is_trip(trigger)]
    return next((trip for trip in trips if trip.code.startswith("trip-")), main_trigger(trips or group))


def _is_trip(event: Trigger) -> bool:
    """A trip that is of its own; what only says that the circuit is open is none."""
    return event.severity == "trip" and trip_kind(event.code) is not None


def _places(judgements: Sequence[Judgement]) -> set[tuple[str, int | None, int | None]]:
    return {(judgement.ranked[0].code, *judgement.ranked[0].place) for judgement in judgements if judgement.ranked}


def _is_known(judgement: Judgement, explained: set[tuple[str, int | None, int | None]]) -> bool:
    """Its cell has a cause already, or this cause was found in another part of the session."""
    key = (judgement.ranked[0].code, *judgement.ranked[0].place)
    return key in explained or (key[1] is not None and key[1] in {cell for _, cell, _ in explained})


def _edges(start_s: float, end_s: float) -> list[float]:
    """The session in parts of about BACK_S."""
    n = max(round((end_s - start_s) / BACK_S), 1)
    return [start_s + k * (end_s - start_s) / n for k in range(n)] + [end_s + 1.0]


def _hypotheses(recording: SessionStretch, model: CellModel, at_s: float) -> list[Hypothesis]:
    """Return everything that may be wrong; `at_s` is the instant that is asked about, unix time."""
    reported = [event.cell for event in recording.events if event.cell is not None]
    return [
        *link_hypotheses(recording),
        *board_hypotheses(recording),
        *charger_hypotheses(recording),
        *relay_hypotheses(recording),
        *current_hypotheses(recording, model),
        *pack_hypotheses(recording, model),
        *(_of_cell(finding) for finding in judge_stretch(recording, model, at_s, reported)),
        *found_live(recording),
    ]


def found_live(recording: SessionStretch) -> Iterator[Hypothesis]:
    """Return the hypotheses that the live judge reported while recording and that no later evidence ended."""
    triggers: dict[int, Trigger] = {}
    for event in recording.events:
        if event.cell is None or not event.code.startswith(FINDING):
            continue
        if event.code == FINDING_ENDED:
            triggers.pop(event.cell, None)
        else:
            triggers[event.cell] = event
    for cell, event in triggers.items():
        evidence = () if isinstance(event.message, str) else (event.message,)
        code, since_s = event.code.removeprefix(FINDING), event.at_s - FOUND_WITHIN_S
        yield Hypothesis(code, since_s, FOUND_LIVE, evidence, cell, size=event.value, unit=event.unit)


def _of_cell(finding: CellFinding) -> Hypothesis:
    """A verdict on a cell, to be weighed against everything else that may explain a trip."""
    evidence = () if finding.code == "external-heating" else (_seen(finding),)
    if np.isfinite(finding.warmer_k):
        warmer, heat = Quantity(finding.warmer_k, "K", 0), Quantity(finding.heat_w, "W", 0)
        evidence = (*evidence, Message("seen-warmer", cell=Cell(finding.cell), warmer=warmer, heat=heat))
    cause = Hypothesis(finding.code, finding.since_s, finding.log_odds, evidence, finding.cell)
    if not np.isfinite(finding.sigma):
        return cause
    return replace(cause, size=finding.size, sigma=finding.sigma, unit=finding.unit)


def _seen(finding: CellFinding) -> Message:
    cell, size = Cell(finding.cell), finding.size
    match finding.code:
        case "joint-resistance-high":
            return Message("seen-joint", cell=cell, size=Quantity(1000 * size, "mohm", 2))
        case "cell-resistance-high":
            return Message("seen-resistance", cell=cell, size=Quantity(1000 * size, "mohm", 2))
        case "capacity-low":
            return Message("seen-capacity", cell=cell, size=Quantity(100 * (1.0 - size), "%", 0))
        case "cell-imbalance":
            return Message("seen-lower", cell=cell, size=Quantity(100 * size, "%", 1))
        case "self-discharge-high":
            return Message("seen-leak", cell=cell, size=Quantity(size, "A", 1))
        case "cell-voltage-noisy":
            return Message("seen-noise", cell=cell, size=Quantity(1000 * size, "mV", 0))
        case "sense-wire-open":
            cells = finding.neighbours
            return Message("seen-no-voltage", n=len(cells), cells=tuple(Cell(cell) for cell in cells))
        case "temperature-sensor-open":
            return Message("seen-no-temperature", cell=cell)
        case "temperature-sensor-fault":
            before, after = Quantity(finding.usual, "degC", 0), Quantity(finding.value, "degC", 0)
            return Message("seen-temperature-jump", cell=cell, before=before, after=after)
    return Message("seen-stuck", cell=cell, size=Quantity(size, "V", 3))
