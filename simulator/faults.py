"""Faults in force on a simulation: injected, removed after their time or when cleared; the values each allows."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from simulator.errors import FaultError, InputError
from simulator.fault_kinds import FAULTS, FaultKind, Target, today
from simulator.inputs import FOR_S, NumberRange, check_number, read_number
from simulator.shape import TEAM, Shape
from simulator.vehicle import Vehicle


@dataclass(frozen=True, slots=True)
class ActiveFault:
    """A fault in force."""

    name: str
    target: int  # cell or pack from 0, 0 where it has none
    value: float
    since_s: float
    until_s: float | None


_PLACE_KEYS: dict[Target, tuple[str, ...]] = {Target.NONE: (), Target.PACK: ("pack",), Target.CELL: ("pack", "cell")}


def read_target(target: Target, table: Mapping[str, Any], shape: Shape = TEAM) -> int:
    """Return the index of the cell or pack that the keys `pack` and `cell` name as people count; 0 where none is hit.

    Raises:
        InputError: one is missing, or means nothing for this target, or there is no such cell or pack.
    """
    needed = _PLACE_KEYS[target]
    if {"pack", "cell"} & set(table) != set(needed):
        raise InputError("pack", f"needs {' and '.join(needed) or 'neither pack nor cell'}")
    if target is Target.NONE:
        return 0
    pack = int(read_number(table, "pack", NumberRange(1, shape.n_packs, is_whole=True)))
    if target is Target.PACK:
        return pack - 1
    cells = shape.packs[pack - 1]
    return shape.cell_index(pack, int(read_number(table, "cell", NumberRange(1, cells, is_whole=True))))


class FaultBoard:
    """Injects faults and removes them when their time is over; the same fault on the same target is replaced."""

    def __init__(self, simulation: Vehicle) -> None:
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
        given = check_fault(kind, target, value, for_s, self._simulation.shape)
        kind.apply(self._simulation, target, given)
        if not kind.is_instant:
            now_s = self._simulation.now_s
            until_s = None if for_s is None else now_s + for_s
            self._active[kind.name, target] = ActiveFault(kind.name, target, given, now_s, until_s)

    def clear(self, name: str, target: int = 0) -> None:
        """Clear a fault; nothing happens where it is not in force.

        Raises:
            FaultError: no such fault.
        """
        kind = fault_kind(name)
        if self._active.pop((kind.name, target), None) is not None:
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
    name = today(name)
    if name not in FAULTS:
        raise FaultError(name, f"no such fault; there are {', '.join(FAULTS)}")
    return FAULTS[name]


def check_fault(
    kind: FaultKind,
    target: int,
    value: float | None,
    for_s: float | None,
    shape: Shape = TEAM,
) -> float:
    """Return the value that counts, the default where none is given.

    Args:
        kind: of the fault.
        target: cell or pack, from 0.
        value: None = the default.
        for_s: how long, None = for good.
        shape: of the battery.

    Raises:
        FaultError: no such target, or a value or time out of range; a fault that only the team's own battery can have.
    """
    if kind.is_of_team and not shape.is_team:
        raise FaultError(
            kind.name, "only the team's own battery has what it breaks: a master with RS232, EEPROM, isoSPI"
        )
    n_targets = {Target.NONE: 1, Target.CELL: shape.n_cells, Target.PACK: shape.n_packs}[kind.target]
    if not 0 <= target < n_targets:
        raise FaultError(kind.name, f"{kind.target.value} index {target} is outside 0..{n_targets - 1}")
    limits = NumberRange(kind.minimum, kind.maximum, kind.unit, is_whole=kind.is_whole)
    try:
        given = kind.default if value is None else check_number("value", value, limits)
        if for_s is not None:
            check_number("for_s", for_s, FOR_S)
    except InputError as error:
        raise FaultError(kind.name, error.reason) from error
    if for_s is not None and kind.is_instant:
        raise FaultError(kind.name, "for_s means nothing: it is over as soon as it has happened")
    return given
