"""Bad days without names: a fault of the simulator with a random place, size and time, as a scenario to play."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal, get_args

from app.battery.shape import CELLS_PER_PACK, N_PACKS

DAYS: Final = 10
FIRST_S, LAST_S = 25.0, 60.0  # when the fault comes
CHARGE: Final = "charge-by-hand"
Target = Literal["cell", "pack", "none"]
Kind = Literal["car", "bus", "charger"]
Draw = Callable[[random.Random], float | None]


@dataclass(frozen=True, slots=True)
class Puzzle:
    """A fault that a day may have; `lasts_s` is how long it takes to show enough.

    `kind` is what the day is about: ten days have at least one of each.
    """

    fault: str
    target: Target
    value: Draw
    load: str = "endurance"
    lasts_s: float = 60.0
    kind: Kind = "car"


@dataclass(frozen=True, slots=True)
class Day:
    """One bad day; pack and cell as people count them, None where the fault has no such place."""

    number: int
    fault: str
    pack: int | None
    cell: int | None
    value: float | None
    at_s: float  # after the start
    length_s: float
    scenario: str  # TOML, for the simulator
    kind: Kind = "car"


def _nothing(_: random.Random) -> None:
    return None


def _log(low: float, high: float) -> Draw:
    return lambda rng: math.exp(rng.uniform(math.log(low), math.log(high)))


def _either(*ranges: tuple[float, float]) -> Draw:
    return lambda rng: rng.uniform(*rng.choice(ranges))


def _bit(rng: random.Random) -> float:
    return float(rng.randint(6, 13))


POOL: Final = (
    Puzzle("open-wire", "cell", _nothing),
    Puzzle("stuck-sensor", "cell", _either((0.5, 2.2), (4.4, 5.0))),
    Puzzle("noisy-sensor", "cell", _log(0.05, 0.4)),
    Puzzle("stuck-temperature", "cell", _either((-40, 0), (50, 110))),
    Puzzle("temperature-unplugged", "cell", _nothing),
    Puzzle("loose-joint", "cell", _log(2, 20), lasts_s=90),
    Puzzle("high-resistance", "cell", _log(2.5, 8), lasts_s=120),
    Puzzle("internal-short", "cell", _log(12, 45), lasts_s=150),
    Puzzle("hot-cell", "cell", _log(80, 400), lasts_s=120),
    Puzzle("lost-slave", "pack", _nothing),
    Puzzle("broken-converter", "pack", _bit),
    Puzzle("drifting-reference", "pack", _either((-6, -2), (2, 6))),
    Puzzle("multiplexer-failed", "pack", _nothing),
    Puzzle("isospi-noise", "none", _log(5e-4, 1e-2)),
    Puzzle("current-unplugged", "none", _nothing),
    Puzzle("current-offset", "none", _either((-60, -10), (10, 60)), load="idle", lasts_s=90),
    Puzzle("shutdown-open", "none", _nothing),
    Puzzle("reset", "none", _log(0.2, 3)),
    Puzzle("serial-noise", "none", _log(5e-3, 5e-2)),
    # a bus on which nobody talks but the master shows less: while charging the charger is heard, too
    Puzzle("can-bus-off", "none", _nothing, CHARGE, 25, "bus"),
    Puzzle("can-broken", "none", _nothing, CHARGE, 25, "bus"),
    Puzzle("can-babble", "none", _either((0.7, 0.95)), CHARGE, 15, "bus"),
    Puzzle("charger-hot", "none", _either((4500, 5000)), CHARGE, 180, "charger"),
    Puzzle("charger-no-mains", "none", _nothing, CHARGE, 25, "charger"),
    Puzzle("charger-reversed", "none", _nothing, CHARGE, 25, "charger"),
    Puzzle("charger-broken", "none", _nothing, CHARGE, 25, "charger"),
    Puzzle("charger-silent", "none", _nothing, CHARGE, 25, "charger"),
)
CHOICES: Final[dict[str, Target]] = {puzzle.fault: puzzle.target for puzzle in POOL}


def draw_days(seed: int, n: int = DAYS) -> list[Day]:
    """Return n days, no fault twice; the same seed gives the same days.

    Args:
        seed: of the draw, 0 or more.
        n: 1 to the number of faults there are.

    Raises:
        ValueError: there are not so many faults.
    """
    if not 1 <= n <= len(POOL):
        raise ValueError(f"n = {n}: 1..{len(POOL)}")
    rng = random.Random(seed)
    return [_day(number, puzzle, rng) for number, puzzle in enumerate(_drawn(rng, n), 1)]


def _drawn(rng: random.Random, n: int) -> list[Puzzle]:
    """Return n faults in any order, of each kind at least one where there are so many days."""
    drawn = rng.sample(POOL, n)
    for kind in get_args(Kind):
        if n >= DAYS and all(puzzle.kind != kind for puzzle in drawn):
            many = [k for k, puzzle in enumerate(drawn) if sum(other.kind == puzzle.kind for other in drawn) > 1]
            drawn[rng.choice(many)] = rng.choice([puzzle for puzzle in POOL if puzzle.kind == kind])
    return drawn


def _day(number: int, puzzle: Puzzle, rng: random.Random) -> Day:
    pack = None if puzzle.target == "none" else rng.randint(1, N_PACKS)
    cell = rng.randint(1, CELLS_PER_PACK) if puzzle.target == "cell" else None
    drawn = puzzle.value(rng)
    value = None if drawn is None else float(f"{drawn:.3g}")
    at_s = round(rng.uniform(FIRST_S, LAST_S), 1)
    length_s = at_s + puzzle.lasts_s
    place = {"pack": pack, "cell": cell, "value": value}
    lines = [
        'title = "A day"',
        'description = "What goes wrong is not told."',
        f"seed = {rng.randint(1, 10_000)}",
        "[start]",
        f"soc = {rng.uniform(0.55, 0.85) if puzzle.load != CHARGE else rng.uniform(0.4, 0.6):.2f}",
        f"ambient_degc = {rng.randint(16, 30)}",
        "[[phase]]",
        f'load = "{puzzle.load}"',
        f"for_s = {length_s:.1f}",
        "[[phase]]",  # a crew that needs longer looks at a car that stands
        'load = "idle"',
        "for_s = 100000",
        "[[fault]]",
        f"at_s = {at_s}",
        f'name = "{puzzle.fault}"',
        *(f"{key} = {number}" for key, number in place.items() if number is not None),
    ]
    if puzzle.load == CHARGE:
        lines += ["[[action]]", "at_s = 5", 'name = "charge-start"']
    return Day(number, puzzle.fault, pack, cell, value, at_s, length_s, "\n".join(lines) + "\n", puzzle.kind)
