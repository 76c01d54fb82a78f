"""The event log, the signed log and the alarms."""

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Path, Query

from app.api.schemas.service import AcknowledgedOut, EventsOut, SignedLogOut
from app.api.web.dependencies import AuthenticationPart, ConfigHistoryPart, EventsPart, LivePart, UserDep
from app.api.web.paging import CursorQuery, page_of, place_of
from app.api.web.problems import not_found
from app.battery.fields import MOST_CELLS
from app.configuration.history import ABOUT_PEOPLE
from app.sessions.event_log import LoggedEvent
from app.words import Message, rendered_as_stored

router = APIRouter(tags=["events"])
MAX_ID = (1 << 63) - 1
Id = Annotated[int, Path(ge=0, le=MAX_ID)]


def _event_json(event: LoggedEvent) -> dict[str, Any]:
    return {
        "id": event.id,
        "time": event.t_wall_ns / 1e9,
        "uptime_s": None if event.uptime_ms is None else event.uptime_ms / 1000,
        "severity": event.severity,
        "code": event.code,
        "message": rendered_as_stored(event.text, event.message),
        "cell": event.cell,
        "value": event.value,
        "limit": event.limit,
        "unit": event.unit,
        "who": event.who,
        "acknowledged_by": event.acknowledged_by,
    }


@router.get("/events", response_model=EventsOut)
def events(
    events: EventsPart,
    after: Annotated[int, Query(ge=0, le=MAX_ID)] = 0,
    limit: Annotated[int, Query(ge=1, le=5000)] = 200,
    severity: Literal["info", "watch", "warning", "trip"] | None = None,
    cell: Annotated[int | None, Query(ge=0, le=MOST_CELLS - 1)] = None,
    cursor: CursorQuery = None,
) -> dict[str, Any]:
    """The event log, newest first; `after`: only those with a larger id."""
    up_to = None if cursor is None else place_of(cursor)[0] - 1
    page = events.store.query(after, limit + 1, severity, cell, up_to)
    shown, following = page_of(page, lambda event: (event.id, ""), limit, cursor)
    return {"events": [_event_json(event) for event in shown], "next_cursor": following}


@router.get("/signed-log", response_model=SignedLogOut)
def signed_log(
    config_history: ConfigHistoryPart,
    authentication: AuthenticationPart,
    user: UserDep,
    limit: Annotated[int, Query(ge=1, le=1000)] = 50,
    cursor: CursorQuery = None,
) -> dict[str, Any]:
    """Return changes of car and users, newest first; log-ins and accounts are for those who manage them.

    `genuine` is false where a signature is not right, `all_genuine` where one of all records is not.
    """
    records = config_history.records()
    manages = user.role == "chief" or (user.role == "engineer" and not authentication.accounts.has_chief)
    visible = [record for record in reversed(records) if manages or record.action not in ABOUT_PEOPLE]
    shown, following = page_of(visible, lambda record: (record.number, ""), limit, cursor)
    return {
        "records": [
            {
                "number": record.number,
                "time": record.t_wall_ns / 1e9,
                "who": record.who,
                "action": record.action,
                "what": record.source,
                "reason": record.reason,
                "result": record.result,
                "genuine": record.is_genuine,
            }
            for record in shown
        ],
        "all_genuine": all(record.is_genuine for record in records),
        "next_cursor": following,
    }


@router.post("/events/{event_id}/acknowledge", response_model=AcknowledgedOut)
def acknowledge_event(event_id: Id, events: EventsPart, user: UserDep) -> dict[str, Any]:
    """Say that somebody saw it."""
    if not events.store.acknowledge(event_id, user.name):
        raise not_found("event", event_id)
    return {"acknowledged_by": user.name}


@router.post("/alarms/{alarm_id}/acknowledge", response_model=AcknowledgedOut)
def acknowledge_alarm(alarm_id: Id, live: LivePart, events: EventsPart, user: UserDep) -> dict[str, Any]:
    """Say that somebody saw it; it leaves the list when its condition has ended."""
    if not live.acknowledge_alarm(alarm_id, user.name):
        raise not_found("alarm", alarm_id)
    events.note("info", "alarm-acknowledged", Message("alarm-acknowledged", alarm=alarm_id), user.name)
    return {"acknowledged_by": user.name}
