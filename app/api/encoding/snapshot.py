"""A snapshot as JSON: one function, used by REST and by the websocket, so that both say the same."""

from app.telemetry import Snapshot
from app.telemetry.encoding import encode, plain
from app.telemetry.service_state import ServiceState


def snapshot_json(snapshot: Snapshot, service: ServiceState) -> bytes:
    """Encode a snapshot together with what is the service's."""
    return encode(plain(snapshot) | plain(service))
