"""The shape of a black box: what is stored, sent and drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from app.analysis.root_cause.judge import UNEXPLAINED, Cause, cause_from_json
from app.battery.shape import CELLS_PER_PACK, N_PACKS
from app.telemetry import Severity
from app.telemetry.cell_findings import Finding
from app.words import Cell, Message, Quantity, RenderedMessage, condition_of, rendered, rendered_from_json, sentence

Measured = Literal["voltage", "temperature", "current"]
Side = Literal["low", "high"]


@dataclass(frozen=True)
class BoxEvent:
    """One reported event; `t_s` counts from the trip."""

    t_s: float
    severity: Severity
    code: str
    message: RenderedMessage


@dataclass(frozen=True)
class Beyond:
    """The time that the value was beyond its limit; `since_s` None: never seen beyond it."""

    since_s: float | None
    lasted_s: float | None
    ended: bool | None
    worst: float


@dataclass(frozen=True)
class Peers:
    """The other cells at the trip; `apart`: this cell against their mean."""

    low: float
    mean: float
    high: float
    apart: float
    also_beyond: int


@dataclass(frozen=True)
class CellsAround:
    """Every cell before, at and during it; `opened_s`: when the shutdown circuit was seen open, from the trip."""

    voltage_before_v: list[float | None]
    voltage_at_v: list[float | None]
    voltage_min_v: list[float | None]
    voltage_max_v: list[float | None]
    temperature_at_degc: list[float | None]
    soc_at: list[float | None]
    current_at_trip_a: float | None
    opened_s: float | None


@dataclass(frozen=True)
class BoxSamples:
    """Everything at full rate; tables are cell by cell, `time_s` from the trip."""

    time_s: list[float | None]
    current_a: list[float | None]
    voltage_v: list[list[float | None]]
    temperature_degc: list[list[float | None]]
    soc: list[list[float | None]]
    fit: list[float | None]
    load: list[float | None]


@dataclass(frozen=True)
class BlackBox:
    """The record of a trip and its surroundings; times in seconds from it, `at` in unix seconds."""

    id: str
    session_id: str | None
    at: float
    code: str
    severity: Severity
    message: RenderedMessage
    cell: int | None
    value: float | None
    limit: float | None
    unit: str
    quantity: Measured | None
    side: Side | None
    config_hash: str | None
    limits: dict[str, float]
    events: list[BoxEvent]
    is_complete: bool
    rate_hz: float | None
    beyond: Beyond | None
    peers: Peers | None
    cells: CellsAround
    samples: BoxSamples
    findings: list[RenderedMessage]
    simulated: bool = False  # the car was the simulator
    cause: Cause | None = None  # None: nothing that can be explained, or not looked for yet
    segments: list[int] = field(
        default_factory=lambda: [CELLS_PER_PACK] * N_PACKS
    )  # cells of each; earlier versions kept none


def box_from_json(body: dict[str, Any]) -> BlackBox:
    """Return a stored black box.

    Raises:
        KeyError, TypeError: it is not one.
    """
    parts = {
        "events": [BoxEvent(**_named(event)) for event in body["events"]],
        "beyond": None if body["beyond"] is None else Beyond(**body["beyond"]),
        "peers": None if body["peers"] is None else Peers(**body["peers"]),
        "cells": CellsAround(**body["cells"]),
        "samples": BoxSamples(**body["samples"]),
        "findings": [rendered_from_json(finding) for finding in body.get("findings", [])],
        "cause": cause_from_json(body.get("cause")),
    }
    return BlackBox(**_named({name: value for name, value in body.items() if name != "summary"}) | parts)


def _named(body: dict[str, Any]) -> dict[str, Any]:
    """A stored box or event with its message; earlier versions kept `text`, and next to it `text_words` or no code."""
    body = dict(body)
    text, words = body.pop("text", None), body.pop("text_words", None)
    message = rendered(text) if words is None and text is not None else rendered_from_json(words or body["message"])
    return body | {"code": condition_of(body["code"]), "message": message}


def findings_of(box: BlackBox, findings: Sequence[Finding] = ()) -> list[RenderedMessage]:
    """Return what happened in a few sentences; `found`: what was known against cells then, its own cell first."""
    messages = [Message("box-event", event=box.message.message), *_beyond(box), *_peers(box)]
    own_first = sorted(findings, key=lambda finding: finding.cell != box.cell)
    messages += [Message("box-finding", finding=finding.message, evidence=finding.evidence) for finding in own_first]
    current_a, opened_s = box.cells.current_at_trip_a, box.cells.opened_s
    if current_a is not None:
        messages.append(Message("box-current", current=Quantity(current_a, "A", 1)))
    if opened_s is not None:
        time = Quantity(abs(opened_s), "s", 2)
        is_after = opened_s >= 0.0
        messages.append(Message("box-opened-after", time=time) if is_after else Message("box-opened-before", time=time))
    measured = (*box.cells.voltage_min_v, *box.cells.temperature_at_degc)
    if all(value is None for value in measured):
        messages.append(Message("box-no-cell"))
    if not box.is_complete:
        messages.append(Message("box-partial"))
    return [sentence(message, box.segments) for message in messages]


def cause_findings(cause: Cause | None, segments: Sequence[int]) -> list[RenderedMessage]:
    """Return the likeliest cause, its evidence, what cannot be distinguished from it, and what else it could be."""
    if cause is None:
        return []
    if cause.code == UNEXPLAINED:
        return [sentence(Message("box-no-cause"))]
    share = Quantity(100 * cause.confidence, "%", 0)
    messages = [Message("box-cause", cause=cause.message.message, share=share)]
    if cause.evidence:
        messages.append(Message("box-evidence", evidence=tuple(evidence.message for evidence in cause.evidence)))
    if cause.same:
        messages.append(Message("box-cause-same", causes=tuple(same.message for same in cause.same)))
    if cause.others:
        messages.append(Message("box-cause-others", causes=tuple(other.message.message for other in cause.others)))
    return [sentence(message, segments) for message in messages]


def _beyond(box: BlackBox) -> list[Message]:
    beyond = box.beyond
    if beyond is None:
        return []
    worst = Quantity(beyond.worst, box.unit)
    if beyond.since_s is None:
        return [Message("box-never-beyond", worst=worst)]
    what = Message("accumulator") if box.cell is None else Cell(box.cell)
    limit, lasted = Quantity(box.limit, box.unit), Quantity(beyond.lasted_s, "s", 1)
    if beyond.since_s >= 0.0:
        if beyond.ended:
            return [Message("box-beyond", what=what, limit=limit, lasted=lasted, worst=worst)]
        return [Message("box-still-beyond", what=what, limit=limit, lasted=lasted, worst=worst)]
    before = Quantity(-beyond.since_s, "s", 2)
    if beyond.ended:
        return [Message("box-beyond-before", what=what, limit=limit, lasted=lasted, before=before, worst=worst)]
    return [Message("box-still-beyond-before", what=what, limit=limit, lasted=lasted, before=before, worst=worst)]


def _peers(box: BlackBox) -> list[Message]:
    peers = box.peers
    if peers is None:
        return []
    low, mean, high, apart = (
        Quantity(value, box.unit, 3 if box.unit == "V" else 1)
        for value in (peers.low, peers.mean, peers.high, abs(peers.apart))
    )
    others = Message("box-others", n=peers.also_beyond) if peers.also_beyond else Message("box-no-other")
    if peers.apart >= 0.0:
        return [others, Message("box-peers-above", low=low, high=high, mean=mean, apart=apart)]
    return [others, Message("box-peers-below", low=low, high=high, mean=mean, apart=apart)]
