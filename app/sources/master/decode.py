"""The shadow image as arrays and numbers in SI units. A byte that never came, or came too long ago, is missing."""

from typing import cast

import numpy as np

from app.sources.master.shadow import ShadowImage
from app.telemetry import Ages, BoolArray, Charger, ChargerState, Flags, FloatArray
from firmware_protocol.memory_map import (
    CELLS_PER_PACK,
    CHARGER_STATES,
    CHIP_MISSING,
    FIELDS,
    N_CELLS,
    N_PACKS,
    SLAVE_OFFSET,
    SLAVE_SIZE,
    STATUS_FLAGS,
    T_MISSING,
    V_MISSING,
)

BLANK_S = 10.0  # older than this, a value is not shown
PARTS: dict[str, tuple[int, int]] = {
    "current": (1884, 4),
    "voltage": (1896, 192),
    "temperature": (2290, 96),
    "status": (420, 8),
    "charger": (428, 12),
    "soc": (2982, 2),
    "slaves": (440, 1444),
    "config": (0, 420),
}
_FLAGS_OFFSET = FIELDS["status.flags"].offset
CHARGER_FLAGS = ("hardware", "over-temperature", "input voltage", "battery", "time-out")
_CONNECTED = sum(1 << STATUS_FLAGS.index(name) for name in ("charger", "charging", "load"))
NO_CELLS = np.full(N_CELLS, np.nan)
NO_CELLS.flags.writeable = False


class Decoder:
    """Reads fields of one shadow at one instant."""

    def __init__(self, shadow: ShadowImage, now_ns: int) -> None:
        self._shadow = shadow
        self._now_ns = now_ns

    def is_known(self, name: str) -> bool:
        """Every byte of the field arrived within the last BLANK_S seconds."""
        field = FIELDS[name]
        age = self._shadow.age_s(field.offset, field.size, self._now_ns)
        return age is not None and age <= BLANK_S

    def number(self, name: str) -> float | None:
        """Return a single field in its unit."""
        if not self.is_known(name):
            return None
        field = FIELDS[name]
        return field.unpack(self._shadow.image)[0] * field.scale

    def integer(self, name: str) -> int | None:
        """Return a single field's raw count."""
        return FIELDS[name].unpack(self._shadow.image)[0] if self.is_known(name) else None

    def array(self, name: str, missing: tuple[int, ...]) -> FloatArray:
        """Return a field's elements in its unit, NaN where they hold one of `missing` or never came."""
        field = FIELDS[name]
        if not self.is_known(name):
            return NO_CELLS
        raw = np.frombuffer(self._shadow.image, dtype=f"<{field.fmt}", count=field.count, offset=field.offset)
        values = raw * field.scale
        for code in missing:
            values[raw == code] = np.nan
        return values

    def voltages_v(self) -> FloatArray:
        """(96,) cell voltages [V]."""
        return self.array("v", (V_MISSING, CHIP_MISSING))

    def temperatures_degc(self) -> FloatArray:
        """(96,) cell temperatures [degC]."""
        return self.array("t", (T_MISSING,))

    def balancing(self) -> BoolArray | None:
        """(96,) which cells are bled, from the slaves' configuration registers."""
        start, length = PARTS["slaves"]
        age = self._shadow.age_s(start, length, self._now_ns)
        if age is None or age > BLANK_S:
            return None
        slaves = np.frombuffer(self._shadow.image, np.uint8, N_PACKS * SLAVE_SIZE, SLAVE_OFFSET).reshape(N_PACKS, -1)
        low, high = slaves[:, 80].astype(np.uint16), slaves[:, 81].astype(np.uint16)
        bits = low | (high & 0x0F) << 8
        return (bits[:, None] >> np.arange(CELLS_PER_PACK, dtype=np.uint16) & 1).astype(bool).ravel()

    def ages(self) -> Ages:
        """Seconds since the oldest byte of each part arrived."""
        return Ages(
            **{part: self._shadow.age_s(start, length, self._now_ns) for part, (start, length) in PARTS.items()}
        )

    def flags(self) -> Flags | None:
        """The nine status flags; CAN may carry the first eight alone, then the ninth is None."""
        raw = self.integer("status.flags")
        if raw is not None:
            return Flags(**{name: bool(raw >> bit & 1) for bit, name in enumerate(STATUS_FLAGS)})
        age = self._shadow.age_s(_FLAGS_OFFSET, 1, self._now_ns)
        if age is None or age > BLANK_S:
            return None
        first = self._shadow.image[_FLAGS_OFFSET]
        return Flags(**{name: bool(first >> bit & 1) for bit, name in enumerate(STATUS_FLAGS[:8])}, load=None)

    def relays_open(self) -> bool:
        """Whether no current can flow, neither into the car nor from a charger; False while that is not known."""
        raw = self.integer("status.flags")
        return raw is not None and not raw & _CONNECTED

    def charger(self) -> Charger:
        """The charger block."""
        state, flags, control = (self.integer(f"charger.{name}") for name in ("state", "flags", "control"))
        return Charger(
            state=None if state is None or state >= len(CHARGER_STATES) else cast(ChargerState, CHARGER_STATES[state]),
            asked_voltage_v=self.number("charger.v_set"),
            asked_current_a=self.number("charger.i_set"),
            voltage_v=self.number("charger.v_out"),
            current_a=self.number("charger.i_out"),
            enabled=None if control is None else control == 0,
            flags=tuple(name for bit, name in enumerate(CHARGER_FLAGS) if flags is not None and flags >> bit & 1),
        )
