"""Accuracy of the product on data it was not made from: `python -m benchmarks.accuracy PART ... [--write]`.

    training  SOC on drives that the model was identified from
    drives    SOC on drives of shared data, each left out of its model
    races     SOC on second races of PyBaMM's cells
    voltage   the model's voltage on such drives, with the true SOC
    pack      96 cells of spread capacity, resistance and charge
    power     power for 10 and 30 s, against PyBaMM
    car       the simulated car, a minute after a start under load
    ahead     the voltage 10 s ahead under load, on drives of shared data
    predictions  power, times, energy and laps of the simulated car, against its own physics carried on

Sensor errors of a car, all four signs (`tests/numeric/judgement.py`). A part takes less than two minutes on two cores.
`races` and `power` read recordings that `python -m benchmarks.pybamm_recordings` makes once; missing ones are
named and their part is left out. With `--write` a part's table is put into docs/reference/accuracy.md.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

from benchmarks import accuracy_car as car
from benchmarks import accuracy_drives as drives
from benchmarks import accuracy_pack as pack
from benchmarks import accuracy_power as power
from benchmarks.pybamm_recordings import KEEP, OWN, missing
from tests.numeric import voltage_ahead
from tests.numeric.prediction_score import race_scores

DATA: Final = Path("../shared/data")
PAGE: Final = Path(__file__).parents[1] / "docs/reference/accuracy.md"
RACE, SEEDS, EVERY_S = "clean-endurance", (31, 32), 90.0  # for predictions
ROWS: Final = {"training": drives.training_rows, "drives": drives.held_out_rows, "races": drives.race_rows}


class Place(NamedTuple):
    """Folders of the recordings, and the number of processes."""

    data: Path
    keep: Path
    jobs: int

    @property
    def folders(self) -> drives.Folders:
        """Folders in which a recording is looked for."""
        return (*(self.data / name for name in drives.SHARED), self.keep)


class Part(NamedTuple):
    """A table: its head, the first cells of its rows as far as they are known beforehand, and what makes the rows."""

    header: str
    rows: Callable[[], list[str]]
    make: Callable[[Place], list[str]]


def judged(tests: drives.Tests, part: str, folders: drives.Folders) -> dict[int, str]:
    """Return the lines of the rows that share a model, by their place."""
    rows = [(k, row) for k, row in enumerate(ROWS[part]()) if row.tests == tests]
    return {k: drives.line(row, drives.judge(row, folders)) for k, row in rows}


def of_drives(part: str, place: Place) -> list[str]:
    """Return the rows of SOC."""
    every = list(dict.fromkeys(row.tests for row in ROWS[part]()))
    lines: dict[int, str] = {}
    with ProcessPoolExecutor(place.jobs) as pool:
        for of_part in pool.map(partial(judged, part=part, folders=place.folders), every):
            lines |= of_part
    return [lines[k] for k in sorted(lines)]


def of_voltage(place: Place) -> list[str]:
    """Return the rows of the model's voltage."""
    with ProcessPoolExecutor(place.jobs) as pool:
        columns = zip(*drives.voltage_rows(), strict=True)
        return list(pool.map(partial(drives.voltage_line, folders=place.folders), *columns))


def of_packs(place: Place) -> list[str]:
    """Return the rows of packs."""
    every = [(cell, sign) for cell in drives.PHYSICS_CELLS for sign in pack.SIGNS]
    with ProcessPoolExecutor(place.jobs) as pool:
        lines = list(pool.map(partial(pack.judge, folders=place.folders), *zip(*every, strict=True)))
    n = len(pack.SIGNS)
    return [pack.line(cell, lines[n * k : n * k + n]) for k, cell in enumerate(drives.PHYSICS_CELLS)]


def of_power(place: Place) -> list[str]:
    """Return the rows of power."""
    every = [(cell, source) for cell in OWN for source in power.DRIVES]
    with ProcessPoolExecutor(place.jobs) as pool:
        lines_of = list(pool.map(partial(power.judge, folder=place.keep), *zip(*every, strict=True)))
    return [line for lines in lines_of for line in lines]


def of_car(place: Place) -> list[str]:
    """Return the rows of the simulated car."""
    every = [(seed, start_s) for seed in car.SEEDS for start_s in car.STARTS_S]
    with ProcessPoolExecutor(place.jobs) as pool:
        return car.lines(list(pool.map(car.judge, *zip(*every, strict=True))))


