"""Encodes each snapshot once, however many read it."""

from app.api.encoding.snapshot import snapshot_json
from app.service.state import ServiceStateReader
from app.telemetry import Snapshot


class SnapshotEncoder:
    """Used on the event loop alone."""

    def __init__(self, state: ServiceStateReader) -> None:
        self._state = state
        self._snapshot: Snapshot | None = None
        self._body = b""

    def encode(self, snapshot: Snapshot) -> bytes:
        """Return the snapshot as JSON."""
        if snapshot is not self._snapshot:
            self._snapshot, self._body = snapshot, snapshot_json(snapshot, self._state.now())
        return self._body
