"""How right estimates are on drives that a cell file was not made from: `python -m benchmarks.accuracy PART [--write]`.

    training  drives that the model was identified from
    drives    drives that it was identified without
    pack      96 cells of spread capacity, resistance and charge

Sensor errors of a car, all four signs (`tests/numeric/judgement.py`); RMSE in points of SOC, median / worst. Beside the
product's filter stands a textbook EKF on the same cell file. With `--write` the table is put into
docs/reference/accuracy.md.
"""

from __future__ import annotations

import argparse
import re
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Final

from benchmarks import accuracy_drives as drives
from benchmarks import accuracy_pack as pack

DATA: Final = Path("../shared/data")
PAGE: Final = Path(__file__).parents[1] / "docs/reference/accuracy.md"
ROWS: Final = {"training": drives.training_rows, "drives": drives.held_out_rows}
PARTS: Final = (*ROWS, "pack")


def judged(tests: drives.Tests, part: str, data: Path) -> dict[int, str]:
    """Return the lines of the rows that share a model, by their place."""
    rows = [(k, row) for k, row in enumerate(ROWS[part]()) if row.tests == tests]
    return {k: drives.line(row, drives.judge(row, data)) for k, row in rows}


def table(part: str, data: Path, jobs: int) -> str:
    """Return a table of drives."""
    every = list(dict.fromkeys(row.tests for row in ROWS[part]()))
    lines: dict[int, str] = {}
    with ProcessPoolExecutor(jobs) as pool:
        for found in pool.map(partial(judged, part=part, data=data), every):
            lines |= found
    return "\n".join((drives.HEADER, *(lines[k] for k in sorted(lines))))


def packs(data: Path, jobs: int) -> str:
    """Return the table of packs."""
    every = [(cell, sign) for cell in drives.PHYSICS_CELLS for sign in pack.SIGNS]
    with ProcessPoolExecutor(jobs) as pool:
        found = list(pool.map(partial(pack.judge, data=data), *zip(*every, strict=True)))
    lines = [
        pack.line(cell, [each for (of, _), each in zip(every, found, strict=True) if of == cell])
        for cell in drives.PHYSICS_CELLS
    ]
    return "\n".join((pack.HEADER, *lines))


def put(part: str, figures: str) -> None:
    """Write a part's figures between its marks on the page."""
    begin, end = f"<!-- {part} -->", f"<!-- end of {part} -->"
    page = PAGE.read_text(encoding="utf-8")
    found, n = re.subn(f"{begin}.*{end}", lambda _: f"{begin}\n{figures}\n{end}", page, flags=re.DOTALL)
    if n != 1:
        raise SystemExit(f"{PAGE}: {begin} ... {end} is there {n} times")
    PAGE.write_text(found, encoding="utf-8")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", nargs="*", choices=PARTS, help="default: all")
    parser.add_argument("--data", type=Path, default=DATA, help="the shared data (default: %(default)s)")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--write", action="store_true", help=f"put the tables into {PAGE.name}")
    args = parser.parse_args()
    for part in args.part or PARTS:
        figures = packs(args.data, args.jobs) if part == "pack" else table(part, args.data, args.jobs)
        print(figures, flush=True)
        if args.write:
            put(part, figures)


if __name__ == "__main__":
    main()
