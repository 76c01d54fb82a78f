"""The accumulator's relays: open, pre-charging, closed onto the vehicle or onto the charger."""

import enum

PRECHARGE_S = 1.0  # the link stands above 95 % after three time constants of 0.3 s


class RelayState(enum.Enum):
    """What the accumulator is connected to."""

    OPEN = "open"
    PRECHARGE = "precharge"
    VEHICLE = "vehicle"
    CHARGER = "charger"


class Relays:
    """Closed only while the OK signal stands; the vehicle is pre-charged first."""

    def __init__(self) -> None:
        self.state = RelayState.OPEN
        self._since_s = 0.0

    def step(self, now_s: float, *, is_ok: bool, drive_requested: bool, charging: bool) -> RelayState:
        """Advance one pass and return the state."""
        if not is_ok:
            self._go(RelayState.OPEN, now_s)
        elif charging:
            self._go(RelayState.CHARGER, now_s)
        elif not drive_requested:
            self._go(RelayState.OPEN, now_s)
        elif self.state in (RelayState.OPEN, RelayState.CHARGER):
            self._go(RelayState.PRECHARGE, now_s)
        elif self.state == RelayState.PRECHARGE and now_s - self._since_s >= PRECHARGE_S:
            self._go(RelayState.VEHICLE, now_s)
        return self.state

    def _go(self, state: RelayState, now_s: float) -> None:
        if state != self.state:
            self.state = state
            self._since_s = now_s
