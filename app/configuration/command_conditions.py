"""Conditions of commands in the car's present state, as the master's firmware decides them."""

from app.telemetry import Snapshot
from app.telemetry.measurement import BLANK_S
from app.words import Message

BALANCING = ("balance-start", "balance-cells")
STARTS = ("charge-start", *BALANCING)  # need a state that is known
REST_A = 2.0  # beyond, the master takes no voltage for that at rest
_ENDED = ("off", "done", "fault")  # charging states without charging


def block_reasons(snapshot: Snapshot | None) -> dict[str, Message]:
    """Return why the master would refuse a command now; what is not named may work.

    A command that ends something is only named where it is known that there is nothing to end.
    """
    age_s = None if snapshot is None else snapshot.age_s.status
    if snapshot is None or age_s is None or age_s >= BLANK_S:
        return dict.fromkeys((*STARTS, "soc-from-ocv"), Message("blocked-silent"))
    reasons: dict[str, Message] = {}
    state, charging, current_a = snapshot.master.state, snapshot.charger.state, snapshot.accumulator.current_a
    if snapshot.master.fit is False:
        reasons |= dict.fromkeys(STARTS, Message("blocked-fault"))
    elif state == "drive":
        reasons |= dict.fromkeys((*STARTS, "reset"), Message("blocked-driving"))
    elif state == "charge":
        reasons |= dict.fromkeys(STARTS, Message("blocked-charging"))
    if state != "charge" and charging in _ENDED:
        reasons["charge-stop"] = Message("blocked-not-charging")
    if current_a is not None and abs(current_a) >= REST_A:
        reasons["soc-from-ocv"] = Message("blocked-current")
    return reasons
