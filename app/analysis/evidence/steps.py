"""The faults that a reaction test walks through: what shows each in the bytes, and the time that the rules allow."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from firmware_protocol.messages import EventCode

Sign = Literal[
    "voltage-high", "voltage-low", "current-high", "current-low", "temperature-high", "temperature-low",
    "slave-lost", "wire-lost", "temperature-lost", "current-lost",
]  # fmt: skip
FAST_S: Final = 0.5  # FS rules EV 5.8.7: voltage and current
SLOW_S: Final = 1.0  # the same: temperature


@dataclass(frozen=True, slots=True)
class Step:
    """One fault: `sign` is what the bytes show of it, `allowed_s` None where the rules name no time."""

    name: Sign
    rule: str
    allowed_s: float | None
    trips: tuple[EventCode, ...]  # what the master may call it; an input without its wire floats


STEPS: Final = tuple(
    Step(*row)
    for row in (
        ("voltage-high", "EV 5.8.7", FAST_S, (EventCode.TRIP_V_MAX,)),
        ("voltage-low", "EV 5.8.7", FAST_S, (EventCode.TRIP_V_MIN,)),
        ("current-high", "EV 5.8.7", FAST_S, (EventCode.TRIP_I_DISC, EventCode.TRIP_I_CHRG)),
        ("current-low", "EV 5.8.7", FAST_S, (EventCode.TRIP_I_DISC, EventCode.TRIP_I_CHRG)),
        ("temperature-high", "EV 5.8.7", SLOW_S, (EventCode.TRIP_T_MAX,)),
        ("temperature-low", "EV 5.8.7", SLOW_S, (EventCode.TRIP_T_MIN,)),
        ("slave-lost", "T 11.9.4", FAST_S, (EventCode.TRIP_SLAVE_LOST,)),
        ("wire-lost", "EV 5.8.10", None, (EventCode.TRIP_SENSOR_LOST, EventCode.TRIP_V_MIN, EventCode.TRIP_V_MAX)),
        (
            "temperature-lost",
            "EV 5.8.10",
            None,
            (EventCode.TRIP_SENSOR_LOST, EventCode.TRIP_T_MIN, EventCode.TRIP_T_MAX),
        ),
        ("current-lost", "EV 5.8.10", None, (EventCode.TRIP_SENSOR_LOST, EventCode.TRIP_I_DISC)),
    )
)


@dataclass(frozen=True, slots=True)
class Cycles:
    """Periods at which the firmware measures, as the team declares them [s]: they cannot be read from the bytes."""

    pass_s: float = 0.02  # all voltages and the current
    temperature_s: float = 0.4  # every temperature once
    wire_check_s: float = 1.0  # every wire once
