"""Cell passports: the life of every cell across sessions, and swaps of modules."""

from typing import Annotated, Any

from fastapi import APIRouter, Path, Query
from pydantic import Field

from app.analysis.passport.shapes import AllPassports, CellPassport, all_passports, cell_passport
from app.api.schemas.sessions import DeletedOut
from app.api.sessions.routes import MAX_UNIX_S
from app.api.web.dependencies import ClockPart, EventsPart, PassportsPart, UserDep
from app.api.web.problems import invalid, not_found
from app.api.web.request_body import Body
from app.battery.fields import MOST_CELLS
from app.words import Message

router = APIRouter(tags=["passport"])
Car = Annotated[
    str,
    Query(max_length=200, pattern=r"^[^\x00]*$", description="of this car; empty: of that of the newest session"),
]


class NewSwap(Body):
    """Modules that were replaced."""

    cells: list[int] = Field(min_length=1, max_length=MOST_CELLS, description="indices from 0")
    time_s: float | None = Field(None, ge=0, le=MAX_UNIX_S, description="unix time; none: now")
    note: str = Field("", max_length=500)
    car: str = Field("", max_length=200, description="whose; empty: of the only car there is")


@router.get("/passport")
def all_cells(passports: PassportsPart, car: Car = "") -> AllPassports:
    """Every cell of a car as it is now; sessions that are new are read in the background meanwhile."""
    passports.update()
    return all_passports(passports, car)


@router.get("/passport/{cell}")
def one_cell(cell: Annotated[int, Path(ge=0, lt=MOST_CELLS)], passports: PassportsPart, car: Car = "") -> CellPassport:
    """The life of one cell of a car, session by session."""
    if cell >= passports.battery.n_cells:
        raise invalid("cell", cell, f"0..{passports.battery.n_cells - 1}")
    return cell_passport(passports, cell, car)


@router.post("/passport/swaps", status_code=201)
def swap(body: NewSwap, events: EventsPart, passports: PassportsPart, clock: ClockPart, user: UserDep) -> AllPassports:
    """Record that modules of a car were swapped: their cells begin a new line."""
    at_s = clock.wall_s() if body.time_s is None else body.time_s
    passports.swap(body.cells, at_s, body.note, user.name, body.car)
    events.note("info", "module-swapped", Message("modules-swapped", n=len(body.cells), note=body.note), user.name)
    return all_cells(passports, body.car)


@router.delete("/passport/swaps/{swap_id}", response_model=DeletedOut)
def take_back(
    swap_id: Annotated[int, Path(ge=0, lt=1 << 63)], events: EventsPart, passports: PassportsPart, user: UserDep
) -> dict[str, Any]:
    """Take a swap back."""
    if not passports.store.remove_swap(swap_id):
        raise not_found("swap", str(swap_id))
    events.note("info", "module-swapped", Message("swap-taken-back", swap=swap_id), user.name)
    return {"deleted": True}
