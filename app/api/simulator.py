"""The simulated car: what it does, its scenarios and faults. Only where the service started it."""

import secrets
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query
from pydantic import Field

from app.analysis.drill.days import CHOICES, DAYS, POOL
from app.analysis.drill.score import Answer
from app.api.schemas.drill import DrillOut, drill_out
from app.api.schemas.simulator import (
    FaultsInForceOut,
    PhaseOut,
    ScenarioStartedOut,
    SimulatorOut,
    SpeedOut,
    UnpluggedOut,
)
from app.api.web.dependencies import NEEDS_MASTER, DrillPart, EventsPart, SimulatorPart, UserDep
from app.api.web.problems import invalid, not_found
from app.api.web.request_body import Body
from app.service.simulator_control import SimulatorRefused
from app.words import Message

MAX_SEED = 1_000_000
router = APIRouter(prefix="/simulator", tags=["simulator"])


MOST = 1000  # packs, and cells in one; of which there are, the simulator knows
Pack = Annotated[int | None, Field(ge=1, le=MOST)]
Cell = Annotated[int | None, Field(ge=1, le=MOST)]


class FaultIn(Body):
    """What goes wrong, where, how badly, for how long."""

    fault: str = Field(max_length=60)
    pack: Pack = None
    cell: Cell = None
    value: float | None = Field(default=None, allow_inf_nan=False)
    for_s: float | None = Field(default=None, gt=0, le=1e6)


class SpeedIn(Body):
    """Times real time."""

    value: Annotated[float, Field(gt=0, le=1000)] | Literal["max"]


class UnplugIn(Body):
    """Seconds without the RS232 cable."""

    for_s: float = Field(gt=0, le=3600)


class DrillIn(Body):
    """Which days: the same seed gives the same."""

    seed: int | None = Field(default=None, ge=0, le=MAX_SEED)
    days: int = Field(default=DAYS, ge=1, le=len(POOL))


class AnswerIn(Body):
    """What failed, and where."""

    fault: str = Field(max_length=60)
    pack: Pack = None
    cell: Cell = None


class ScenarioIn(Body):
    """One of the library."""

    name: str = Field(max_length=60)


def _ask(simulator: SimulatorPart, do: str, arguments: dict[str, Any] | None = None) -> dict[str, Any]:
    try:
        return simulator.control.ask(do, arguments)
    except SimulatorRefused as error:
        raise invalid(do, (arguments or {}).get("fault"), str(error)) from error


@router.get("", response_model=SimulatorOut)
def read(simulator: SimulatorPart, drill: DrillPart) -> dict[str, Any]:
    """What happens in the simulated car, what else could, and what can go wrong."""
    status = _ask(simulator, "status")
    if drill.state.is_on:  # what goes wrong is the question
        status |= {"scenario": "drill", "phase": "", "active": [], "notices": []}
    faults = _ask(simulator, "faults")["faults"]
    library = _ask(simulator, "scenarios")
    return {
        "scenario": status["scenario"],
        "status": status,
        "scenarios": library["scenarios"],
        "unreadable": library["unreadable"],
        "faults": [{"name": fault.pop("fault"), **fault} for fault in faults],
    }


@router.post("/faults", status_code=201, response_model=FaultsInForceOut)
def inject(body: FaultIn, simulator: SimulatorPart, events: EventsPart, user: UserDep) -> dict[str, Any]:
    """Make something go wrong, for a while or until it is cleared."""
    _ask(simulator, "inject", body.model_dump())
    place = ", ".join(f"{name} {value}" for name, value in (("pack", body.pack), ("cell", body.cell)) if value)
    events.note("info", "simulator-fault", Message("fault-injected", fault=f"{body.fault} {place}".strip()), user.name)
    return {"active": _ask(simulator, "status")["active"]}


@router.delete("/faults", response_model=FaultsInForceOut)
def clear_all(simulator: SimulatorPart, events: EventsPart, user: UserDep) -> dict[str, Any]:
    """Mend everything."""
    _ask(simulator, "clear-all")
    events.note("info", "simulator-fault", Message("faults-mended"), user.name)
    return {"active": []}


@router.delete("/faults/{name}", response_model=FaultsInForceOut)
def clear(
    name: str,
    simulator: SimulatorPart,
    user: UserDep,
    pack: Annotated[int | None, Query(ge=1, le=MOST)] = None,
    cell: Annotated[int | None, Query(ge=1, le=MOST)] = None,
) -> dict[str, Any]:
    """Mend one."""
    _ask(simulator, "clear", {"fault": name, "pack": pack, "cell": cell})
    return {"active": _ask(simulator, "status")["active"]}


@router.post("/speed", response_model=SpeedOut)
def speed(body: SpeedIn, simulator: SimulatorPart, user: UserDep) -> dict[str, Any]:
    """Let time run faster or slower."""
    _ask(simulator, "speed", {"value": body.value})
    return {"speed": body.value}


@router.post("/next", response_model=PhaseOut)
def next_phase(simulator: SimulatorPart, user: UserDep) -> dict[str, Any]:
    """Go on to the scenario's next phase."""
    _ask(simulator, "next")
    return {"phase": _ask(simulator, "status")["phase"]}


@router.post("/unplug", response_model=UnpluggedOut)
def unplug(body: UnplugIn, simulator: SimulatorPart, user: UserDep) -> dict[str, Any]:
    """Pull the RS232 cable for a while."""
    _ask(simulator, "unplug", {"for_s": body.for_s})
    return {"for_s": body.for_s}


@router.post("/scenario", response_model=ScenarioStartedOut)
def scenario(body: ScenarioIn, simulator: SimulatorPart, events: EventsPart, user: UserDep) -> dict[str, Any]:
    """Start the simulated car anew with another scenario; its EEPROM stays."""
    if body.name not in {item["name"] for item in _ask(simulator, "scenarios")["scenarios"]}:
        raise not_found("scenario", body.name)
    simulator.restart(body.name)
    events.note("info", "simulator-scenario", Message("simulator-started", scenario=body.name), user.name)
    return {"scenario": body.name}


@router.get("/drill")
def read_drill(drill: DrillPart) -> DrillOut:
    """How the drill stands; what goes wrong on a day is told when it was answered."""
    return drill_out(drill.state)


@router.post("/drill", status_code=201, dependencies=[NEEDS_MASTER])
def start_drill(body: DrillIn, drill: DrillPart, events: EventsPart, user: UserDep) -> DrillOut:
    """Begin: bad days drawn by the seed, the car starts anew on each."""
    seed = secrets.randbelow(MAX_SEED) if body.seed is None else body.seed
    state = drill.start(seed, body.days)
    events.note("info", "drill", Message("drill-started", days=body.days), user.name)
    return drill_out(state)


@router.post("/drill/answer")
def answer_drill(body: AnswerIn, drill: DrillPart, user: UserDep) -> DrillOut:
    """Say what failed, and where; the next day begins."""
    if body.fault not in CHOICES:
        raise invalid("fault", body.fault, Message("one-of", choices=tuple(CHOICES)))
    return drill_out(drill.answer(Answer(body.fault, body.pack, body.cell)))


@router.delete("/drill")
def stop_drill(drill: DrillPart, user: UserDep) -> DrillOut:
    """End it early."""
    drill.stop()
    return drill_out(drill.state)
