"""What the car does, by the master's flags, and why."""

from app.sources.master.events import charger_state
from app.telemetry import Flags, MasterState
from app.words import Message


def state_of(flags: Flags | None, charging: str | None, last_trip: Message | None) -> tuple[MasterState, Message]:
    """Return what the car does, and why."""
    if flags is None:
        return "unknown", Message("no-status")
    if not flags.fit:
        return "fault", last_trip or Message("shutdown-circuit-open")
    if flags.charging:
        return "charge", Message("charger", state=charger_state(charging))
    if flags.balancing:
        return "balance", Message("cells-bled")
    if flags.load is None:
        return "unknown", Message("relays-unknown")
    if flags.load:
        return "drive", Message("relays-closed")
    return "idle", Message("charger-connected") if flags.charger else Message("relays-open")
