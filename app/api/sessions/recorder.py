"""The recorder: how it does, what the next sessions are called."""

from dataclasses import asdict, replace
from typing import Any

from fastapi import APIRouter
from pydantic import Field

from app.api.schemas.sessions import RecorderOut
from app.api.web.dependencies import EventsPart, RecorderPart, SettingsPart, UserDep
from app.api.web.request_body import Body
from app.sessions.recording.session_names import MAX_CHARACTERS
from app.words import Message, rendered_or_none

router = APIRouter(tags=["sessions"])


class PlanIn(Body):
    """Only what is named changes."""

    event: str | None = Field(None, max_length=MAX_CHARACTERS)
    driver: str | None = Field(None, max_length=MAX_CHARACTERS)
    vehicle: str | None = Field(None, max_length=MAX_CHARACTERS)
    venue: str | None = Field(None, max_length=MAX_CHARACTERS)


def _recorder_json(recorder: RecorderPart, settings: SettingsPart) -> dict[str, Any]:
    status, settings = recorder.status, settings
    return {
        "state": status.state,
        "session_id": None if status.session is None else status.session.id,
        "queued_items": status.queued_items,
        "lost_items": status.lost_items,
        "commit_delay_s": None if status.commit_delay_s is None else round(status.commit_delay_s, 3),
        "disk_free_bytes": status.disk_free_bytes,
        "stalled_since": None if status.stalled_ns is None else status.stalled_ns / 1e9,
        "warning": rendered_or_none(status.warning),
        "error": rendered_or_none(status.error),
        "plan": asdict(recorder.plan),
        "split_mb": settings.split_mb,
        "keep_days": settings.keep_days,
        "keep_gb": settings.keep_gb,
    }


@router.get("/recorder", response_model=RecorderOut)
def recorder(recorder: RecorderPart, settings: SettingsPart) -> dict[str, Any]:
    """The recorder's state, its trouble with the disk, and what the next sessions are called."""
    return _recorder_json(recorder, settings)


@router.put("/recorder", response_model=RecorderOut)
def plan(
    body: PlanIn, events: EventsPart, recorder: RecorderPart, settings: SettingsPart, user: UserDep
) -> dict[str, Any]:
    """Say what the next sessions are called and who drives; kept over restarts."""
    given = {name: text.strip() for name, text in body.model_dump(exclude_none=True).items()}
    recorder.set_plan(replace(recorder.plan, **given))
    shown = tuple(f"{name}: {text}" for name, text in given.items())
    events.note("info", "recording-plan", Message("list", shown=shown), user.name)
    return _recorder_json(recorder, settings)
