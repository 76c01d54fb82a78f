"""The causes of what went wrong in a session, from its file alone: an old session gains what is new in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from app.analysis.incidents import AFTER_S, Trigger, incidents, main_trigger
from app.analysis.root_cause.air import pack_suspicions
from app.analysis.root_cause.boards import board_suspicions
from app.analysis.root_cause.cause import Cause, cause_of
from app.analysis.root_cause.cells import cell_suspicions
from app.analysis.root_cause.charging import charger_suspicions
from app.analysis.root_cause.current import current_suspicions
from app.analysis.root_cause.judge import Judgement, judge, trip_kind
from app.analysis.root_cause.links import link_suspicions
from app.analysis.root_cause.reading import read_events, read_recording
from app.analysis.root_cause.recording import Recording, Suspicion
from app.analysis.root_cause.relays import relay_suspicions
from app.analysis.session_cell import cell_of
from app.estimation.cell_model.circuit import CellModel
from app.sessions.reading.reader import SessionFile

BACK_S = 900.0  # that much before an instant is looked at
SETTLED_S = AFTER_S  # and that much after it: what recovers when the current stops
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
    return [
        *link_suspicions(recording),
        *board_suspicions(recording),
        *charger_suspicions(recording),
        *relay_suspicions(recording),
        *current_suspicions(recording, model),
        *pack_suspicions(recording, model),
        *cell_suspicions(recording, model, at_s),
    ]
