"""The alarms that were open when the service last ran, in one file of the data folder: a restart ends none."""

import logging
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import orjson

from app.sources.data_file import checked, parse_object, replace_file
from app.telemetry import Alarm, TripCause
from app.telemetry.events import PossibleCause
from app.words import Pack, condition_of, message_from_json

_JUDGED = ("size", "low", "high", "unit", "since", "judged", "revised")
log = logging.getLogger(__name__)


def alarm_file(learned: str, *, is_simulated: bool) -> str:
    """Return the name of the file that belongs to a file of learned cells; a simulated car has its own."""
    return f"alarms-{'simulated-' if is_simulated else ''}{Path(learned).stem}.json"


def load_open_alarms(path: Path, n_cells: int, n_packs: int) -> tuple[Alarm, ...]:
    """Return what was saved of cells and packs that there are; nothing where it cannot be read (which is logged)."""
    if not path.is_file():
        return ()
    try:
        alarms = tuple(map(_alarm, parse_object(path.read_bytes())["alarms"]))
    except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
        log.warning("%s cannot be read and is ignored: %s", path, error)
        return ()
    return tuple(
        alarm
        for alarm in alarms
        if max((*alarm.cells, alarm.cell or 0)) < n_cells and max(_packs(alarm), default=0) < n_packs
    )


def _packs(alarm: Alarm) -> list[int]:
    """The packs that its message names."""
    packs = alarm.message.args.get("packs")
    named = (alarm.message.args.get("pack"), *(packs if isinstance(packs, tuple) else ()))
    return [argument.pack for argument in named if isinstance(argument, Pack)]


def save_open_alarms(path: Path, alarms: Iterable[Alarm]) -> None:
    """Replace the file as a whole; a full disk is logged and costs only this."""
    try:
        replace_file(
            path, orjson.dumps({"alarms": [asdict(alarm) for alarm in alarms]}, option=orjson.OPT_SERIALIZE_NUMPY)
        )
    except OSError as error:
        log.warning("%s was not saved: %s", path, error.strerror or error)


def _alarm(stored: dict[str, Any]) -> Alarm:
    cause = stored["cause"]
    changed = {
        "code": condition_of(stored["code"]),
        "message": message_from_json(stored["message"]),
        "cells": tuple(stored["cells"]),
        "cause": None
        if cause is None
        else TripCause(
            **_possible(cause) | {name: cause[name] for name in _JUDGED},
            others=tuple(PossibleCause(**_possible(other)) for other in cause["others"]),
        ),
    }
    return checked(Alarm(**stored | changed))


def _possible(stored: Mapping[str, Any]) -> dict[str, Any]:
    fields = {name: stored[name] for name in ("cell", "pack", "confidence")}
    return fields | {"code": condition_of(stored["code"]), "message": message_from_json(stored["message"])}
