"""The shape of a black box: what is stored, sent and drawn."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from app.analysis.root_cause.cause import Cause, cause_from_json
from app.battery.shape import CELLS_PER_PACK, N_PACKS
from app.telemetry import Severity
from app.words import RenderedMessage, condition_of, rendered, rendered_from_json

Quantity = Literal["voltage", "temperature", "current"]
Side = Literal["low", "high"]


@dataclass(frozen=True)
class BoxEvent:
    """What was reported; `t_s` from the trip."""

    t_s: float
    severity: Severity
    code: str
    message: RenderedMessage


@dataclass(frozen=True)
class Beyond:
    """How long the value was beyond its limit; `since_s` None: never seen beyond it."""

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
class Samples:
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
    """What happened around a trip; times in seconds from it, `at` in unix seconds."""

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
    quantity: Quantity | None
    side: Side | None
    config_hash: str | None
    limits: dict[str, float]
    events: list[BoxEvent]
    is_complete: bool
    rate_hz: float | None
    beyond: Beyond | None
    peers: Peers | None
    cells: CellsAround
    samples: Samples
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
        "samples": Samples(**body["samples"]),
        "findings": [rendered_from_json(found) for found in body.get("findings", [])],
        "cause": cause_from_json(body.get("cause")),
    }
    return BlackBox(**_named({name: value for name, value in body.items() if name != "summary"}) | parts)


def _named(body: dict[str, Any]) -> dict[str, Any]:
    """A stored box or event with its message; earlier versions kept `text`, and next to it `text_words` or no code."""
    body = dict(body)
    text, words = body.pop("text", None), body.pop("text_words", None)
    message = rendered(text) if words is None and text is not None else rendered_from_json(words or body["message"])
    return body | {"code": condition_of(body["code"]), "message": message}
