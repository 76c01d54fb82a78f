"""A snapshot as JSON, the same for REST and websocket, encoded once however many read it."""

from app.clock import Clock
from app.service.state import ServiceStateReader
from app.telemetry import Snapshot
from app.telemetry.encoding import aged, encode, plain
from app.telemetry.service_state import ServiceState

GOOD_FOR_NS = 50_000_000  # after that the ages are counted anew


def snapshot_json(snapshot: Snapshot, service: ServiceState) -> bytes:
    """Encode a snapshot together with what is the service's."""
    return encode(plain(snapshot, snapshot.segments) | plain(service))


class SnapshotEncoder:
    """Encodes snapshots with their ages at that moment; used on the event loop alone."""

    def __init__(self, state: ServiceStateReader, clock: Clock) -> None:
        self._state = state
        self._clock = clock
        self._encoded_ns = 0
        self._snapshot: Snapshot | None = None
        self._body = b""

    def encode(self, snapshot: Snapshot) -> bytes:
        """Return the snapshot as JSON."""
        now_ns = self._clock.monotonic_ns()
        if snapshot is not self._snapshot or now_ns - self._encoded_ns > GOOD_FOR_NS:
            self._snapshot, self._encoded_ns = snapshot, now_ns
            self._body = snapshot_json(aged(snapshot, now_ns), self._state.at(now_ns))
        return self._body
