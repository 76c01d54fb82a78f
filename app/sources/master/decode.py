"""The shadow image as arrays and numbers in SI units. A byte that never came, or came too long ago, is missing."""

from collections.abc import Mapping
from typing import TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from app.sources.master.shadow import ShadowImage
from app.telemetry import Ages, BoolArray, Charger, ChargerState, Flags, FloatArray, ProtectionLimits
from app.telemetry.measurement import BLANK_S, Extreme, Reported
from firmware_protocol.memory_map import (
    CELLS_PER_PACK,
    CHARGER_STATES,
    CHIP_MISSING,
    CONFIG,
    FIELDS,
    N_CELLS,
    N_PACKS,
    SLAVE_OFFSET,
    SLAVE_SIZE,
    STATUS_FLAGS,
    T_MISSING,
    V_MISSING,
    Field,
)

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
_SPANS = {name: (field.offset, field.end) for name, field in FIELDS.items()}
_FLAGS_OFFSET = FIELDS["status.flags"].offset
CHARGER_FLAGS = ("hardware", "over-temperature", "input voltage", "battery", "time-out")
_CONNECTED = sum(1 << STATUS_FLAGS.index(name) for name in ("charger", "charging", "load"))
PLAUSIBLE = {"i_fs": 3000.0, "soc": 1.0}  # largest size that the value can have; beyond it, it is missing
T = TypeVar("T", bound=np.generic)
LIMITS = (  # in the order of ProtectionLimits
    "v_cell_min",
    "v_cell_max",
    "t_cell_min",
    "t_cell_max",
    "i_disc_max",
    "i_disc_min",
    "i_chrg_max",
    "i_chrg_min",
)
_CHIPS = slice(FIELDS["slave[0].cvr"].offset - SLAVE_OFFSET, FIELDS["slave[0].cvr"].end - SLAVE_OFFSET)
NO_CELLS = np.full(N_CELLS, np.nan)
NO_CELLS.flags.writeable = False


class Decoder:
    """Reads fields of one shadow at one instant."""

    def __init__(self, shadow: ShadowImage, now_ns: int) -> None:
        self._shadow = shadow
        self._now_ns = now_ns
        is_old = shadow.measured_ns < now_ns - int(BLANK_S * 1e9)
        self._old_before = np.concatenate(([0], np.cumsum(is_old)))  # how many bytes before an offset are old

    def is_known(self, name: str) -> bool:
        """Every byte of the field was measured within the last BLANK_S seconds."""
        start, end = _SPANS[name]
        return bool(self._old_before[start] == self._old_before[end])

    def number(self, name: str, fields: Mapping[str, Field] = FIELDS) -> float | None:
        """Return a single field of a map in its unit; None where it is unknown, or cannot be."""
        if not self.is_known(name):
            return None
        field = fields[name]
        value = field.unpack(self._shadow.image)[0] * field.scale
        return value if abs(value) <= PLAUSIBLE.get(name, np.inf) else None

    def implausible(self) -> tuple[str, ...]:
        """Fields that hold what cannot be: a current of a million ampere, 655 % of charge."""
        return tuple(name for name in PLAUSIBLE if self.is_known(name) and self.number(name) is None)

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

    def chip_voltages_v(self) -> FloatArray:
        """(n_cells,) cell voltages as the slaves' chips hold them [V]; NaN where a pack's never came or are old."""
        is_old = _of_slaves(self._shadow.measured_ns)[:, _CHIPS].min(axis=1) < self._now_ns - BLANK_S * 1e9
        raw = _of_slaves(np.frombuffer(self._shadow.image, np.uint8))[:, _CHIPS].copy().view("<u2")
        values = raw * FIELDS["slave[0].cvr"].scale
        values[(raw == CHIP_MISSING) | (raw == 0) | is_old[:, None]] = np.nan
        return values.ravel()

    def slave_status(self) -> tuple[int | None, ...]:
        """The status of each slave, by pack."""
        return tuple(self.integer(f"slave[{pack}].status") for pack in range(N_PACKS))

    def reported(self) -> Reported:
        """Return the cell figures that the master computes itself."""
        return Reported(
            voltage_v=self.number("v_tot"),
            voltage_min_v=self._extreme("v_min", V_MISSING),
            voltage_max_v=self._extreme("v_max", V_MISSING),
            temperature_min_degc=self._extreme("t_min", T_MISSING),
            temperature_max_degc=self._extreme("t_max", T_MISSING),
            fan_duty=self.number("charger.fan_duty"),
        )

    def _extreme(self, name: str, missing: int) -> Extreme:
        """The master's own (value, cell); a cell that there is not is none."""
        if self.integer(name) == missing:
            return None, None
        cell = self.integer(f"{name}_id")
        return self.number(name), cell if cell is not None and cell < N_CELLS else None

    def limits(self) -> ProtectionLimits:
        """The limits of the configuration, whatever its age."""
        return ProtectionLimits(*(self._config_value(name) for name in LIMITS))  # type: ignore[arg-type]

    def _config_value(self, name: str) -> float:
        field = CONFIG[name]
        return float(field.unpack(self._shadow.image)[0] * field.scale)

    def relays_open(self) -> bool:
        """Return whether no current can flow, into the car or from a charger; False while that is unknown."""
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


def _of_slaves(values: NDArray[T]) -> NDArray[T]:
    """(n_packs, SLAVE_SIZE) of something that there is for each byte of the struct."""
    return values[SLAVE_OFFSET : SLAVE_OFFSET + N_PACKS * SLAVE_SIZE].reshape(N_PACKS, -1)
