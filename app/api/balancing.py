"""What each balancing circuit makes of a charge or a rest: `voltwall balance`, run in a process with limits."""

import json
import re
import threading
from typing import Annotated, Any, Literal

import numpy as np
from fastapi import APIRouter, Query
from pydantic import BaseModel, ConfigDict, Field

from app.api.schemas.snapshot import Number
from app.api.web.dependencies import WorkersPart
from app.api.web.problems import Problem, invalid
from app.errors import NotNow
from app.sessions.worker import Limits
from app.sessions.worker.command import CommandRefused, output_of
from app.words import Message

LIMITS = Limits(120)
MOST_POINTS = 300  # of a curve
Circuit = Literal["passive", "switched-capacitor", "transformer", "none"]
Value = Annotated[float | None, Field(allow_inf_nan=False)]
router = APIRouter(prefix="/simulator", tags=["simulator"])
_study_under_way = threading.Lock()  # one at a time: reports and imports need the other worker process


class StudyIn(BaseModel):
    """What is charged or rests; what is not given is as in `voltwall balance`, which also says the limits."""

    model_config = ConfigDict(extra="forbid")

    circuit: list[Circuit] = Field(default=[], max_length=4, description="all where none is named")
    thesis: bool = Field(default=False, description="the six cells of the balancing thesis, not the car's")
    packs: int | None = Field(default=None, ge=1, le=600, description="in series; with `cells`")
    cells: int | None = Field(default=None, ge=1, le=600, description="in series in each pack")
    rest: bool = False
    rate: Value = Field(default=None, description="charging current over the rated capacity, C")
    hours: Value = Field(default=None, description="after which it ends at the latest")
    soc: Value = Field(default=None, description="mean at the start, percent")
    spread: Value = Field(default=None, description="highest less lowest at the start, percent")
    temperature: Value = Field(default=None, description="of the air, degC")
    resistor: Value = Field(default=None, description="that a cell is bled through, ohm")

    def arguments(self) -> list[str]:
        """Return the options of the command."""
        given = [f"--circuit={name}" for name in self.circuit]
        given += [f"--{name}" for name in ("thesis", "rest") if getattr(self, name)]
        if self.packs is not None and self.cells is not None:
            given.append(f"--segments={self.packs}x{self.cells}")
        names = ("rate", "hours", "soc", "spread", "temperature", "resistor")
        return given + [f"--{name}={getattr(self, name)}" for name in names if getattr(self, name) is not None]


class BalancingThesisOut(BaseModel):
    """What the balancing thesis has for it."""

    hours: float
    max_degc: float
    soc_difference_percent: float


class BalancingCircuitOut(BaseModel):
    """How it went; the curves have a value at each `time_h`, null after the end."""

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
    arguments = ["balance", *study.arguments()]
    if not _study_under_way.acquire(blocking=False):
        raise NotNow(Message("study-under-way"))
    try:
        study_result = json.loads(workers.run(LIMITS, output_of, [*arguments, "--json"]))
    except CommandRefused as error:
        raise _refused(str(error), study) from error
    finally:
        _study_under_way.release()
    circuits = study_result["circuits"]
    longest = max(run["course"]["time_h"][-1] for run in circuits.values())
    time_h = np.linspace(0.0, longest, MOST_POINTS)
    return {
        "command": " ".join(["voltwall", *arguments]),
        "time_h": time_h.tolist(),
        "circuits": [{"name": name, **run, **_curves(run["course"], time_h)} for name, run in circuits.items()],
    }


def _curves(course: dict[str, list[float]], time_h: np.ndarray) -> dict[str, list[float | None]]:
    times = course["time_h"]

    def at(values: list[float]) -> list[float | None]:
        found = np.interp(time_h, times, values)
        return [float(value) if t <= times[-1] else None for t, value in zip(time_h, found, strict=True)]

    spread = [high - low for low, high in zip(course["soc_min"], course["soc_max"], strict=True)]
    return {
        "soc_spread": at(spread),
        "temperature_max_degc": at(course["temperature_max_degc"]),
        "charger_a": at(course["charger_a"]),
    }


def _refused(words: str, study: StudyIn) -> Problem:
    """The command names the option, or the field of the study, and the limit."""
    found = re.search(r"argument --(\w+): (.*)", words) or re.search(r"balance: (.*?) = .*?: (.*)", words)
    field, limit = found.groups() if found else ("balance", words)
    return invalid(field, getattr(study, field, None), limit)
