"""The causes of what went wrong in a session, from its file alone: an old session gains what is new in it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from app.analysis.incidents import AFTER_S, Trigger, incidents, main_trigger
from app.analysis.root_cause.air import pack_suspicions
from app.analysis.root_cause.cause import Cause, cause_of
from app.analysis.root_cause.judge import Judgement, judge, trip_kind
from app.analysis.root_cause.links import board_suspicions, charger_suspicions, link_suspicions
from app.analysis.root_cause.recording import Recording, Suspicion, read_events, read_recording
from app.analysis.root_cause.relays import current_suspicions, relay_suspicions
from app.analysis.session_cell import cell_of
from app.estimation.cell_model.circuit import CellModel
from app.estimation.health.cell_finding import CellFinding
from app.estimation.health.stretch_judge import judge_stretch
from app.sessions.reading.reader import SessionFile
from app.words import Cell, Message, Quantity

BACK_S = 900.0  # that much before an instant is looked at
SETTLED_S = AFTER_S  # and that much after it: what recovers when the current stops
FINDING, FINDING_ENDED = "finding-", "finding-ended"  # codes of events
FOUND_LIVE = 5.0  # log odds: the verdict over the stretch, where there is one, weighs more
FOUND_WITHIN_S = 6.0  # it takes the judge so long to be sure
MOST_TRIPS = 12  # of a session; more are the same again


def causes_of(session: SessionFile, cell: CellModel | None = None) -> list[Cause]:
    """Return what explains each trip of a session, in order, then what is wrong without having tripped anything."""
    model, info = cell or cell_of(session)[0], session.info
    start_s = info.started_wall_ns / 1e9
    end_s = start_s + info.duration_s
    trips = _trips(read_events(session, start_s - 1.0, end_s + 1.0))[:MOST_TRIPS]
    found: list[Judgement] = []
    explained: set[tuple[str, int | None, int | None]] = set()
    for trip in trips:
        judgements = _judged(session, model, trip, trip.at_s - BACK_S, trip.at_s + SETTLED_S)
        found += judgements[:1]
        explained |= _places(judgements[:1])
    for from_s, to_s in pairwise(_edges(start_s, end_s)) if not trips else ((start_s, trips[0].at_s),):
        rest = _judged(session, model, None, max(from_s, to_s - BACK_S), to_s)
        new = [each for each in rest if each.ranked and not _is_known(each, explained)]
        explained |= _places(new)
        found += new
    return [cause_of(each, session.battery.segments) for each in found]


def cause_of_trip(session: SessionFile, trigger: Trigger, cell: CellModel | None = None) -> Cause | None:
    """Return what explains the trip or warning of a black box; None where it is nothing that has a cause here."""
    trip = replace(trigger, at_s=session.unix_s(round(trigger.mono_s * 1e9)))
    if trip_kind(trip.code) is None and trip.severity == "trip":
        return None
    is_trip = trip.severity == "trip"
    judgements = _judged(
        session, cell or cell_of(session)[0], trip if is_trip else None, trip.at_s - BACK_S, trip.at_s + SETTLED_S
    )
    about = [each for each in judgements if is_trip or trip.cell in (None, each.ranked[0].cell)]
    return cause_of(about[0], session.battery.segments) if about else None


def cause_at(session: SessionFile, at_s: float) -> Cause | None:
    """Return what explains the last trip that was recorded before a unix time; None where there was none."""
    start_s = session.info.started_wall_ns / 1e9
    trips = _trips(read_events(session, start_s - 1.0, at_s + SETTLED_S))
    if not trips:
        return None
    trip = trips[-1]
    judgements = _judged(session, cell_of(session)[0], trip, trip.at_s - BACK_S, trip.at_s + SETTLED_S)
    return cause_of(judgements[0], session.battery.segments) if judgements else None


def _judged(
    session: SessionFile, model: CellModel, trip: Trigger | None, from_s: float, to_s: float
) -> list[Judgement]:
    recording = read_recording(session, from_s, to_s)
    if trip is None:
        return judge([], _suspicions(recording, model, recording.end_s), recording.segments)
    return judge([trip], _suspicions(recording, model, trip.at_s), recording.segments)


def _trips(events: Sequence[Trigger]) -> list[Trigger]:
    """One trip an incident, the master's own where there is one; what only says that the circuit is open is none."""
    trips = [event for event in events if event.severity == "trip" and trip_kind(event.code) is not None]
    groups = incidents(trips)
    return [next((each for each in group if each.code.startswith("trip-")), main_trigger(group)) for group in groups]


