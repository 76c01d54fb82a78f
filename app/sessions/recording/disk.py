"""The disk under a recorder: when to warn, when to stop, how long it lasts."""

import shutil
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from app.sessions.info import SessionInfo
from app.sessions.recording.session_writer import TableRow, event_row
from app.telemetry import Event
from app.words import Message, Quantity


@dataclass(frozen=True, slots=True)
class DiskLimits:
    """Limits of the disk: free space to warn at and to stop writing at, memory for what waits, size of a session."""

    warn_free_bytes: int = 1 << 30
    stop_free_bytes: int = 64 << 20  # the system and the closing of the file need some
    queue_bytes: int = 32 << 20  # then the oldest are left out: estimates, then frames
    session_bytes: int | None = None  # a session longer than this goes on in a new file


def free_bytes(folder: Path) -> int:
    """Return what is free on a folder's disk."""
    return shutil.disk_usage(folder).free


def time_left(session: SessionInfo, usable_bytes: int) -> Message:
    """Return how long the disk lasts at the rate of a session."""
    rate = session.size_bytes / max(session.duration_s, 60.0)  # a shorter time gives no rate
    minutes = max(0.0, usable_bytes) / max(rate, 1.0) / 60
    return Message("disk-for-days") if minutes > 2880 else Message("disk-full-in", time=Quantity(minutes, "min", 0))


def low_warning(session: SessionInfo, free: int | None, limits: DiskLimits) -> Message | None:
    """Return what to say where the disk will be full soon."""
    if free is None or free >= limits.warn_free_bytes:
        return None
    left = time_left(session, free - limits.stop_free_bytes)
    return Message("disk-low", free=Quantity(free >> 20, "MB"), left=left)


def up_to_now(session: SessionInfo, counts: Mapping[str, int], now_ns: int, size_bytes: int) -> SessionInfo:
    """Return a session that is being recorded with its length, size and number of rows by table."""
    return replace(
        session,
        size_bytes=size_bytes,
        ended_mono_ns=now_ns,
        frames=counts.get("frames", 0),
        can_frames=counts.get("can_frames", 0),
        events=counts.get("events", 0),
        markers=counts.get("markers", 0),
    )


def loss_event(t_mono_ns: int, t_wall_ns: int, lost: int) -> TableRow:
    """Return what is written down of items that the disk did not take in time."""
    event = Event(t_wall_ns, "warning", "recorder_lost", Message("items-lost", n=lost), value=lost)
    return event_row(t_mono_ns, event)
