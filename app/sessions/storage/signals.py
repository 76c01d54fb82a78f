"""Names of signals: a field of the memory map or an estimate, with its index: `v[36]`, `conf.ts`, `estimate.soc[3]`."""

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.battery.shape import N_CELLS
from app.sessions.errors import UnknownSignal
from app.sessions.storage.chunks import ESTIMATE_MISSING, ESTIMATE_SCALE, ESTIMATES
from app.sessions.storage.streams import IntArray
from app.words import Message
from firmware_protocol.memory_map import CHIP_MISSING, FIELDS, T_MISSING, V_MISSING

_NAME = re.compile(r"(?P<field>.+?)(?P<indices>(\[\d+\])*)$")


@dataclass(frozen=True, slots=True)
class Signal:
    """One recorded number over time."""

    name: str
    field: str
    element: int
    unit: str
    scale: float
    missing: int | None = None  # the count that says: not measured

    def physical(self, counts: IntArray) -> NDArray[np.float64]:
        """Return counts in the signal's unit, NaN where missing."""
        values = counts.astype(np.float64) * self.scale
        if self.missing is not None:
            values[counts == self.missing] = np.nan
        return values


def _missing(name: str) -> int | None:
    if name == "v":
        return V_MISSING
    if name == "t":
        return T_MISSING
    return CHIP_MISSING if name.startswith("slave[") and name.endswith((".cvr", ".temp")) else None


def find_signal(name: str) -> Signal:
    """Return the signal of this name.

    Raises:
        UnknownSignal: no such field, or not as many indices as it has, or one beyond the end.
    """
    if name in FIELDS and not FIELDS[name].shape:
        field = FIELDS[name]
        return Signal(name, name, 0, field.unit, field.scale)
    match = _NAME.match(name)
    if match is None:
        raise UnknownSignal(name)
    field_name = match["field"]
    indices = [int(text) for text in re.findall(r"\d+", match["indices"])]
    if field_name in ESTIMATES:
        element = _element(name, indices, (N_CELLS,))
        return Signal(name, field_name, element, "1", ESTIMATE_SCALE, ESTIMATE_MISSING)
    if field_name not in FIELDS:
        raise UnknownSignal(name)
    field = FIELDS[field_name]
    element = _element(name, indices, field.shape)
    return Signal(name, field_name, element, field.unit, field.scale, _missing(field_name))


def field_shape(name: str) -> tuple[Signal, int]:
    """Return the first element of a field, which tells unit, scale and what is missing, and how many there are.

    Raises:
        UnknownSignal: no such field.
    """
    if name in ESTIMATES:
        return find_signal(f"{name}[0]"), N_CELLS
    if name not in FIELDS:
        raise UnknownSignal(name)
    field = FIELDS[name]
    return find_signal(name + "[0]" * len(field.shape)), field.count


def _element(name: str, indices: list[int], shape: tuple[int, ...]) -> int:
    if len(indices) != len(shape):
        raise UnknownSignal(name, Message("needs-indices", n=len(shape)))
    element = 0
    for index, length in zip(indices, shape, strict=True):
        if index >= length:
            raise UnknownSignal(name, Message("index-beyond", index=index, last=length - 1))
        element = element * length + index
    return element


FAST_FIELDS = ("i_fs", "i_fc", "v_tot", "v_min", "v_max", "v_avg", "t_min", "t_max", "t_avg", "soc", "dod", "v", "t")


def default_signals() -> list[str]:
    """What an export holds unless told otherwise: what every telemetry frame carries, and the estimates."""
    fast = [
        name if not FIELDS[name].shape else f"{name}[{i}]" for name in FAST_FIELDS for i in range(FIELDS[name].count)
    ]
    return fast + [f"{name}[{cell}]" for name in ESTIMATES for cell in range(N_CELLS)]
