"""First steps: what to read, without a terminal."""

import time
from dataclasses import asdict
from typing import Annotated, Any

from fastapi import APIRouter
from pydantic import BaseModel, Field

from app.api.web.dependencies import EventsPart, LivePart, SetupPart, SignedPart, UserDep
from app.api.web.problems import invalid
from app.api.web.request_body import Body, FileText
from app.battery.shape import TEAM_PROFILE
from app.sources.connections import BATTERIES, Connections, Setup
from app.sources.dbc.parts import bundled_parts
from app.sources.link_check.can_check import LISTEN_ONLY, check_can, is_same_bus
from app.sources.link_check.plugged import Plugged, can_adapters, serial_ports
from app.sources.link_check.result import CHECK_S, LinkCheck
from app.sources.link_check.serial_check import check_serial
from app.telemetry.events import LinkName
from app.words import Message, RenderedMessage, Text, rendered_or_none

router = APIRouter(prefix="/setup", tags=["setup"])
Url = Annotated[str | None, Field(min_length=1, max_length=300)]


class ConnectionsOut(BaseModel):
    """The connection that is read; with neither link the battery is simulated."""

    serial: str | None
    can: str | None
    battery: str


class FoundOut(BaseModel):
    """A port or an adapter, by the URL that the choice takes; empty: it does not report that."""

    url: str
    description: str
    usb_id: str
    driver: str
    bit_rate: int | None
    is_up: bool
    listens_only: bool


class BatteryChoiceOut(BaseModel):
    """A battery that can be chosen by its id."""

    id: str
    name: str
    cells: int
    reads: str  # master or dbc
    uploaded: bool


class SetupOut(BaseModel):
    """`instance` is another one after each start; `fixed`: command line or environment say what is read."""

    instance: str
    needed: bool
    fixed: bool
    chosen: ConnectionsOut | None
    in_force: ConnectionsOut
    batteries: list[BatteryChoiceOut]


class ChosenConnectionsOut(SetupOut):
    """`restarts` is false where the service reads just that already."""

    restarts: bool


class PluggedOut(BaseModel):
    """Adapters plugged into the machine of the service."""

    serial: list[FoundOut]
    can: list[FoundOut]


class TrialOut(BaseModel):
    """Result at one setting of the port or one bit rate; `battery` where another one was awaited."""

    setting: str
    bytes: int
    frames: int
    errors: int | None
    battery: str | None


class RecognisedOut(BaseModel):
    """A battery, or a part of one, whose messages were received."""

    id: str
    name: str
    is_part: bool


class LinkCheckOut(BaseModel):
    """Result of a link check, and the remedy where something is not right; `url` has the bit rate that gave frames."""

    url: str
    seconds: float
    bytes: int
    frames: int
    rate_hz: float
    error: RenderedMessage | None
    advice: RenderedMessage | None
    trials: list[TrialOut]
    recognised: list[RecognisedOut]
    has_checksum: bool | None


class UploadedOut(BaseModel):
    """The id by which an uploaded battery can be chosen."""

    id: str


class ConnectionsIn(Body):
    """The connection to read; without a link the battery is simulated."""

    serial: Url = None
    can: Url = None
    battery: Url = None


class LinkCheckIn(Body):
    """One of the two, and the battery that is on it; None: the one that is read."""

    serial: Url = None
    can: Url = None
    battery: str | None = Field(default=None, max_length=1000)
    is_alone: bool = Field(default=False, description="only the battery is on the bus: acknowledge its frames")


class UploadIn(Body):
    """A profile and the DBCs that it names, as text by file name."""

    files: dict[Annotated[str, Field(max_length=100)], FileText] = Field(max_length=20)


def _setup_json(setup: Setup) -> dict[str, Any]:
    return {
        "instance": setup.instance,
        "needed": setup.is_needed,
        "fixed": setup.fixed,
        "chosen": None if setup.chosen is None else asdict(setup.chosen),
        "in_force": asdict(setup.in_force),
        "batteries": [
            {
                "id": name,
                "name": battery.battery.name,
                "cells": battery.battery.n_cells,
                "reads": battery.kind,
                "uploaded": BATTERIES in name,
            }
            for name, battery in setup.batteries().items()
        ],
    }


