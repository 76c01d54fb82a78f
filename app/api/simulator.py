"""The simulated car: what it does, its scenarios and faults. Only where the service started it."""

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query
from pydantic import BaseModel, Field

from app.api.schemas.snapshot import Number
from app.api.web.dependencies import EventsPart, SimulatorPart, UserDep
from app.api.web.problems import invalid, not_found
from app.api.web.request_body import Body
from app.service.simulator_control import SimulatorRefused
from app.words import Message, RenderedMessage

router = APIRouter(prefix="/simulator", tags=["simulator"])


MOST = 1000  # packs, and cells in one; of which there are, the simulator knows
Pack = Annotated[int | None, Field(ge=1, le=MOST)]
Cell = Annotated[int | None, Field(ge=1, le=MOST)]


class FaultInForceOut(BaseModel):
    """A fault that acts now."""

    fault: str
    value: float
    since_s: float
    until_s: Number
    pack: int | None = None
    cell: int | None = None


class NoticeOut(BaseModel):
    """Something of the scenario that did not happen as it was planned, and when it should have."""

    at_s: float
    message: RenderedMessage


class SimulatorStatusOut(BaseModel):
    """State of the simulated car; `speed` null: as fast as possible."""

    time_s: float
    speed: Number
    scenario: str
    phase: str
    lap: int
    soc: float
    current_a: float
    master_is_running: bool
    relays: Literal["open", "precharge", "precharge failed", "vehicle", "charger"]
    relays_since_s: float | None  # in the car's time; None while the master is off
    link_v: float  # voltage of the DC-link capacitor, behind the contactors
    notices: list[NoticeOut]
    active: list[FaultInForceOut]


class ScenarioOut(BaseModel):
    """One of the library."""

    name: str
    title: str
    description: str


class UnreadableScenarioOut(BaseModel):
    """A scenario's file that cannot be used, and why."""

    name: str
    reason: str


class FaultKindOut(BaseModel):
    """A fault that the simulator can inject."""

    name: str
    meaning: str
    area: str
    target: Literal["none", "pack", "cell"]
    unit: str
    minimum: float
    maximum: float
    default: float
    is_instant: bool


class SimulatorOut(BaseModel):
    """State of the simulated car, its scenarios and its faults."""

    scenario: str
    status: SimulatorStatusOut
    scenarios: list[ScenarioOut]
    unreadable: list[UnreadableScenarioOut]
    faults: list[FaultKindOut]


class FaultsInForceOut(BaseModel):
    """After the change."""

    active: list[FaultInForceOut]


class SpeedOut(BaseModel):
    """Times real time."""

    speed: float | Literal["max"]


class PhaseOut(BaseModel):
    """The phase that runs now."""

    phase: str


class UnpluggedOut(BaseModel):
    """Seconds without the cable."""

    for_s: float


class ScenarioStartedOut(BaseModel):
    """The scenario that runs now."""

    scenario: str


class FaultIn(Body):
    """A fault to inject: its kind, place, size and duration."""

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


class ScenarioIn(Body):
    """One of the library."""

    name: str = Field(max_length=60)


def _ask(simulator: SimulatorPart, do: str, arguments: dict[str, Any] | None = None) -> dict[str, Any]:
    try:
        return simulator.control.ask(do, arguments)
    except SimulatorRefused as error:
        raise invalid(do, (arguments or {}).get("fault"), str(error)) from error


@router.get("", response_model=SimulatorOut)
def read(simulator: SimulatorPart) -> dict[str, Any]:
    """Return the state of the simulated car, its scenarios and its faults."""
    status = _ask(simulator, "status")
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
    fault = _ask(simulator, "inject", body.model_dump())["fault"]  # its code today, also by an older name
    place = ", ".join(f"{name} {value}" for name, value in (("pack", body.pack), ("cell", body.cell)) if value)
    events.note("info", "simulator-fault", Message("fault-injected", fault=f"{fault} {place}".strip()), user.name)
    return {"active": _ask(simulator, "status")["active"]}


@router.delete("/faults", response_model=FaultsInForceOut)
def clear_all(simulator: SimulatorPart, events: EventsPart, user: UserDep) -> dict[str, Any]:
    """Clear all faults."""
    _ask(simulator, "clear-all")
    events.note("info", "simulator-fault", Message("all-faults-cleared"), user.name)
    return {"active": []}


@router.delete("/faults/{name}", response_model=FaultsInForceOut)
def clear(
    name: str,
    simulator: SimulatorPart,
    user: UserDep,
    pack: Annotated[int | None, Query(ge=1, le=MOST)] = None,
    cell: Annotated[int | None, Query(ge=1, le=MOST)] = None,
) -> dict[str, Any]:
    """Clear one fault."""
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