def _places(judgements: Sequence[Judgement]) -> set[tuple[str, int | None, int | None]]:
    return {(each.ranked[0].code, *each.ranked[0].place) for each in judgements if each.ranked}


def _is_known(judgement: Judgement, explained: set[tuple[str, int | None, int | None]]) -> bool:
    """Its cell has a cause already, or this cause was told of another part of the session."""
    key = (judgement.ranked[0].code, *judgement.ranked[0].place)
    return key in explained or (key[1] is not None and key[1] in {cell for _, cell, _ in explained})


def _edges(start_s: float, end_s: float) -> list[float]:
    """The session in parts of about BACK_S."""
    n = max(round((end_s - start_s) / BACK_S), 1)
    return [start_s + k * (end_s - start_s) / n for k in range(n)] + [end_s + 1.0]


def _suspicions(recording: Recording, model: CellModel, at_s: float) -> list[Suspicion]:
    """Return everything that may be wrong; `at_s` is the instant that is asked about, unix time."""
    reported = [event.cell for event in recording.events if event.cell is not None]
    return [
        *link_suspicions(recording),
        *board_suspicions(recording),
        *charger_suspicions(recording),
        *relay_suspicions(recording),
        *current_suspicions(recording, model),
        *pack_suspicions(recording, model),
        *(_of_cell(each) for each in judge_stretch(recording, model, at_s, reported)),
        *found_live(recording),
    ]


def found_live(recording: Recording) -> Iterator[Suspicion]:
    """What the judge had found of cells while the session was recorded, by its events, and evidence has not ended."""
    found: dict[int, Trigger] = {}
    for event in recording.events:
        if event.cell is None or not event.code.startswith(FINDING):
            continue
        if event.code == FINDING_ENDED:
            found.pop(event.cell, None)
        else:
            found[event.cell] = event
    for cell, event in found.items():
        evidence = () if isinstance(event.message, str) else (event.message,)
        yield Suspicion(event.code.removeprefix(FINDING), event.at_s - FOUND_WITHIN_S, FOUND_LIVE, evidence, cell)


def _of_cell(found: CellFinding) -> Suspicion:
    """A verdict on a cell, to be weighed against everything else that may explain a trip."""
    evidence = () if found.code == "external-heating" else (_seen(found),)
    if np.isfinite(found.warmer_k):
        warmer, heat = Quantity(found.warmer_k, "K", 0), Quantity(found.heat_w, "W", 0)
        evidence = (*evidence, Message("seen-warmer", cell=Cell(found.cell), warmer=warmer, heat=heat))
    return Suspicion(found.code, found.since_s, found.log_odds, evidence, found.cell)


def _seen(found: CellFinding) -> Message:
    cell, size = Cell(found.cell), found.size
    match found.code:
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
            cells = found.neighbours
            return Message("seen-no-voltage", n=len(cells), cells=tuple(Cell(each) for each in cells))
        case "temperature-sensor-open":
            return Message("seen-no-temperature", cell=cell)
        case "temperature-sensor-fault":
            before, after = Quantity(found.usual, "degC", 0), Quantity(found.value, "degC", 0)
            return Message("seen-temperature-jump", cell=cell, before=before, after=after)
    return Message("seen-stuck", cell=cell, size=Quantity(size, "V", 3))
