"""The master's charging: constant current, a pause in which the cells are balanced, constant voltage, done.

The charger holds a voltage of the whole string, the master knows the cells: in constant voltage it trims the current
once a second so that the highest cell, not the string, stands at `v_cell_chrg`.
"""

import enum

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.elcon import ChargerFlags
from firmware_protocol.memory_map import CELLS_PER_PACK, CHARGER_STATES, N_CELLS
from firmware_protocol.messages import BALANCE_BY_HAND_S, NO_OFFSET, EventCode, EventMessage
from simulator.memory import Config, MasterMemory

BoolArray = NDArray[np.bool_]

CONTROL_PERIOD_S = 1.0
DONE_CURRENT = 10  # 1 A [0.1 A]
DONE_PERSISTENCE_S = 20.0
SETTLE_S = 30.0  # of rest before balancing is judged, so that polarisation does not count as imbalance
RISE_PER_PERIOD = 3.0  # [0.1 A]
FALL_PER_PERIOD = 20.0
# of what is missing, that a period's change closes
RISE_SHARE = 0.18
FALL_SHARE = 0.45
CELL_SLOPE = 3.0  # 3 mohm, what a sound cell answers [100 uV per 0.1 A]
UNKNOWN_SLOPE = 30.0  # taken for it at first: a loose joint and all
UNKNOWN_DECAY = 0.9  # a period of it: where the cells are so full that no current flows, nothing is learned
SLOPE_CURRENT = 5  # 0.5 A, from which on the slope of a cell is known [0.1 A]
HEADROOM_COUNTS = 5  # held below the limit, for the time that a command takes to act [100 uV]
FULL_COUNTS = 15  # a cell this near what is held counts as having reached it [100 uV]
TRIP_MARGIN_COUNTS = 20  # 2 mV between the charge's end and the trip, whatever is configured
STRING_MARGIN = 40_000  # 4 V [100 uV]: cables and the charger's own error must not end the charge before the cells do
CABLE_MARGIN = 10_000  # 1 V of it, where no more is left below the sum of all trips [100 uV]
BALANCE_HYSTERESIS = 0.8  # of the threshold: a cell is bled until it is this near the lowest
_FATAL = ChargerFlags.HARDWARE | ChargerFlags.OVER_TEMPERATURE | ChargerFlags.INPUT_VOLTAGE | ChargerFlags.BATTERY


class ChargingState(enum.IntEnum):
    """The `charger.state` byte."""

    OFF = CHARGER_STATES.index("off")
    WAITING = CHARGER_STATES.index("waiting")
    CONSTANT_CURRENT = CHARGER_STATES.index("constant_current")
    BALANCING = CHARGER_STATES.index("balancing")
    CONSTANT_VOLTAGE = CHARGER_STATES.index("constant_voltage")
    DONE = CHARGER_STATES.index("done")
    FAULT = CHARGER_STATES.index("fault")


_ACTIVE = frozenset(
    {
        ChargingState.WAITING,
        ChargingState.CONSTANT_CURRENT,
        ChargingState.BALANCING,
        ChargingState.CONSTANT_VOLTAGE,
    }
)


class Balancer:
    """Chooses the cells to bleed: those further above the lowest than `balance_threshold`, until all are near it."""

    def __init__(self) -> None:
        self.cells: BoolArray = np.zeros(N_CELLS, dtype=bool)
        self.is_active = False
        self._by_hand_until_s: float | None = None

    @property
    def is_by_hand(self) -> bool:
        """The cells were chosen by hand."""
        return self._by_hand_until_s is not None

    def choose_by_hand(self, pack: int, mask: int, now_s: float) -> None:
        """Bleed these cells of a pack, and of the other packs what was chosen by hand before."""
        if not self.is_by_hand:
            self.stop()
        first = pack * CELLS_PER_PACK
        self.cells[first : first + CELLS_PER_PACK] = [bool(mask >> cell & 1) for cell in range(CELLS_PER_PACK)]
        self.is_active = bool(self.cells.any())
        self._by_hand_until_s = now_s + BALANCE_BY_HAND_S if self.is_active else None

    def watch_by_hand(self, config: Config, v: NDArray[np.uint16], now_s: float) -> None:
        """End what was chosen by hand: after its time, and cell by cell at the lowest voltage allowed."""
        if self._by_hand_until_s is None:
            return
        self.cells &= v > config.v_cell_min
        self.is_active = bool(self.cells.any())
        if now_s >= self._by_hand_until_s or not self.is_active:
            self.stop()

    def choose(self, config: Config, v: NDArray[np.uint16]) -> bool:
        """Update `cells` from voltages at rest [100 uV], 0 = missing; return whether any cell is bled."""
        known = v > 0
        lowest = int(v[known].min()) if known.any() else 0
        excess = v.astype(np.int32) - lowest
        start = excess > config.balance_threshold
        keep = self.cells & (excess > BALANCE_HYSTERESIS * config.balance_threshold)
        self.cells = (start | keep) & known
        self.is_active = bool(self.cells.any())
        return self.is_active

    def stop(self) -> None:
        """Stop bleeding."""
        self._by_hand_until_s = None
        if self.is_active:
            self.cells = np.zeros(N_CELLS, dtype=bool)
            self.is_active = False


