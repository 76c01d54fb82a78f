"""What the product itself says of a bad day, put as an answer: the cause it names, else what its events mean."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from app.analysis.drill.days import CHOICES
from app.analysis.drill.score import Answer
from app.battery.shape import CELLS_PER_PACK
from app.words import Message

MEANS: Final = {  # the first of these that was told counts
    "finding-joint-grown": "loose-joint",
    "finding-cell-leaks": "internal-short",
    "finding-resistance-grown": "high-resistance",
    "finding-thermistor-off": "stuck-temperature",
    "finding-channel-stuck": "stuck-sensor",
    "boot": "reset",
    "charger-hardware": "charger-broken",
    "charger-over-temperature": "charger-hot",
    "charger-input-voltage": "charger-no-mains",
    "charger-battery": "charger-reversed",
    "trip-slave-lost": "lost-slave",
    "trip-sensor-lost": "open-wire",
    "trip-t-max": "hot-cell",
    "trip-t-min": "stuck-temperature",
    "trip-v-max": "stuck-sensor",
    "trip-v-min": "stuck-sensor",
    "trip-i-disc": "current-offset",
    "joint-loose": "loose-joint",
    "resistance-grown": "high-resistance",
    "slave-missing": "lost-slave",
    "cell-missing": "open-wire",
    "cell-hot": "hot-cell",
    "can-rx-timeout": "charger-silent",
    "can-silent": "can-broken",
    "rs232-lost": "serial-noise",
    "rs232-silent": "serial-noise",
}


TRIP_CAUSE: Final = "trip-cause"  # the event that names what root-cause analysis found
CAUSES: Final = {  # a cause that root-cause analysis names, as the fault that makes it
    "weak-joint": "loose-joint",
    "high-resistance": "high-resistance",
    "leaking-cell": "internal-short",
    "heated-cell": "hot-cell",
    "voltage-input-stuck": "stuck-sensor",
    "voltage-input-noisy": "noisy-sensor",
    "broken-wire": "open-wire",
    "temperature-stuck": "stuck-temperature",
    "temperature-unplugged": "temperature-unplugged",
    "current-sensor-offset": "current-offset",
    "current-sensor-unplugged": "current-unplugged",
    "slave-lost": "lost-slave",
    "slave-line-disturbed": "isospi-noise",
    "converter-broken": "broken-converter",
    "reference-drifted": "drifting-reference",
    "multiplexer-failed": "multiplexer-failed",
    "shutdown-opened": "shutdown-open",
    "master-reset": "reset",
    "master-power-lost": "reset",
    "serial-disturbed": "serial-noise",
    "can-master-off": "can-bus-off",
    "can-master-silent": "can-bus-off",
    "can-silent": "can-broken",
    "can-flooded": "can-babble",
    "charger-hot": "charger-hot",
    "charger-no-mains": "charger-no-mains",
    "charger-reversed": "charger-reversed",
    "charger-broken": "charger-broken",
    "charger-silent": "charger-silent",
}


def reports_fault(severity: str, code: str) -> bool:
    """Return whether an event tells of something wrong."""
    return (
        severity != "info" or code in ("boot", TRIP_CAUSE) or (code.startswith("finding-") and code != "finding-ended")
    )


def answer_of_cause(code: str, cell: int | None, pack: int | None) -> Answer | None:
    """Return what a named cause means; cell and pack from 0. None for one that no fault of a drill makes."""
    fault = CAUSES.get(code)
    return None if fault is None else answer_at(fault, cell, pack)


def answer_of_message(message: Message, cell: int | None) -> Answer | None:
    """Return what the message of a trip's cause means; None where it names nothing that a drill has."""
    pack = message.args.get("pack")
    if found := answer_of_cause(message.code.removeprefix("cause-"), cell, pack - 1 if isinstance(pack, int) else None):
        return found
    for inner in message.args.values():
        if isinstance(inner, Message) and (found := answer_of_message(inner, cell)):
            return found if pack is None or found.pack is not None else Answer(found.fault, int(str(pack)))
    return None


def answer_of_events(events: Iterable[tuple[str, int | None]]) -> Answer | None:
    """Return what events mean; each is (code, cell's index or None). None where they name nothing."""
    cell_by_code: dict[str, int | None] = {}
    for code, cell in events:
        cell_by_code.setdefault(code, cell)
    for code, fault in MEANS.items():
        if code in cell_by_code:
            cell = cell_by_code[code]
            if code == "trip-sensor-lost" and cell is None:
                return Answer("current-unplugged")
            return answer_at(fault, cell)
    return None


def answer_at(fault: str, cell: int | None, pack: int | None = None) -> Answer:
    """Return an answer at a cell or a pack by its index, with as much of a place as the fault has."""
    target = CHOICES.get(fault, "none")
    if target == "none" or (cell is None and pack is None):
        return Answer(fault)
    number = (cell // CELLS_PER_PACK if cell is not None else pack or 0) + 1
    return Answer(fault, number, cell % CELLS_PER_PACK + 1 if target == "cell" and cell is not None else None)
