"""`battery learn` on a page: what speaks on a bus, and the profile that it suggests."""

import math
from collections.abc import Iterable
from typing import Annotated, Any

from fastapi import APIRouter
from pydantic import Field

from app.api.encoding.words import words
from app.api.schemas.setup import LearnedOut
from app.api.web.dependencies import SetupPart, WorkersPart
from app.api.web.problems import invalid
from app.api.web.request_body import Body
from app.sessions.worker import DEFINITIONS
from app.sources.dbc.frames import frames_of
from app.sources.dbc.learn.from_files import learn_from_files
from app.sources.dbc.learn.learning import Learned
from app.sources.dbc.learn.profile_text import profile_text
from app.sources.dbc.learn.proposal import CellProposal
from app.sources.dbc.listening import bus_frames
from app.words import Message, Text, render

router = APIRouter(prefix="/setup", tags=["setup"])
UNITS = {"current": "A", "pack_voltage": "V", "soc": ""}


class LearnIn(Body):
    """DBCs as text by file name, and the bus to listen to; without it only names speak."""

    files: dict[Annotated[str, Field(max_length=100)], str] = Field(min_length=1, max_length=20)
    can: str | None = Field(None, min_length=1, max_length=300)
    seconds: float = Field(10.0, ge=0.5, le=60)
    name: str = Field("", max_length=100)


@router.post("/learn", response_model=LearnedOut)
def learn_profile(body: LearnIn, setup: SetupPart, workers: WorkersPart) -> dict[str, Any]:
    """Listen, and suggest a profile with the reasons for each of its lines."""
    if body.can is not None and body.can == setup.in_force.can:
        raise invalid("can", body.can, Message("bus-is-read"))
    frames = frames_of([]) if body.can is None else bus_frames(body.can, body.seconds)
    messages, found, learned = workers.run(DEFINITIONS, learn_from_files, body.files, frames, body.name)
    return {
        "frames": found.n_frames,
        "messages": messages,
        "heard": len(found.heard),
        **(_nothing() if learned is None else _learned(learned)),
    }


def _nothing() -> dict[str, Any]:
    doubts = _texts("doubts", [Message("learn-nothing")])
    return {"cells": 0, "segments": [], "sensors": 0, "lines": [], **doubts, "profile": None}


def _learned(learned: Learned) -> dict[str, Any]:
    lines = [_cells("voltage", learned.voltage, "V")]
    if learned.temperature is not None:
        lines.append(_cells("temperature", learned.temperature, "degC"))
    for name, each in learned.readings.items():
        lines.append(_line(name, str(each.reading.signal), each.low, each.high, UNITS.get(name, ""), each.reasons))
    return {
        "cells": learned.battery.n_cells,
        "segments": learned.battery.segments,
        "sensors": learned.battery.n_sensors,
        "lines": lines,
        **_texts("doubts", learned.doubts),
        "profile": profile_text(learned),
    }


def _cells(what: str, proposal: CellProposal, unit: str) -> dict[str, Any]:
    low, high = (math.nan, math.nan) if proposal.fit is None else (proposal.fit.low, proposal.fit.high)
    return _line(what, proposal.entries[0].signal, low, high, unit, proposal.reasons)


def _line(what: str, signal: str, low: float, high: float, unit: str, reasons: Iterable[Text]) -> dict[str, Any]:
    span = {"low": low if math.isfinite(low) else None, "high": high if math.isfinite(high) else None}
    return {"what": what, "signal": signal, **span, "unit": unit, **_texts("reasons", reasons)}


def _texts(name: str, texts: Iterable[Text]) -> dict[str, Any]:
    found = list(texts)
    return {name: [render(each) for each in found], f"{name}_words": [words(each) for each in found]}
