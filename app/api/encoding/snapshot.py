"""A snapshot as JSON: one function, used by REST and by the websocket, so that both say the same."""

from typing import Any

from app.telemetry import Snapshot
from app.telemetry.encoding import encode, plain


def snapshot_json(snapshot: Snapshot, service: dict[str, Any]) -> bytes:
    """Encode a snapshot; `service` is merged in (recording, last_event_id, config_stored_hash, replay)."""
    return encode(plain(snapshot) | service)
