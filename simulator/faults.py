"""Faults in force on a simulation: injected, over after their time or when cleared; what may be asked of each."""

from dataclasses import dataclass

from firmware_protocol.memory_map import CELLS_PER_PACK, N_CELLS, N_PACKS
from simulator.errors import FaultError
from simulator.fault_kinds import FAULTS, FaultKind, Target
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


def cell_index(pack: int, cell: int) -> int:
    """Return the index of a cell that people call pack 1..8, cell 1..12.

    Raises:
        FaultError: there is no such cell.
    """
    if not (1 <= pack <= N_PACKS and 1 <= cell <= CELLS_PER_PACK):
        raise FaultError("cell", f"pack {pack}, cell {cell}: packs are 1..{N_PACKS}, cells 1..{CELLS_PER_PACK}")
    return (pack - 1) * CELLS_PER_PACK + cell - 1


class FaultBoard:
    """Injects faults and takes them away when their time is over; the same fault on the same target is replaced."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._active: dict[tuple[str, int], ActiveFault] = {}

    @property
    def active(self) -> tuple[ActiveFault, ...]:
        """The faults in force."""
        return tuple(self._active.values())

    def inject(self, name: str, target: int = 0, value: float | None = None, for_s: float | None = None) -> None:
        """Make something go wrong, for a while or until it is cleared.

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
        """Put something right again; nothing happens where it was not wrong.

        Raises:
            FaultError: no such fault.
        """
        kind = fault_kind(name)
        if self._active.pop((name, target), None) is not None:
            kind.apply(self._simulation, target, kind.neutral)

    def clear_all(self) -> None:
        """Put everything right."""
        for fault in self.active:
            self.clear(fault.name, fault.target)

    def step(self, now_s: float) -> None:
        """Clear what is over."""
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
    given = kind.default if value is None else value
    if not kind.minimum <= given <= kind.maximum:
        raise FaultError(kind.name, f"{given} is outside {kind.minimum:g}..{kind.maximum:g} {kind.unit}".rstrip())
    if for_s is not None and not 0 < for_s < float("inf"):
        raise FaultError(kind.name, f"a time of {for_s} s")
    return given