@router.get("", response_model=SetupOut)
def setup(setup: SetupPart) -> dict[str, Any]:
    """Return the chosen connection, the one read now, and the batteries that can be chosen."""
    return _setup_json(setup)


@router.get("/plugged", response_model=PluggedOut)
def plugged() -> dict[str, Any]:
    """Serial ports and CAN adapters of this machine; drivers take some seconds to look."""
    return {"serial": [*map(_plugged_json, serial_ports())], "can": [*map(_plugged_json, can_adapters())]}


def _plugged_json(plugged: Plugged) -> dict[str, Any]:
    return asdict(plugged) | {"listens_only": plugged.url.partition(":")[0] in LISTEN_ONLY}


@router.post("/check-link", response_model=LinkCheckOut)
def check_link(body: LinkCheckIn, setup: SetupPart, live: LivePart) -> dict[str, Any]:
    """Open a port or a bus for a moment and count what arrives; of one that is read already, what its link counts."""
    if (body.serial is None) == (body.can is None):
        raise invalid("serial", body.serial, Message("one-of-two", names=("serial", "can")))
    in_force, batteries = setup.in_force, setup.batteries()
    parts = bundled_parts()
    if body.serial is not None and body.serial == in_force.serial:
        check = _at_own(live, "rs232", body.serial)
    elif body.can is not None and is_same_bus(body.can, in_force.can):
        check = _at_own(live, "can", body.can)
    elif body.can is not None:
        setup.end_draft()  # it may have the adapter open
        carried = {name: battery.definitions for name, battery in batteries.items() if battery.kind == "dbc"}
        check = check_can(body.can, {**carried, **parts}, is_alone=body.is_alone)
    else:
        battery = batteries.get(body.battery or in_force.battery)
        others = {name: other.serial for name, other in batteries.items() if other.kind in ("serial", "master")}
        check = check_serial(body.serial or "", None if battery is None else battery.serial, others)
    recognised = [
        {"id": name, "name": batteries[name].battery.name if name in batteries else name, "is_part": name in parts}
        for name in check.batteries
    ]
    return {
        "url": check.url,
        "seconds": round(check.seconds, 1),
        "bytes": check.bytes,
        "frames": check.frames,
        "rate_hz": check.rate_hz,
        "error": rendered_or_none(check.error),
        "advice": rendered_or_none(check.advice),
        "trials": [asdict(trial) for trial in check.trials],
        "recognised": recognised,
        "has_checksum": check.has_checksum,
    }


def _at_own(live: LivePart, name: LinkName, url: str) -> LinkCheck:
    """What the link of the service counts meanwhile: two readers would each get half of the bytes."""

    def counted() -> tuple[int, int, Text | None]:
        if live.snapshot is None:
            return 0, 0, None
        link = live.snapshot.links.rs232 if name == "rs232" else live.snapshot.links.can
        return link.bytes, link.frames, link.error

    before = counted()
    time.sleep(CHECK_S)
    after = counted()
    frames = after[1] - before[1]
    silent = Message("advice-silent") if name == "rs232" else Message("advice-can-silent")
    return LinkCheck(url, CHECK_S, after[0] - before[0], frames, after[2], None if frames else silent)


@router.put("", status_code=202, response_model=ChosenConnectionsOut)
def choose(
    body: ConnectionsIn, setup: SetupPart, events: EventsPart, signed: SignedPart, user: UserDep
) -> dict[str, Any]:
    """Keep what to read in the data folder and start again with it; what is read already runs on."""
    chosen = Connections(body.serial, body.can, body.battery or TEAM_PROFILE)
    what = ", ".join(setting for setting in (chosen.battery, chosen.serial, chosen.can) if setting) or "simulator"
    with signed.signed(user.name, "setup", what):
        restarts = setup.choose(chosen)
    events.note("info", "connections-chosen", Message("connections-chosen", what=what), who=user.name)
    return _setup_json(setup) | {"restarts": restarts}


@router.post("/batteries", status_code=201, response_model=UploadedOut)
def upload(body: UploadIn, setup: SetupPart) -> dict[str, Any]:
    """Keep a profile and its DBCs in the data folder."""
    files = {name: text.encode() for name, text in body.files.items()}
    return {"id": setup.upload(files)}
