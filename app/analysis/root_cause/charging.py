"""Hypotheses about the charger."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from app.analysis.root_cause.recording import Recording, Suspicion
from app.words import Message
from firmware_protocol.elcon import ChargerFlags
from firmware_protocol.memory_map import CHARGER_STATES

FAULT: Final = CHARGER_STATES.index("fault")
ACTIVE: Final = tuple(CHARGER_STATES.index(name) for name in ("constant_current", "constant_voltage", "balancing"))
NOT_HEARD: Final = 255
BEFORE_S: Final = 3.0
BY_FLAG: Final = (
    (ChargerFlags.HARDWARE, "charger-hardware-fault", Message("seen-charger-broken")),
    (ChargerFlags.OVER_TEMPERATURE, "charger-over-temperature", Message("seen-charger-hot")),
    (ChargerFlags.INPUT_VOLTAGE, "charger-input-voltage", Message("seen-charger-no-mains")),
    (ChargerFlags.BATTERY, "charger-no-battery", Message("seen-charger-reversed")),
)


def charger_suspicions(recording: Recording) -> Iterator[Suspicion]:
    """Yield why charging ended by itself."""
    state = recording.charger_state
    ended = np.flatnonzero((state[1:] == FAULT) & np.isin(state[:-1], ACTIVE)) + 1
    for row in ended:
        at_s = float(recording.time_s[row])
        near = recording.near(at_s - BEFORE_S, at_s + 1.0)
        flags = [value for value in recording.charger_flags[near].tolist() if value not in (-1, NOT_HEARD)]
        fault = next(((code, seen) for flag, code, seen in BY_FLAG if any(value & flag for value in flags)), None)
        if fault is not None:
            code, seen = fault
            yield Suspicion(code, at_s - BEFORE_S, 60.0, (seen,))
        elif any(e.code == "can-rx-timeout" and abs(e.at_s - at_s) < 2.0 for e in recording.events):
            yield Suspicion("charger-silent", at_s - 8.0, 40.0, (Message("seen-charger-silent"),))
