"""Cell passports: the life of every cell across sessions, and swaps of modules."""

from typing import Annotated, Any

from fastapi import APIRouter, Path
from pydantic import Field

from app.analysis.totals import number
from app.api.schemas.analysis import CellPassportOut, PassportsOut
from app.api.schemas.sessions import DeletedOut
from app.api.sessions.sessions import MAX_UNIX_S
from app.api.web.dependencies import ClockPart, EventsPart, PassportsPart, UserDep
from app.api.web.problems import not_found
from app.api.web.request_body import Body
from app.battery.shape import N_CELLS
from app.estimation.arrays import FloatArray
from app.words import Message

router = APIRouter(tags=["passport"])


class NewSwap(Body):
    """Modules that were replaced."""

    cells: list[int] = Field(min_length=1, max_length=N_CELLS, description="indices from 0")
    time_s: float | None = Field(None, ge=0, le=MAX_UNIX_S, description="unix time; none: now")
    note: str = Field("", max_length=500)


@router.get("/passport", response_model=PassportsOut)
def all_cells(passports: PassportsPart) -> dict[str, Any]:
    """Every cell as it is now; sessions that are new are read in the background meanwhile."""
    passports.update()
    made = passports.passports()
    reading, to_read = passports.progress
    return {
        "sessions": len(made.sessions),
        "reading": reading,
        "to_read": to_read,
        **{name: _listed(made.now(name)) for name in _HISTORIES},
        "rank": _listed(made.rank),
        "drifts": made.drifts,
        "swaps": passports.store.swaps(),
    }


@router.get("/passport/{cell}", response_model=CellPassportOut)
def one_cell(cell: Annotated[int, Path(ge=0, lt=N_CELLS)], passports: PassportsPart) -> dict[str, Any]:
    """The life of one cell, session by session."""
    made = passports.passports()
    entries = [
        {
            "session_id": session_id,
            "time_s": made.times_s[k],
            "line": int(made.line[k, cell]),
            **{name: number(float(getattr(made, name)[k, cell])) for name in _HISTORIES},
        }
        for k, session_id in enumerate(made.sessions)
    ]
    return {
        "cell": cell,
        "rank": number(float(made.rank[cell])),
        "entries": entries,
        "drifts": [drift for drift in made.drifts if drift.cell == cell],
        "swaps": [swap for swap in passports.store.swaps() if cell in swap.cells],
    }


@router.post("/passport/swaps", status_code=201, response_model=PassportsOut)
def swap(
    body: NewSwap, events: EventsPart, passports: PassportsPart, clock: ClockPart, user: UserDep
) -> dict[str, Any]:
    """Record that modules were swapped: their cells begin a new line."""
    at_s = clock.wall_s() if body.time_s is None else body.time_s
    passports.swap(body.cells, at_s, body.note, user.name)
    events.note("info", "module-swapped", Message("modules-swapped", n=len(body.cells), note=body.note), user.name)
    return all_cells(passports)


@router.delete("/passport/swaps/{swap_id}", response_model=DeletedOut)
def take_back(
    swap_id: Annotated[int, Path(ge=0, lt=1 << 63)], events: EventsPart, passports: PassportsPart, user: UserDep
) -> dict[str, Any]:
    """Take a swap back."""
    if not passports.store.remove_swap(swap_id):
        raise not_found("swap", str(swap_id))
    events.note("info", "module-swapped", Message("swap-taken-back", swap=swap_id), user.name)
    return {"deleted": True}


_HISTORIES = (
    "capacity_ah",
    "capacity_sigma_ah",
    "resistance_ohm",
    "resistance_relative",
    "self_discharge_per_day",
    "balancing_h",
)


def _listed(values: FloatArray) -> list[float | None]:
    return [number(value) for value in values.tolist()]
