"""Profiles inferred from a DBC and from a bus or a log (`battery learn` on a page), corrected line by line."""

import math
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from fastapi import APIRouter
from pydantic import BaseModel, Field

from app.api.schemas.snapshot import Number
from app.api.web.dependencies import ImportsPart, SetupPart, WorkersPart
from app.api.web.problems import invalid, not_found
from app.api.web.request_body import Body, FileText
from app.sessions.worker import DEFINITIONS, INSPECTION, Workers
from app.sources.dbc.check import ProfileIssue
from app.sources.dbc.frames import Frames, frames_of
from app.sources.dbc.infer.inference import InferredProfile
from app.sources.dbc.infer.lines import LINE_UNITS, UNITS, Candidate, Choice, ProfileLine, title
from app.sources.dbc.infer.profile_draft import (
    MOST_S,
    Correction,
    CurrentValue,
    ProfileDraft,
    draft_from_files,
)
from app.sources.dbc.infer.profile_text import profile_text
from app.sources.dbc.infer.proposal import CellProposal
from app.sources.dbc.infer.readings import ReadingProposal
from app.sources.dbc.infer.states import StateProposal
from app.sources.dbc.listening import BusListener
from app.words import Message, RenderedMessage, rendered

router = APIRouter(prefix="/setup", tags=["setup"])
_MOST_CELLS = 1000
Name = Annotated[str, Field(max_length=200)]


class InferredCandidateOut(BaseModel):
    """A signal that may carry what a line says, and what was received of it [in the line's unit]."""

    signal: str
    low: Number
    high: Number
    reasons: list[RenderedMessage]


class CurrentValueOut(BaseModel):
    """The present value of a line: one a cell or sensor, or one; of a state also its raw number and its meaning."""

    values: list[Number]
    age_s: Number
    raw: int | None
    text: str


class InferredLineOut(BaseModel):
    """One thing that the profile says: which of the candidates it is, whether it is taken, and what it reads."""

    key: str
    taken: bool
    signal: str
    candidates: list[InferredCandidateOut]
    display_unit: str
    unit: str
    units: list[str]
    positive: str | None
    equals: list[int] | None
    running: CurrentValueOut | None


class ProfileIssueOut(BaseModel):
    """A issue about the profile, or an error with which it cannot work."""

    field: str
    is_error: bool
    what: RenderedMessage


class InferredProfileOut(BaseModel):
    """A suggested profile; `profile` null where no cell voltages are recognised.

    A bus is recorded until every cell had its turn, at least 10 s: each correction is answered by all frames so far.
    """

    id: str
    is_recording: bool
    recorded_s: float
    most_s: float
    frames: int
    messages: int
    received: int
    cells: int
    segments: list[int]
    parallel: int
    sensors: int
    name: str
    lines: list[InferredLineOut]
    questions: list[RenderedMessage]
    checks: list[ProfileIssueOut]
    profile: str | None


class InferIn(Body):
    """DBCs as text by file name, and a bus or a log; without both only names speak."""

    files: dict[Annotated[str, Field(max_length=100)], FileText] = Field(min_length=1, max_length=20)
    can: str | None = Field(None, min_length=1, max_length=300)
    log: int | None = Field(None, description="the upload of a CAN log: POST /imports")
    bus: str = Field("", max_length=100, description="of the log, where an id is on several")
    seconds: float = Field(10.0, ge=0.5, le=60, description="until the first answer; the recording goes on")
    name: str = Field("", max_length=100)


class ChoiceIn(Body):
    """A person's correction of a line; what is not given is as suggested."""

    signal: Name = ""
    taken: bool | None = None
    unit: Annotated[str, Field(max_length=20)] = ""
    positive: Literal["", "discharge", "charge"] = ""
    equals: list[Annotated[int, Field(ge=0, lt=2**32)]] = Field(default_factory=list, max_length=64)


class CorrectionIn(Body):
    """All corrections so far; `profile`: the text as a person edited it, which is checked instead."""

    name: str = Field("", max_length=100)
    segments: list[Annotated[int, Field(ge=1, le=_MOST_CELLS)]] = Field(default_factory=list, max_length=_MOST_CELLS)
    parallel: int = Field(1, ge=1, le=1000)
    choices: dict[Name, ChoiceIn] = Field(default_factory=dict, max_length=40)
    profile: str | None = Field(None, max_length=200_000)
    stops: bool = Field(False, description="end the recording")


@router.post("/profile-drafts", response_model=InferredProfileOut)
def infer_profile_of(body: InferIn, setup: SetupPart, imports: ImportsPart, workers: WorkersPart) -> dict[str, Any]:
    """Listen, and suggest a profile with the reasons for each of its lines; a bus goes on to be received."""
    if body.can is not None and body.can == setup.in_force.can:
        raise invalid("can", body.can, Message("bus-is-read"))
    setup.end_draft()
    listener = None if body.can is None or body.log is not None else BusListener(body.can)
    received: Frames | Path = frames_of([]) if listener is None else listener.wait(body.seconds)
    limits = DEFINITIONS
    if body.log is not None:
        received, limits = imports.path_of(body.log), INSPECTION
    try:
        draft = workers.run(limits, draft_from_files, body.files, received, body.name, body.bus)
    except BaseException:
        if listener is not None:
            listener.close()
        raise
    draft.listener, draft.is_recording = listener, listener is not None
    return _draft_json(setup.begin_draft(draft), draft, Correction(), None, workers)