def of_voltage_ahead(place: Place) -> list[str]:
    """Return the rows of the voltage ahead."""
    return [
        f"| {name} | {n:,} | {100 * inside:.0f} % | {1e3 * rms_v:.0f} mV | {1e3 * half_v:.0f} mV |"
        for name, (n, inside, _, rms_v, half_v) in voltage_ahead.drive_scores(place.data)
    ]


def of_predictions(place: Place) -> list[str]:
    """Return the rows of the simulated car's predictions."""
    with ProcessPoolExecutor(place.jobs) as pool:
        races = list(pool.map(partial(race_scores, RACE, every_s=EVERY_S), [[seed] for seed in SEEDS]))
    whole = races[0]
    for scores in races[1:]:
        for name, score in scores.items():
            for values in zip(score.low, score.middle, score.high, score.truth, strict=True):
                whole[name].add(*values)
    return [whole[name].line(name) for name in sorted(whole)]


PARTS: Final = {
    **{
        part: Part(drives.HEADER, partial(drives.first_of_rows, rows), partial(of_drives, part))
        for part, rows in ROWS.items()
    },
    "voltage": Part(
        drives.VOLTAGE_HEADER,
        lambda: [drives.voltage_first_of(*voltage_row[:2]) for voltage_row in drives.voltage_rows()],
        of_voltage,
    ),
    "pack": Part(pack.HEADER, lambda: [f"| {cell} |" for cell in drives.PHYSICS_CELLS], of_packs),
    "power": Part(power.HEADER, power.first_of_rows, of_power),
    "car": Part(car.HEADER, lambda: [f"| after {after_s:g} s |" for after_s in car.LATER_S], of_car),
    "ahead": Part(
        "| drive | rows | in band | RMS | band, half |\n| --- | --- | --- | --- | --- |", list, of_voltage_ahead
    ),
    "predictions": Part(
        "| prediction | moments | in band | below / above | median off | bias | band, half |\n"
        "| --- | --- | --- | --- | --- | --- | --- |",
        list,
        of_predictions,
    ),
}
KEPT: Final = ("races", "power")  # parts whose recordings are kept
SIMULATED: Final = ("car", "predictions")  # parts that read none


def absent(part: str, place: Place) -> str | None:
    """Return what a part needs and does not find."""
    if part in SIMULATED:
        return None
    if part in KEPT:
        how = "make them by `python -m benchmarks.pybamm_recordings`, which needs voltwall[pybamm]"
        lost = missing(place.keep)
        return f"{', '.join(lost)} in {place.keep} (--keep): {how}" if lost else None
    lost = [str(place.data / name) for name in drives.SHARED if not (place.data / name).is_dir()]
    return f"{', '.join(lost)} (--data)" if lost else None


def put(part: str, figures: str) -> None:
    """Write a part's table between its marks on the page."""
    begin, end = f"<!-- {part} -->", f"<!-- end of {part} -->"
    page = PAGE.read_text(encoding="utf-8")
    text, n = re.subn(f"{begin}.*?{end}", lambda _: f"{begin}\n{figures}\n{end}", page, flags=re.DOTALL)
    if n != 1:
        raise SystemExit(f"{PAGE}: {begin} ... {end} stands there {n} times, not once")
    PAGE.write_text(text, encoding="utf-8")


def main() -> int:
    """Print the tables; 1 where a part was left out."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", nargs="*", metavar="PART", help="default: all")
    parser.add_argument("--data", type=Path, default=DATA, help="the shared data (default: %(default)s)")
    parser.add_argument("--keep", type=Path, default=KEEP, help="PyBaMM's recordings (default: %(default)s)")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default: %(default)s)")
    parser.add_argument("--write", action="store_true", help=f"put the tables into {PAGE.name}")
    parser.add_argument("--rows", action="store_true", help="print heads and beginnings of the rows alone")
    args = parser.parse_args()
    place, status = Place(args.data, args.keep, args.jobs), 0
    if unknown := set(args.part) - set(PARTS):
        parser.error(f"{', '.join(unknown)}: no part; there are {', '.join(PARTS)}")
    for name in args.part or PARTS:
        part = PARTS[name]
        if args.rows:
            print("\n".join((f"<!-- {name} -->", part.header, *part.rows())))
            continue
        if lost := absent(name, place):
            print(f"{name}: left out, missing: {lost}")
            status = 1
            continue
        figures = "\n".join((part.header, *part.make(place)))
        print(figures, flush=True)
        if args.write:
            put(name, figures)
    return status


if __name__ == "__main__":
    raise SystemExit(main())
