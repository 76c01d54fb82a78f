"""An ordinary BMS's relays: closed only while it is ok, the vehicle pre-charged first."""

from simulator.bms_state import RelayState

PRECHARGED = 0.95  # of the accumulator's voltage, before the second relay closes (FS rules EV 5.7.1)
PRECHARGE_LIMIT_S = 3.0  # ten time constants: what is not charged by then never will be


class Relays:
    """Closed only while the OK signal is on; the vehicle is pre-charged first.

    A pre-charge that does not reach its voltage in time opens again, and is tried again only when the driver asks anew
    or faults are cleared: each try heats the resistor.
    """

    def __init__(self) -> None:
        self.state = RelayState.OPEN
        self.has_precharge_failed = False
        self.since_s = 0.0  # in this state

    def step(
        self, now_s: float, *, is_ok: bool, drive_requested: bool, charging: bool, link_share: float
    ) -> RelayState:
        """Advance one pass and return the state; `link_share` is the link's voltage over the accumulator's."""
        if not drive_requested:
            self.has_precharge_failed = False
        if is_ok and charging:
            self._go(RelayState.CHARGER, now_s)
        elif not is_ok or not drive_requested or self.has_precharge_failed:
            self._go(RelayState.OPEN, now_s)
        elif self.state in (RelayState.OPEN, RelayState.CHARGER):
            self._go(RelayState.PRECHARGE, now_s)
        elif self.state is RelayState.PRECHARGE:
            if link_share >= PRECHARGED:
                self._go(RelayState.VEHICLE, now_s)
            elif now_s - self.since_s >= PRECHARGE_LIMIT_S:
                self.has_precharge_failed = True
                self._go(RelayState.OPEN, now_s)
        return self.state

    def retry(self) -> None:
        """Allow another try after a failed pre-charge."""
        self.has_precharge_failed = False

    def _go(self, state: RelayState, now_s: float) -> None:
        if state is not self.state:
            self.state = state
            self.since_s = now_s
