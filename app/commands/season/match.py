"""`voltwall season match` and `without`: build packs from measured cells; a string without a module."""

import argparse
import csv
import json
import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np

from app.commands.season.kept import kept_season
from app.commands.session_commands.analysis import short_place
from app.commands.session_commands.passport import cell_index
from app.errors import ConfigError
from app.estimation.arrays import FloatArray
from app.season.matching.groups import RANDOM_BUILDS, Build, match_groups, random_groups, sorted_groups
from app.season.matching.places import Placing, place, without
from app.season.modules import Modules, modules_of
from app.sessions.export.csv_row import csv_row

COLUMNS = ("cell", "capacity_ah", "resistance_ohm")


def read_cells(path: Path) -> tuple[list[str], FloatArray, FloatArray]:
    """Return names, capacities [Ah] and resistances [ohm] of a table.

    Raises:
        ConfigError: it cannot be read, or a line is wrong; the error names line and field.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ConfigError("CELLS.csv", str(path), getattr(error, "strerror", None) or str(error)) from error
    names, values = [], np.empty((2, len(rows)))
    for k, row in enumerate(rows):
        for i, name in enumerate(COLUMNS[1:]):
            text = row.get(name)
            try:
                values[i, k] = float(text or "")
            except ValueError as error:
                raise ConfigError(f"{path} line {k + 2}, {name}", text, "a number above 0") from error
            if not 0.0 < values[i, k] < np.inf:
                raise ConfigError(f"{path} line {k + 2}, {name}", text, "a number above 0")
        names.append(row.get("cell") or str(k + 1))
    if not rows:
        raise ConfigError("CELLS.csv", str(path), f"a line a cell under {','.join(COLUMNS)}")
    return names, values[0], values[1]


def match_cells(args: argparse.Namespace) -> int:
    """Print which cells belong together."""
    if args.table is None:
        return _place(args)
    names, capacity, resistance = read_cells(args.table)
    drawn = random_groups(capacity, resistance, args.parallel)
    builds = {
        "matched": match_groups(capacity, resistance, args.parallel),
        "sorted by capacity": sorted_groups(capacity, resistance, args.parallel),
        f"best of {RANDOM_BUILDS} random": drawn[0],
        "random, the median": drawn[len(drawn) // 2],
    }
    best = builds["matched"]
    if args.out is not None:
        rows = [(names[cell], group + 1) for group, cells in enumerate(best.cells.tolist()) for cell in cells]
        args.out.write_text("".join(map(csv_row, [("cell", "group"), *rows])), encoding="utf-8")
    if args.json:
        shown = {name: _figures(build) for name, build in builds.items()}
        groups = [[names[cell] for cell in cells] for cells in best.cells.tolist()]
        json.dump({"builds": shown, "groups": groups}, sys.stdout, allow_nan=False)
        print()
        return 0
    print(f"{len(best.cells)} groups of {args.parallel}")
    print(f"{'':22} {'capacity spread':>16} {'resistance spread':>18} {'usable':>8} {'largest share':>14}")
    for name, build in builds.items():
        print(
            f"{name:22} {100 * build.capacity_spread:>14.3f} % {100 * build.resistance_spread:>16.3f} %"
            f" {100 * build.usable:>6.2f} % {build.share_max:>14.3f}"
        )
    return 0


def _figures(build: Build) -> dict[str, float]:
    names = ("capacity_spread", "resistance_spread", "usable", "share_max", "cost")
    return {name: getattr(build, name) for name in names}


def _place(args: argparse.Namespace) -> int:
    with kept_season(args) as source:
        found = {car: _placed(modules, args.rise) for car, modules in modules_of(source.histories(args.car)).items()}
        moves = {car: _moves(placing) for car, placing in found.items()}
        if args.out is not None:
            rows = [(car, short_place(module), short_place(at)) for car in found for module, at in moves[car]]
            args.out.write_text("".join(map(csv_row, [("car", "module", "to"), *rows])), encoding="utf-8")
        if args.json:
            shown = [{"car": car, "moves": moves[car]} | _kelvin(placing) for car, placing in found.items()]
            json.dump(shown, sys.stdout, allow_nan=False)
            print()
            return 0
        for car, placing in found.items():
            print(
                f"{car}: hottest module {placing.hottest_now_k:+.1f} K beyond the mean now,"
                f" {placing.hottest_k:+.1f} K moved\ncoldest to hottest {placing.spread_now_k:.1f} K now,"
                f" {placing.spread_k:.1f} K then; {len(moves[car])} moves"
            )
    return 0


def _placed(modules: Modules, rise_k: float) -> Placing:
    heat_k = rise_k * (modules.resistance - 1.0)
    return place(heat_k, modules.warmer_k - heat_k)


def _moves(placing: Placing) -> list[tuple[int, int]]:
    return [(int(module), at) for at, module in enumerate(placing.module_at) if module != at]


def _kelvin(placing: Placing) -> dict[str, float]:
    return {name: value for name, value in asdict(placing).items() if name.endswith("_k")}


def without_modules(args: argparse.Namespace) -> int:
    """Print what the accumulator would be."""
    with kept_season(args) as source:
        removed = [cell_index(source.battery, part, "CELLS") for part in args.cells.split(",")]
        cars = modules_of(source.histories(args.car))
        found = {
            car: without(removed, modules.capacity_ah, modules.capacity_sigma_ah, modules.resistance_ohm, args.current)
            for car, modules in cars.items()
        }
        if args.json:
            shown = [
                {"car": car} | asdict(each) | {"has_capacity": cars[car].has_capacity} for car, each in found.items()
            ]
            json.dump(shown, sys.stdout, allow_nan=False)
            print()
            return 0
        for car, each in found.items():
            if not cars[car].has_capacity:
                print(f"{car}: no capacity was measured yet: all are taken as the cell file says, 5 % off")
            print(
                f"{car}: capacity {each.capacity_now_ah:.2f} Ah now, {each.capacity_ah:.2f} Ah without"
                f" (95 % {each.capacity_low_ah:.2f}..{each.capacity_high_ah:.2f}), then limited by"
                f" {short_place(each.limiting)}\nenergy {100 * each.energy:.1f} % of now"
                f" (95 % {100 * each.energy_low:.1f}..{100 * each.energy_high:.1f})\nweakest module at"
                f" {args.current:g} A: {1e3 * each.weakest_voltage_v:+.0f} mV"
            )
    return 0
