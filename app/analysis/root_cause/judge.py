"""From suspicions to causes: what explains each trip, and what is wrong without one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from app.analysis.incidents import Trigger
from app.analysis.root_cause.recording import Suspicion, pack_of

LATE_S: Final = 1.5  # what is seen first after a trip may have been there before it
ENOUGH: Final = 6.0  # log odds from which a suspicion without a trip is told
SURE_WHEN_EMPTY: Final = 40.0
CONFIDENT: Final = 0.99
TEMPER: Final = 4.0  # the odds are products of models; this much of them is believed
MOST_OTHERS: Final = 4
LEAST_OTHER: Final = 0.02

_CELL = (
    "joint-resistance-high",
    "cell-resistance-high",
    "capacity-low",
    "self-discharge-high",
    "cell-imbalance",
    "cell-voltage-stuck",
    "cell-voltage-noisy",
)
_BOARD = ("isospi-noise", "slave-reference-drift", "slave-adc-fault", "slave-multiplexer-fault", "slave-lost")
_SENSORS = ("temperature-sensor-fault", "external-heating", "temperature-sensor-open", "sense-wire-open")
_LOST = ("sense-wire-open", "temperature-sensor-open", *_BOARD)
_WARM = (
    "external-heating",
    "self-discharge-high",
    "joint-resistance-high",
    "cell-resistance-high",
    "temperature-sensor-fault",
    "cooling-failed",
    "ambient-temperature",
    "accumulator-hot",
)
EXPLAINS: Final[dict[str, tuple[str, ...]]] = {
    "cell-undervoltage": (
        *_CELL,
        *_BOARD,
        "sense-wire-open",
        "accumulator-empty",
        "accumulator-cold",
        "ambient-temperature",
    ),
    "cell-overvoltage": (*_CELL, *_BOARD, "sense-wire-open"),  # a loose input reads high or low until its test finds it
    "cell-overtemperature": (*_WARM, *_LOST),
    "cell-undertemperature": ("accumulator-cold", "ambient-temperature", "temperature-sensor-fault", *_LOST),
    "discharge-overcurrent": ("overload", "current-sensor-offset", "current-sensor-open"),
    "charge-overcurrent": ("overload", "current-sensor-offset", "current-sensor-open"),
    "slave-lost": _BOARD,
    "sensor-lost": (*_LOST, "current-sensor-open", "temperature-sensor-fault"),
}
# A code that stands for several things of which the recording holds the same; why: docs/reference/causes.md
SAME: Final[dict[str, tuple[str, ...]]] = {
    "contactors-not-closed": ("precharge-failed", "external-shutdown", "hv-not-switched-on"),
    "can-silent": ("can-short", "can-adapter-off"),
    "can-master-silent": ("can-short", "can-master-bus-off", "can-adapter-off"),
}
# What follows from another cause when both are seen: the first is told, the second is not
_CAN: Final = ("can-silent", "can-master-bus-off", "can-master-silent")
_RESTART: Final = (
    "external-shutdown",
    "serial-silent",
    "can-master-silent",
    "can-master-bus-off",
    "charger-silent",
)
FOLLOWS: Final[dict[str, tuple[str, ...]]] = {
    "can-babbling-node": ("charger-silent", *_CAN, "can-noise"),
    "can-silent": ("charger-silent", "can-noise"),
    "can-master-bus-off": ("charger-silent",),
    "can-master-silent": ("charger-silent",),
    "can-noise": ("charger-silent",),
    "serial-silent": ("can-master-silent",),
    "serial-noise": ("serial-silent",),  # so much noise that no frame is left
    "master-watchdog-reset": _RESTART,
    "master-supply-lost": _RESTART,
    "isospi-noise": (
        *("slave-lost", "cell-voltage-noisy", "temperature-sensor-open", "temperature-sensor-fault"),
        "sense-wire-open",
    ),
    "slave-adc-fault": (*_CELL, *_SENSORS),
    "slave-multiplexer-fault": (*_CELL, *_SENSORS),
    "slave-reference-drift": (*_CELL, *_SENSORS),
    "slave-lost": (*_CELL, *_SENSORS),
    "sense-wire-open": (*_CELL, *(code for code in _SENSORS if code != "sense-wire-open")),
    "current-sensor-open": ("current-sensor-offset", "overload"),
    "current-sensor-offset": _CELL,
    "ambient-temperature": ("external-heating", "cooling-failed", "accumulator-hot", "accumulator-cold"),
    "cooling-failed": ("accumulator-hot", "self-discharge-high"),
}


@dataclass(frozen=True)
class Judgement:
    """One thing that happened and what explains it, the likeliest first; `trip` None: it tripped nothing."""

    at_s: float
    trip: Trigger | None
    ranked: tuple[Suspicion, ...]
    confidence: tuple[float, ...]


def trip_kind(code: str) -> str | None:
    """What a trip is about; None for one that only repeats another."""
    condition = code.removeprefix("trip-")
    return condition if condition in EXPLAINS else None


def judge(trips: Sequence[Trigger], suspicions: Iterable[Suspicion], segments: Sequence[int]) -> list[Judgement]:
    """Return what explains each trip, then what is wrong without having tripped anything; trips in order.

    `segments` are the cells of each pack.
    """
    placed = (each if each.cell is None else replace(each, pack=pack_of(each.cell, segments)) for each in suspicions)
    left = _without_consequences(_strongest_each(placed))
    found: list[Judgement] = []
    explained: set[int | None] = set()  # cells of which it is known what they have
    used: set[tuple[str, int | None, int | None]] = set()
    for trip in trips:
        kind = trip_kind(trip.code)
        if kind is None:
            continue
        able = [each for each in left if each.code in EXPLAINS.get(kind, ()) and each.at_s <= trip.at_s + LATE_S]
        pack = pack_of(trip.cell, segments)
        named = [each for each in able if _fits_place(each, trip.cell, pack)]
        ranked = _ranked(named or [each for each in able if pack is None or each.pack in (None, pack)])
        found.append(Judgement(trip.at_s, trip, ranked, confidences(ranked)))
        used |= {_key(each) for each in ranked}
        explained |= {each.cell for each in ranked[:1]} - {None}
    rest = [each for each in left if _key(each) not in used and each.weight >= ENOUGH and each.cell not in explained]
    if any(
        each.ranked and each.ranked[0].code == "accumulator-empty" for each in found
    ):  # then small differences are large
        rest = [each for each in rest if each.code not in _CELL or each.weight >= SURE_WHEN_EMPTY]
    for group in _places(rest):
        ranked = _ranked(group)
        found.append(Judgement(ranked[0].at_s, None, ranked, confidences(ranked)))
    return found


def _key(each: Suspicion) -> tuple[str, int | None, int | None]:
    return each.code, *each.place


def _strongest_each(suspicions: Iterable[Suspicion]) -> list[Suspicion]:
    best: dict[tuple[str, int | None, int | None], Suspicion] = {}
    for each in suspicions:
        if _key(each) not in best or each.weight > best[_key(each)].weight:
            best[_key(each)] = each
    return list(best.values())


def _without_consequences(found: list[Suspicion]) -> list[Suspicion]:
    def follows(each: Suspicion) -> bool:
        return any(
            each.code in FOLLOWS.get(other.code, ())
            and (other.place[1] is None or each.place[1] in (None, other.place[1]))
            for other in found
        )

    return [each for each in found if not follows(each)]


def _fits_place(each: Suspicion, cell: int | None, pack: int | None) -> bool:
    """The suspicion is about the cell that tripped, or about its pack, or about no place."""
    if cell is None or each.pack is None:
        return True
    return each.cell == cell if each.cell is not None else each.pack == pack


def _places(rest: list[Suspicion]) -> list[list[Suspicion]]:
    """Suspicions of one place explain the same; the strongest place first."""
    groups: dict[object, list[Suspicion]] = {}
    for each in rest:
        key: object = each.place if each.cell is not None else (each.code, each.place)
        groups.setdefault(key, []).append(each)
    return sorted(groups.values(), key=lambda group: -max(each.weight for each in group))


def _ranked(found: Sequence[Suspicion]) -> tuple[Suspicion, ...]:
    return tuple(sorted(found, key=lambda each: -each.weight))


def confidences(ranked: Sequence[Suspicion]) -> tuple[float, ...]:
    """Return the probability of each suspicion beside the others and beside none of them."""
    if not ranked:
        return ()
    odds = np.array([each.weight for each in ranked] + [0.0]) / TEMPER
    share = np.exp(odds - odds.max())
    return tuple(float(min(each, CONFIDENT)) for each in (share / share.sum())[:-1])
