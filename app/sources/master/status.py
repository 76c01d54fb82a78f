"""What the car does, by the master's flags, and why."""

from app.telemetry import Flags, MasterState


def state_of(flags: Flags | None, charger_state: str | None, last_trip: str | None) -> tuple[MasterState, str]:
    """Return what the car does, and why."""
    if flags is None:
        return "unknown", "no status from the master"
    if not flags.fit:
        return "fault", last_trip or "the master holds the shutdown circuit open"
    if flags.charging:
        return "charge", f"charger: {(charger_state or 'state unknown').replace('_', ' ')}"
    if flags.balancing:
        return "balance", "cells are bled to the lowest"
    if flags.load is None:
        return "unknown", "nothing heard of the relays"
    if flags.load:
        return "drive", "relays closed"
    return "idle", "charger connected, not charging" if flags.charger else "relays open"
