"""Limits with persistence, latched: 500 ms for voltage and current, 1 s for temperature (FS rules EV 5.8.7).

The rules count from the violation, and tell to consider the sample rate: the persistence is what measuring and
filtering leave of those times. A voltage is up to 20 ms old, and the filter at its default weight takes up to nine
passes to follow a step; a temperature is up to 400 ms old. A current is a mean: of the whole buffers of `ts` samples
that `fc_avg` takes, and it begins anywhere in the first of them.

A lost measurement is critical like a passed limit. Once tripped, the OK signal stays off until faults are cleared: a
flip-flop on the board holds it, which no restart of the firmware and no loss of power resets (EV 6.1.6).
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from firmware_protocol.memory_map import CELLS_PER_PACK
from firmware_protocol.messages import NO_OFFSET, EventCode, EventMessage
from simulator.memory import Config

CURRENT_ALLOWED_S = 0.4  # to the OK signal; the relays and who has to show it by telemetry get the rest of the 500 ms
PASS_S = 0.02
FAST_PERSISTENCE_S = 0.3
SLOW_PERSISTENCE_S = 0.4
WIRE_PERSISTENCE_S = 0.5  # a lost measurement has no time in the rules: on a disturbed line it may come back
SENSOR_PERSISTENCE_S = 1.0  # of a temperature
CHARGE_TOLERANCE = 100  # 1 A [10 mA]: the sensor's accuracy, so that the asked current does not trip


@dataclass(slots=True)
class Reading:
    """The measured values that the protection checks, in counts of the memory map."""

    v_min: int
    v_min_id: int
    v_max: int
    v_max_id: int
    t_min: int
    t_min_id: int
    t_max: int
    t_max_id: int
    i_fc: int
    is_charging: bool
    lost_cell: int | None  # a cell without a voltage, though its slave answers
    lost_temperature: int | None
    lost_slave: int | None
    lost_current: bool


@dataclass(frozen=True, slots=True)
class Violation:
    """A value beyond its limit, or a measurement that is missing."""

    code: EventCode
    persistence_s: float
    cell: int
    value: int
    limit: int

    def to_event(self) -> EventMessage:
        """Return the event that tells of the trip."""
        return EventMessage(self.code, 0, self.cell, self.value, self.limit)


def violations(config: Config, reading: Reading) -> Iterator[Violation]:
    """Yield the violations of this pass, whether they persist or not."""
    fast, slow = FAST_PERSISTENCE_S, SLOW_PERSISTENCE_S
    if reading.v_min < config.v_cell_min:
        yield Violation(EventCode.TRIP_V_MIN, fast, reading.v_min_id, reading.v_min, config.v_cell_min)
    if reading.v_max > config.v_cell_max:
        yield Violation(EventCode.TRIP_V_MAX, fast, reading.v_max_id, reading.v_max, config.v_cell_max)
    if reading.t_min < config.t_cell_min:
        yield Violation(EventCode.TRIP_T_MIN, slow, reading.t_min_id, reading.t_min, config.t_cell_min)
    if reading.t_max > config.t_cell_max:
        yield Violation(EventCode.TRIP_T_MAX, slow, reading.t_max_id, reading.t_max, config.t_cell_max)
    yield from _current_violations(config, reading)
    if reading.lost_slave is not None:
        yield Violation(EventCode.TRIP_SLAVE_LOST, fast, reading.lost_slave * CELLS_PER_PACK, 0, 0)
    if reading.lost_cell is not None:
        yield Violation(EventCode.TRIP_SENSOR_LOST, WIRE_PERSISTENCE_S, reading.lost_cell, 0, 0)
    elif reading.lost_current:
        yield Violation(EventCode.TRIP_SENSOR_LOST, fast, NO_OFFSET, 0, 0)
    elif reading.lost_temperature is not None:
        yield Violation(EventCode.TRIP_SENSOR_LOST, SENSOR_PERSISTENCE_S, reading.lost_temperature, 0, 0)


def current_persistence_s(config: Config) -> float:
    """Return what the mean of the current leaves of the time allowed [s]."""
    averaged = max(-(-config.fc_avg // config.ts), 1) * config.ts
    return max(min(FAST_PERSISTENCE_S, CURRENT_ALLOWED_S - PASS_S - (averaged + config.ts) / 1000), 0.0)


def _current_violations(config: Config, reading: Reading) -> Iterator[Violation]:
    charge, persistence_s = -reading.i_fc, current_persistence_s(config)
    if reading.is_charging:
        if charge > config.i_chrg_max + CHARGE_TOLERANCE:
            yield Violation(EventCode.TRIP_I_CHRG, persistence_s, NO_OFFSET, charge, config.i_chrg_max)
        elif charge < config.i_chrg_min - CHARGE_TOLERANCE:
            yield Violation(EventCode.TRIP_I_CHRG, persistence_s, NO_OFFSET, charge, config.i_chrg_min)
    elif reading.i_fc > config.i_disc_max:
        yield Violation(EventCode.TRIP_I_DISC, persistence_s, NO_OFFSET, reading.i_fc, config.i_disc_max)
    elif reading.i_fc < config.i_disc_min:
        yield Violation(EventCode.TRIP_I_DISC, persistence_s, NO_OFFSET, reading.i_fc, config.i_disc_min)


class Latch:
    """The flip-flop in the shutdown circuit: opened by a trip, closed by hand."""

    def __init__(self) -> None:
        self.is_open = False


class Protection:
    """The OK signal: switched off by a violation that persists, stays off until cleared."""

    def __init__(self, latch: Latch) -> None:
        self._latch = latch
        self._since_s: dict[EventCode, float] = {}
        self._critical: tuple[Violation, ...] = ()
        self._tripped: set[EventCode] = set()

    @property
    def is_ok(self) -> bool:
        """The OK signal."""
        return not self._latch.is_open

    def judge(self, found: Iterable[Violation], now_s: float) -> list[EventMessage]:
        """Take this pass's violations and return an event for each that has just tripped."""
        self._critical = tuple(found)
        if not self._critical:
            self._since_s.clear()
            return []
        codes = {violation.code for violation in self._critical}
        self._since_s = {code: since for code, since in self._since_s.items() if code in codes}
        events = []
        for violation in self._critical:
            since_s = self._since_s.setdefault(violation.code, now_s)
            # a microsecond of slack: times are sums of steps
            if violation.code not in self._tripped and now_s - since_s >= violation.persistence_s - 1e-6:
                self._tripped.add(violation.code)
                self._latch.is_open = True
                events.append(violation.to_event())
        return events

    def clear(self) -> bool:
        """Release the latch unless a limit is violated now; return whether it was released."""
        if self._critical:
            return False
        self._tripped.clear()
        self._latch.is_open = False
        return True
