"""The visible state of a BMS: its relays, its charge, and the latch that holds the relays open."""

import enum

from firmware_protocol.memory_map import CHARGER_STATES


class RelayState(enum.Enum):
    """The side that the relays connect the accumulator to."""

    OPEN = "open"
    PRECHARGE = "precharge"
    VEHICLE = "vehicle"
    CHARGER = "charger"


class ChargingState(enum.IntEnum):
    """The stages of a charge, as the `charger.state` byte numbers them."""

    OFF = CHARGER_STATES.index("off")
    WAITING = CHARGER_STATES.index("waiting")
    CONSTANT_CURRENT = CHARGER_STATES.index("constant_current")
    BALANCING = CHARGER_STATES.index("balancing")
    CONSTANT_VOLTAGE = CHARGER_STATES.index("constant_voltage")
    DONE = CHARGER_STATES.index("done")
    FAULT = CHARGER_STATES.index("fault")


class Latch:
    """The flip-flop in the shutdown circuit: opened by a trip, closed by hand, whatever restarts meanwhile."""

    def __init__(self) -> None:
        self.is_open = False
