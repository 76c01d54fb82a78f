"""Names of signals: a field of what the battery tells or an estimate, with its index: `v[36]`, `estimate.soc[3]`.

The team's fields are those of its memory map; those of a battery with a DBC are in `battery_fields`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from app.battery.source import DbcMapping
from app.sessions.errors import UnknownSignal
from app.sessions.storage.battery_fields import IS_NEW, battery_fields
from app.sessions.storage.chunks import ESTIMATE_MISSING, ESTIMATE_SCALE, ESTIMATES
from app.sessions.storage.streams import CountArray
from app.sources.loaded_battery import LoadedBattery
from app.words import Message
from firmware_protocol.memory_map import CHIP_MISSING, T_MISSING, V_MISSING
from firmware_protocol.older_maps import fields_of

LONGEST_NAME = 100  # characters
_DIGITS = 9  # digits of an index
FAST_FIELDS = ("i_fs", "i_fc", "v_tot", "v_min", "v_max", "v_avg", "t_min", "t_max", "t_avg", "soc", "dod", "v", "t")


@dataclass(frozen=True, slots=True)
class StoredSignal:
    """One recorded number over time."""

    name: str
    field: str
    element: int
    unit: str
    scale: float  # value of a count; values in the unit: resolution of their text
    missing: int | None = None  # the count that says: not measured

    def physical(self, counts: CountArray) -> NDArray[np.float64]:
        """Return counts, or values as they are, in the signal's unit, NaN where missing."""
        if counts.dtype.kind == "f":
            return counts.astype(np.float64)
        values = counts.astype(np.float64) * self.scale
        if self.missing is not None:
            values[counts == self.missing] = np.nan
        return values


@dataclass(frozen=True, slots=True)
class _Field:
    shape: tuple[int, ...]
    unit: str
    scale: float
    missing: int | None = None


def _missing(name: str) -> int | None:
    if name in ("v", "v_min", "v_avg", "v_tot"):
        return V_MISSING
    if name == "t":
        return T_MISSING
    return CHIP_MISSING if name.startswith("slave[") and name.endswith((".cvr", ".temp")) else None


def _fields_of(battery: LoadedBattery, map_hash: str | None) -> dict[str, _Field]:
    if battery.has_memory_map:
        fields = fields_of(map_hash).values()
        return {f.name: _Field(f.shape, f.unit, f.scale, _missing(f.name)) for f in fields}
    mapping = battery.mapping
    is_new = {} if mapping is None else {IS_NEW: _Field((battery.battery.n_cells,), "", 1.0)}
    return is_new | {
        name: _Field(() if field.count is None else (field.count,), field.unit, field.resolution)
        for name, field in battery_fields(battery.battery, mapping or DbcMapping(())).items()
    }


class Signals:
    """The signals that sessions of a battery may hold, by the memory map that they were recorded with."""

    def __init__(self, battery: LoadedBattery, map_hash: str | None = None) -> None:
        estimate = _Field((battery.battery.n_cells,), "1", ESTIMATE_SCALE, ESTIMATE_MISSING)
        self._fields: Mapping[str, _Field] = {**_fields_of(battery, map_hash), **dict.fromkeys(ESTIMATES, estimate)}
        self._of_table = (
            (*FAST_FIELDS, *ESTIMATES) if battery.has_memory_map else tuple(n for n in self._fields if n != IS_NEW)
        )
        self.order = {name: i for i, name in enumerate(self._fields)}  # order of fields on pages

    def find(self, name: str) -> StoredSignal:
        """Return the signal of this name.

        Raises:
            UnknownSignal: no such field, or not as many indices as it has, or one beyond the end.
        """
        if len(name) > LONGEST_NAME:
            raise UnknownSignal(name)
        field, indices = _parts(name)
        if field not in self._fields:
            raise UnknownSignal(name)
        return self._signal(name, field, _element(name, indices, self._fields[field].shape))

    def of_field(self, name: str) -> tuple[StoredSignal, int]:
        """Return the first element of a field, which tells unit, scale and what is missing, and how many there are.

        Raises:
            UnknownSignal: no such field.
        """
        if name not in self._fields:
            raise UnknownSignal(name)
        shape = self._fields[name].shape
        return self.find(name + "[0]" * len(shape)), int(np.prod(shape))

    def names(self, field: str) -> list[str]:
        """Return the names of all elements of a field.

        Raises:
            UnknownSignal: no such field.
        """
        if field not in self._fields:
            raise UnknownSignal(field)
        indices = product(*(range(length) for length in self._fields[field].shape))
        return [field + "".join(f"[{i}]" for i in index) for index in indices]

    def of_table(self) -> list[StoredSignal]:
        """Return what an export contains by default: what is measured of all cells, and the estimates."""
        signals = []
        for name in self._of_table:
            shape = self._fields[name].shape
            signals += [f"{name}[{i}]" for i in range(shape[0])] if shape else [name]
        return [self.find(name) for name in signals]

    def _signal(self, name: str, field: str, element: int) -> StoredSignal:
        of = self._fields[field]
        return StoredSignal(name, field, element, of.unit, of.scale, of.missing)


def _parts(name: str) -> tuple[str, list[int]]:
    """The field of a name, and its indices."""
    field, indices = name, list[int]()
    while field.endswith("]"):
        before, _, index = field[:-1].rpartition("[")
        if not (index.isascii() and index.isdigit() and len(index) <= _DIGITS):
            raise UnknownSignal(name)
        field, indices = before, [int(index), *indices]
    return field, indices


def _element(name: str, indices: list[int], shape: tuple[int, ...]) -> int:
    if len(indices) != len(shape):
        raise UnknownSignal(name, Message("needs-indices", n=len(shape)))
    element = 0
    for index, length in zip(indices, shape, strict=True):
        if index >= length:
            raise UnknownSignal(name, Message("index-beyond", index=index, last=length - 1))
        element = element * length + index
    return element
