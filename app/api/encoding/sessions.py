"""Sessions, and what is in them, as the API sends them."""

from pathlib import Path
from typing import Any

from app.sessions.errors import NotASession, Unreadable
from app.sessions.info import Marker, SessionInfo
from app.sources.data_file import encodable
from app.words import rendered, rendered_as_stored


def session_json(info: SessionInfo, recording_id: str | None) -> dict[str, Any]:
    """One session."""
    return {
        "id": info.id,
        "name": info.name,
        "started": info.started_wall_ns / 1e9,
        "ended": None if info.id == recording_id or info.ended_wall_ns is None else info.ended_wall_ns / 1e9,
        "duration_s": info.duration_s,
        "frames": info.frames,
        "can_frames": info.can_frames,
        "bytes": info.size_bytes,
        "recording": info.id == recording_id,
        "closed": info.is_closed,
        "event_count": info.events,
        "marker_count": info.markers,
        "version": info.voltwall,
        "metadata": dict(info.metadata),
    }


def unreadable_json(problem: Unreadable) -> dict[str, Any]:
    """A file among the sessions that cannot be read."""
    reason = problem.reason if isinstance(problem, NotASession) else problem.message
    return {"file": encodable(Path(problem.path).name), "reason": rendered(reason)}


def marker_json(marker: Marker) -> dict[str, Any]:
    """One marker."""
    return {
        "id": marker.id,
        "time": marker.t_wall_ns / 1e9,
        "kind": marker.kind,
        "text": marker.text,
        "who": marker.who,
    }


_OTHERWISE = ("t_mono_ns", "t_wall_ns", "limit_value", "text", "message")  # sent by another name


def event_json(event: dict[str, Any]) -> dict[str, Any]:
    """One event, out of the columns of its table."""
    body = {name: value for name, value in event.items() if name not in _OTHERWISE}
    message = rendered_as_stored(event["text"], event.get("message"))
    return body | {"time": event["t_wall_ns"] / 1e9, "limit": event.get("limit_value"), "message": message}