@router.post("/profile-drafts/{draft_id}", response_model=InferredProfileOut)
def correct_profile(draft_id: str, body: CorrectionIn, setup: SetupPart, workers: WorkersPart) -> dict[str, Any]:
    """The suggestion as corrected, its issues, and what each line reads now."""
    if setup.draft is None or setup.draft[0] != draft_id:
        raise not_found("profile-draft", draft_id)
    if sum(body.segments) > _MOST_CELLS:
        raise invalid("segments", body.segments, Message("kind-counts", bounds=f"1..{_MOST_CELLS}"))
    choices = {
        key: Choice(choice.signal, choice.taken, choice.unit, choice.positive, tuple(choice.equals))
        for key, choice in body.choices.items()
    }
    correction = Correction(body.name, tuple(body.segments), body.parallel, choices)
    draft = setup.draft[1]
    if draft.is_recording and draft.listener is not None:
        more = workers.run(INSPECTION, ProfileDraft.extended, draft, draft.listener.frames(), correction)
        more.listener, more.is_recording = (
            draft.listener,
            more.is_recording and not body.stops and draft.listener.is_open,
        )
        draft = setup.replace_draft(draft_id, more)
    return _draft_json(draft_id, draft, correction, body.profile, workers)


def _draft_json(
    draft_id: str, draft: ProfileDraft, correction: Correction, edited: str | None, workers: Workers
) -> dict[str, Any]:
    run = partial(workers.run, INSPECTION)
    inferred, issues = draft.inferred(correction, run)
    if edited is not None:
        issues = draft.check(edited, run)
    survey = draft.survey
    return {
        "id": draft_id,
        "is_recording": draft.is_recording,
        "recorded_s": round(draft.recorded_s, 1),
        "most_s": MOST_S,
        "frames": survey.n_frames,
        "messages": len(survey.definitions.messages),
        "received": len(survey.received),
        "checks": [*map(_checked, issues)],
        **(_nothing() if inferred is None else _inferred(inferred, draft.running(inferred))),
    }


def _nothing() -> dict[str, Any]:
    empty: dict[str, Any] = {"cells": 0, "segments": [], "parallel": 1, "sensors": 0, "name": "", "lines": []}
    return {**empty, "questions": [rendered(Message("infer-nothing"))], "profile": None}


def _inferred(inferred: InferredProfile, running: dict[str, CurrentValue]) -> dict[str, Any]:
    battery = inferred.battery
    return {
        "cells": battery.n_cells,
        "segments": battery.segments,
        "parallel": battery.parallel,
        "sensors": battery.n_sensors,
        "name": battery.name,
        "lines": [_line(line, running.get(key)) for key, line in inferred.lines.items()],
        "questions": [*map(rendered, inferred.questions)],
        "profile": profile_text(inferred),
    }


def _line(line: ProfileLine, running: CurrentValue | None) -> dict[str, Any]:
    chosen, kind = line.chosen, line.key.partition(".")[0]
    reading = chosen.reading if isinstance(chosen, ReadingProposal) else None
    unit = chosen.entries[0].unit if isinstance(chosen, CellProposal) else "" if reading is None else reading.unit
    return {
        "key": line.key,
        "taken": line.is_taken,
        "signal": title(chosen),
        "candidates": [
            _candidate(chosen if title(candidate) == title(chosen) else candidate) for candidate in line.candidates
        ],
        "display_unit": LINE_UNITS.get(kind, ""),
        "unit": unit,
        "units": UNITS.get(line.key, ()),
        "positive": reading.positive if reading is not None and "current" in line.key and kind != "limit" else None,
        "equals": list(chosen.state.equals) if isinstance(chosen, StateProposal) and not chosen.state.mask else None,
        "running": None
        if running is None
        else {"values": running.values, "age_s": running.age_s, "raw": running.raw, "text": running.text},
    }


def _candidate(candidate: Candidate) -> dict[str, Any]:
    low = high = math.nan
    if isinstance(candidate, ReadingProposal):
        low, high = candidate.low, candidate.high
    elif isinstance(candidate, CellProposal) and candidate.fit is not None:
        low, high = candidate.fit.low, candidate.fit.high
    span = {"low": low if math.isfinite(low) else None, "high": high if math.isfinite(high) else None}
    return {"signal": title(candidate), **span, "reasons": [*map(rendered, candidate.reasons)]}


def _checked(issue: ProfileIssue) -> dict[str, Any]:
    place = issue.field if issue.line is None else f"{issue.field}, {issue.line}"
    return {"field": place, "is_error": issue.is_error, "what": rendered(issue.what)}
