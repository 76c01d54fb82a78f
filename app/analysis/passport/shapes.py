"""Cell passports as they are sent and drawn: every cell now, and the life of one cell."""

from __future__ import annotations

from dataclasses import dataclass

from app.analysis.passport.history import Drift
from app.analysis.passport.keeper import PassportKeeper
from app.analysis.totals import listed, number
from app.sessions.passport_store import StoredSwap


@dataclass(frozen=True)
class AllPassports:
    """Every cell as it is now, out of all sessions read; `reading` of `to_read` while more are read.

    Each session is judged by its own cell file; `by_todays_cell` of them keep none, and are judged by today's.
    `car` is whose they are, of all `cars`, as the season names them.
    """

    car: str
    cars: list[str]
    sessions: int
    by_todays_cell: int
    reading: int
    to_read: int
    capacity_ah: list[float | None]
    capacity_sigma_ah: list[float | None]
    resistance_ohm: list[float | None]
    resistance_relative: list[float | None]
    self_discharge_per_day: list[float | None]
    balancing_h: list[float | None]
    rank: list[float | None]
    drifts: list[Drift]
    swaps: list[StoredSwap]


@dataclass(frozen=True)
class PassportEntry:
    """What one session told about a cell; `line` counts its modules from 0."""

    session_id: str
    time_s: float
    line: int
    capacity_ah: float | None
    capacity_sigma_ah: float | None
    resistance_ohm: float | None
    resistance_relative: float | None
    self_discharge_per_day: float | None
    balancing_h: float | None


@dataclass(frozen=True)
class CellPassport:
    """The life of one cell's place, the oldest session first."""

    car: str
    cell: int
    rank: float | None
    entries: list[PassportEntry]
    drifts: list[Drift]
    swaps: list[StoredSwap]


def swaps_of(keeper: PassportKeeper, car: str) -> list[StoredSwap]:
    """Return the swaps that count for a car, the oldest first."""
    return [swap for swap in keeper.store.swaps() if swap.car in (None, car)]


def all_passports(keeper: PassportKeeper, car: str = "") -> AllPassports:
    """Return every cell of a car as it is now; without a name of the car of the newest session.

    Raises:
        ConfigError: there are other cars alone.
    """
    reading, to_read = keeper.progress  # first: what is read meanwhile is asked for again, never passed over
    car = keeper.car(car)
    made = keeper.passports(car)
    return AllPassports(
        car=car,
        cars=sorted(keeper.store.cars()),
        sessions=len(made.sessions),
        by_todays_cell=made.n_by_todays_cell,
        reading=reading,
        to_read=to_read,
        capacity_ah=listed(made.now("capacity_ah")),
        capacity_sigma_ah=listed(made.now("capacity_sigma_ah")),
        resistance_ohm=listed(made.now("resistance_ohm")),
        resistance_relative=listed(made.now("resistance_relative")),
        self_discharge_per_day=listed(made.now("self_discharge_per_day")),
        balancing_h=listed(made.now("balancing_h")),
        rank=listed(made.rank),
        drifts=list(made.drifts),
        swaps=swaps_of(keeper, car),
    )


def cell_passport(keeper: PassportKeeper, cell: int, car: str = "") -> CellPassport:
    """Return the life of one cell of a car, session by session; without a name of the car of the newest session.

    Raises:
        ConfigError: there are other cars alone.
    """
    car = keeper.car(car)
    made = keeper.passports(car)
    entries = [
        PassportEntry(
            session_id=session_id,
            time_s=float(made.times_s[k]),
            line=int(made.line[k, cell]),
            capacity_ah=number(made.capacity_ah[k, cell]),
            capacity_sigma_ah=number(made.capacity_sigma_ah[k, cell]),
            resistance_ohm=number(made.resistance_ohm[k, cell]),
            resistance_relative=number(made.resistance_relative[k, cell]),
            self_discharge_per_day=number(made.self_discharge_per_day[k, cell]),
            balancing_h=number(made.balancing_h[k, cell]),
        )
        for k, session_id in enumerate(made.sessions)
    ]
    return CellPassport(
        car=car,
        cell=cell,
        rank=number(made.rank[cell]),
        entries=entries,
        drifts=[drift for drift in made.drifts if drift.cell == cell],
        swaps=[swap for swap in swaps_of(keeper, car) if cell in swap.cells],
    )