class Charging:
    """The state machine; it writes the charger struct, which the CAN tables carry to the charger."""

    def __init__(self, memory: MasterMemory, balancer: Balancer) -> None:
        self._memory = memory
        self.balancer = balancer
        self.state = ChargingState.OFF
        self.is_active = False  # the charge relays are closed
        self._since_s = 0.0
        self._next_control_s = 0.0
        self._current = 0.0  # asked, [0.1 A]
        self._rest_v = np.zeros(N_CELLS)  # before the current rose [100 uV]
        self._slope, self._is_slope_known = UNKNOWN_SLOPE, False
        self._below_since_s: float | None = None
        self._write(0, 0, stop=True)

    def start(self, now_s: float) -> list[EventMessage]:
        """Start charging; a status message of the charger must arrive first."""
        if self.is_active:
            return []
        self._slope, self._is_slope_known = UNKNOWN_SLOPE, False
        return self._enter(ChargingState.WAITING, now_s)

    def stop(self, now_s: float, *, fault: bool = False) -> list[EventMessage]:
        """Stop charging, on request or because of a fault."""
        if self.state == ChargingState.OFF or (fault and not self.is_active):
            return []
        return self._enter(ChargingState.FAULT if fault else ChargingState.OFF, now_s)

    def step(self, config: Config, now_s: float, *, charger_alive: bool, v_max: int) -> list[EventMessage]:
        """Advance one pass."""
        if not self.is_active:
            return []
        if self.state != ChargingState.WAITING and (not charger_alive or self._memory.charger("flags") & _FATAL):
            return self.stop(now_s, fault=True)
        match self.state:
            case ChargingState.WAITING:
                if charger_alive and not self._memory.charger("flags") & _FATAL:
                    return self._enter(ChargingState.CONSTANT_CURRENT, now_s)
            case ChargingState.CONSTANT_CURRENT:
                if v_max >= self._reached(config):
                    return self._enter(ChargingState.BALANCING, now_s)
                self._control(config, now_s, v_max)
            case ChargingState.BALANCING:
                if now_s - self._since_s >= SETTLE_S and not self.balancer.choose(config, self._memory.v):
                    return self._enter(ChargingState.CONSTANT_VOLTAGE, now_s)
            case ChargingState.CONSTANT_VOLTAGE:
                return self._hold(config, now_s, v_max)
        return []

    def _hold(self, config: Config, now_s: float, v_max: int) -> list[EventMessage]:
        self._control(config, now_s, v_max)
        is_full = v_max >= self._reached(config) - FULL_COUNTS and self._memory.charger("i_out") < DONE_CURRENT
        if not is_full:
            self._below_since_s = None
        elif self._below_since_s is None:
            self._below_since_s = now_s
        elif now_s - self._below_since_s >= DONE_PERSISTENCE_S:
            return self._enter(ChargingState.DONE, now_s)
        return []

    def _held(self, config: Config) -> float:
        """Return the target of the highest cell [100 uV]: lower, the more one count of current lifts this cell.

        Both phases aim at it, so that a current which is trimmed on the way there ends constant current all the same.
        """
        return _top(config) - HEADROOM_COUNTS - 0.5 * (self._slope - CELL_SLOPE)

    def _reached(self, config: Config) -> float:
        """Return from where on the highest cell counts as held: one count more of current may not fit in between."""
        return self._held(config) - (self._slope - CELL_SLOPE)

    def _control(self, config: Config, now_s: float, v_max: int) -> None:
        """Trim the requested current: an integrator on the highest cell's distance to its target."""
        if now_s < self._next_control_s:
            return
        self._next_control_s = now_s + CONTROL_PERIOD_S
        self._learn_slope()
        missing = self._held(config) - v_max
        if missing < 0:
            change = missing * FALL_SHARE / self._slope
        else:
            change = missing * RISE_SHARE / self._slope if missing > self._slope else 0.0  # a count fits, or none
        self._current += min(max(change, -FALL_PER_PERIOD), RISE_PER_PERIOD)
        self._current = min(max(self._current, 0.0), config.i_chrg_max / 10)
        top = _top(config)
        string = min(N_CELLS * top + STRING_MARGIN, N_CELLS * config.v_cell_max + CABLE_MARGIN)
        self._write((string + 500) // 1000, int(self._current), stop=False)

    def _learn_slope(self) -> None:
        """Find how much the highest cell rises with the current, by what it has risen more than the mean cell.

        A loose joint inside the span of one cell makes it many times stiffer than the others.
        """
        current = self._memory.charger("i_out")
        if current < SLOPE_CURRENT and self._is_slope_known:
            return
        self._is_slope_known = current >= SLOPE_CURRENT
        if current > 0:
            v = self._memory.v
            risen = v - self._rest_v
            more = float(risen[v.argmax()]) - float(np.median(risen))
            self._slope = CELL_SLOPE + max(more, 0.0) / current
        else:
            self._slope = CELL_SLOPE + UNKNOWN_DECAY * (self._slope - CELL_SLOPE)

    def _enter(self, state: ChargingState, now_s: float) -> list[EventMessage]:
        self.state = state
        self.is_active = state in _ACTIVE
        self._since_s = now_s
        self._next_control_s = now_s
        self._below_since_s = None
        self.balancer.stop()
        if state in (ChargingState.CONSTANT_CURRENT, ChargingState.CONSTANT_VOLTAGE):
            self._rest_v[:] = self._memory.v
        if state in (ChargingState.WAITING, ChargingState.BALANCING) or not self.is_active:
            self._current = 0.0
            self._write(0, 0, stop=True)
        self._memory.set_charger("state", state)
        return [EventMessage(EventCode.CHARGER_STATE, 0, NO_OFFSET, int(state), 0)]

    def _write(self, v_set: int, i_set: int, *, stop: bool) -> None:
        self._memory.set_charger("v_set", v_set)
        self._memory.set_charger("i_set", i_set)
        self._memory.set_charger("control", int(stop))


def _top(config: Config) -> int:
    """Return the voltage that no cell is charged beyond [100 uV]: configured, and with a margin below the trip."""
    return min(config.v_cell_chrg, config.v_cell_max - TRIP_MARGIN_COUNTS)
