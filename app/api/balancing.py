"""Balancing studies: a charge or a rest with each balancing circuit, simulated in a process with limits."""

import threading
from typing import Annotated, Any, Final, Literal

import numpy as np
from fastapi import APIRouter, Query
from pydantic import BaseModel, ConfigDict, Field

from app.api.schemas.snapshot import Number
from app.api.web.dependencies import WorkersPart
from app.api.web.problems import invalid
from app.errors import NotNow
from app.sessions.worker import JobLimits
from app.words import Message
from simulator.balancing.choices import CIRCUITS
from simulator.balancing.choices import LIMITS as STUDY_LIMITS
from simulator.balancing.study import MOST_CELLS, Study, figures_of_circuits, study_of
from simulator.errors import ParameterError

LIMITS = JobLimits(120)
MOST_POINTS = 300  # points of a curve
Value = Annotated[float | None, Field(allow_inf_nan=False)]
Circuit = Literal["passive", "switched-capacitor", "transformer", "none"]
router = APIRouter(prefix="/simulator", tags=["simulator"])
_study_under_way = threading.Lock()  # one at a time: reports and imports need the other worker process


# What a number of the request is in the simulation, how many of its units are one there, and the unit
_NUMBERS: Final = {
    "rate": ("rate_c", 1.0, "C"),
    "hours": ("hours", 1.0, "h"),
    "soc": ("soc", 100.0, "percent"),
    "spread": ("spread", 100.0, "percent"),
    "temperature": ("ambient_degc", 1.0, "degC"),
    "resistor": ("resistor_ohm", 1.0, "ohm"),
}


class StudyIn(BaseModel):
    """A study of a charge or a rest; what is not given is as in `voltwall balance`."""

    model_config = ConfigDict(extra="forbid")

    circuit: list[Circuit] = Field(default=[], max_length=4, description="all where none is named")
    thesis: bool = Field(default=False, description="the six cells of the balancing thesis, not the car's")
    packs: int | None = Field(default=None, ge=1, le=MOST_CELLS, description="in series; with `cells`")
    cells: int | None = Field(default=None, ge=1, le=MOST_CELLS, description="in series in each pack")
    rest: bool = False
    rate: Value = Field(default=None, description="charging current over the rated capacity, C")
    hours: Value = Field(default=None, description="after which it ends at the latest")
    soc: Value = Field(default=None, description="mean at the start, percent")
    spread: Value = Field(default=None, description="highest less lowest at the start, percent")
    temperature: Value = Field(default=None, description="of the air, degC")
    resistor: Value = Field(default=None, description="that a cell is bled through, ohm")

    @property
    def command(self) -> str:
        """The command line that simulates the same."""
        given = [f"--circuit={name}" for name in self.circuit]
        given += [f"--{name}" for name in ("thesis", "rest") if getattr(self, name)]
        if self.packs is not None and self.cells is not None:
            given.append(f"--packs={self.packs}x{self.cells}")
        given += [f"--{name}={getattr(self, name)}" for name in _NUMBERS if getattr(self, name) is not None]
        return " ".join(["voltwall balance", *given])

    def study(self) -> Study:
        """Return what is to be simulated.

        Raises:
            Problem: a number is out of its limits, or none of a rest.
            ParameterError: there are too many cells, or one would begin outside of 0 to 100 %.
        """
        if self.rest and self.rate is not None:
            raise invalid("rate", self.rate, Message("rest-without-rate"))
        values = {}
        for name, (meaning, scale, unit) in _NUMBERS.items():
            value, (low, high) = getattr(self, name), STUDY_LIMITS[meaning]
            if value is not None and not low * scale <= value <= high * scale:
                raise invalid(name, value, f"{low * scale:g} to {high * scale:g} {unit}")
            values[meaning] = None if value is None else value / scale
        packs = None if self.packs is None or self.cells is None else (self.packs, self.cells)
        return study_of(thesis=self.thesis, rest=self.rest, packs=packs, **values)


class BalancingThesisOut(BaseModel):
    """Figures of the balancing thesis for the same study."""

    hours: float
    max_degc: float
    soc_difference_percent: float


class BalancingCircuitOut(BaseModel):
    """Result of one circuit; the curves have a value at each `time_h`, null after the end."""

    name: Circuit
    hours: float
    max_degc: float
    soc_difference: float
    soc_difference_within_packs: float
    balancing_loss_wh: float
    stopped_by: str | None
    thesis: BalancingThesisOut | None
    soc_spread: list[Number]
    temperature_max_degc: list[Number]
    charger_a: list[Number]


class BalancingOut(BaseModel):
    """All circuits over one time."""

    command: str
    time_h: list[float]
    circuits: list[BalancingCircuitOut]


@router.get("/balancing", response_model=BalancingOut)
def balancing(study: Annotated[StudyIn, Query()], workers: WorkersPart) -> dict[str, Any]:
    """Simulate a charge or a rest with each balancing circuit; takes seconds, with many cells minutes.

    One study at a time: a second one is refused meanwhile.
    """
    try:
        chosen = study.study()
    except ParameterError as error:
        raise invalid(error.name, error.value, error.rule) from error
    if not _study_under_way.acquire(blocking=False):
        raise NotNow(Message("study-under-way"))
    try:
        circuits = workers.run(LIMITS, figures_of_circuits, chosen, tuple(dict.fromkeys(study.circuit or CIRCUITS)))
    finally:
        _study_under_way.release()
    longest = max(run["course"]["time_h"][-1] for run in circuits.values())
    time_h = np.linspace(0.0, longest, MOST_POINTS)
    return {
        "command": study.command,
        "time_h": time_h.tolist(),
        "circuits": [{"name": name, **run, **_curves(run["course"], time_h)} for name, run in circuits.items()],
    }


def _curves(course: dict[str, list[float]], time_h: np.ndarray) -> dict[str, list[float | None]]:
    times = course["time_h"]

    def at(values: list[float]) -> list[float | None]:
        interpolated = np.interp(time_h, times, values)
        return [float(value) if t <= times[-1] else None for t, value in zip(time_h, interpolated, strict=True)]

    spread = [high - low for low, high in zip(course["soc_min"], course["soc_max"], strict=True)]
    return {
        "soc_spread": at(spread),
        "temperature_max_degc": at(course["temperature_max_degc"]),
        "charger_a": at(course["charger_a"]),
    }
