"""Faults in force on a simulation: injected, removed after their time or when cleared; the values each allows."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from firmware_protocol.memory_map import CELLS_PER_PACK, N_CELLS, N_PACKS
from simulator.errors import FaultError, InputError
from simulator.fault_kinds import FAULTS, FaultKind, Target
from simulator.inputs import FOR_S, Limits, check_number, read_number
from simulator.simulation import Simulation


@dataclass(frozen=True, slots=True)
class ActiveFault:
    """A fault in force."""

    name: str
    target: int  # cell 0..95, pack 0..7, 0 where it has none
    value: float
    since_s: float
    until_s: float | None


_N_TARGETS = {Target.NONE: 1, Target.CELL: N_CELLS, Target.PACK: N_PACKS}
_PLACE_KEYS: dict[Target, tuple[str, ...]] = {Target.NONE: (), Target.PACK: ("pack",), Target.CELL: ("pack", "cell")}
_PLACE_LIMITS = {"pack": Limits(1, N_PACKS, is_whole=True), "cell": Limits(1, CELLS_PER_PACK, is_whole=True)}


def cell_index(pack: int, cell: int) -> int:
    """Return the index of a cell that people call pack 1..8, cell 1..12.

    Raises:
        InputError: there is no such cell.
    """
    if not (1 <= pack <= N_PACKS and 1 <= cell <= CELLS_PER_PACK):
        raise InputError("cell", f"pack {pack}, cell {cell}: packs are 1..{N_PACKS}, cells 1..{CELLS_PER_PACK}")
    return (pack - 1) * CELLS_PER_PACK + cell - 1


def read_target(target: Target, table: Mapping[str, Any]) -> int:
    """Return the index of the cell or pack that the keys `pack` and `cell` name as people count; 0 where none is hit.

    Raises:
        InputError: one is missing, or means nothing for this target, or there is no such cell or pack.
    """
    needed = _PLACE_KEYS[target]
    if {"pack", "cell"} & set(table) != set(needed):
        raise InputError("pack", f"needs {' and '.join(needed) or 'neither pack nor cell'}")
    place = {key: int(read_number(table, key, _PLACE_LIMITS[key])) for key in needed}
    index = cell_index(place.get("pack", 1), place.get("cell", 1))
    return index // CELLS_PER_PACK if target is Target.PACK else index


class FaultBoard:
    """Injects faults and removes them when their time is over; the same fault on the same target is replaced."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._active: dict[tuple[str, int], ActiveFault] = {}

    @property
    def active(self) -> tuple[ActiveFault, ...]:
        """The faults in force."""
        return tuple(self._active.values())

    def inject(self, name: str, target: int = 0, value: float | None = None, for_s: float | None = None) -> None:
        """Inject a fault, for a time or until it is cleared.

        Raises:
            FaultError: no such fault or target, or a value or time out of range.
        """
        kind = fault_kind(name)
        given = check_fault(kind, target, value, for_s)
        kind.apply(self._simulation, target, given)
        if not kind.is_instant:
            now_s = self._simulation.now_s
            until_s = None if for_s is None else now_s + for_s
            self._active[name, target] = ActiveFault(name, target, given, now_s, until_s)

    def clear(self, name: str, target: int = 0) -> None:
        """Clear a fault; nothing happens where it is not in force.

        Raises:
            FaultError: no such fault.
        """
        kind = fault_kind(name)
        if self._active.pop((name, target), None) is not None:
            kind.apply(self._simulation, target, kind.neutral)

    def clear_all(self) -> None:
        """Clear all faults."""
        for fault in self.active:
            self.clear(fault.name, fault.target)

    def step(self, now_s: float) -> None:
        """Remove the faults whose time is over."""
        if not self._active:
            return
        for fault in self.active:
            if fault.until_s is not None and now_s >= fault.until_s:
                self.clear(fault.name, fault.target)


def fault_kind(name: str) -> FaultKind:
    """Return a kind of fault by its name.

    Raises:
        FaultError: there is none.
    """
    if name not in FAULTS:
        raise FaultError(name, f"no such fault; there are {', '.join(FAULTS)}")
    return FAULTS[name]


def check_fault(kind: FaultKind, target: int, value: float | None, for_s: float | None) -> float:
    """Return the value that counts, the default where none is given.

    Raises:
        FaultError: no such target, or a value or time out of range.
    """
    n_targets = _N_TARGETS[kind.target]
    if not 0 <= target < n_targets:
        raise FaultError(kind.name, f"{kind.target.value} index {target} is outside 0..{n_targets - 1}")
    limits = Limits(kind.minimum, kind.maximum, kind.unit, is_whole=kind.is_whole)
    try:
        given = kind.default if value is None else check_number("value", value, limits)
        if for_s is not None:
            check_number("for_s", for_s, FOR_S)
    except InputError as error:
        raise FaultError(kind.name, error.reason) from error
    if for_s is not None and kind.is_instant:
        raise FaultError(kind.name, "for_s means nothing: it is over as soon as it has happened")
    return given
