"""`voltwall sessions passport`: the life of every cell across all sessions, and swaps of modules."""

import argparse
import json
import sys
from dataclasses import asdict
from datetime import UTC, datetime

from app.analysis.passport.history import Passports
from app.analysis.passport.keeper import PassportKeeper
from app.analysis.passport.shapes import swaps_of
from app.analysis.totals import listed, number
from app.battery.battery import Battery
from app.clock import Clock
from app.commands.console.progress import Progress
from app.commands.console.terminal import print_table
from app.commands.session_commands.analysis import scaled, short_place
from app.commands.session_commands.selection import (
    catalogue,
    chosen_battery,
    data_folder,
)
from app.errors import ConfigError
from app.estimation.cell_model.circuit import CellModel
from app.sessions.passport_store import StoredSwap
from app.words import naming_cells

_NOW = ("capacity_ah", "resistance_ohm", "resistance_relative", "self_discharge_per_day", "balancing_h")


def show_passport(args: argparse.Namespace) -> int:
    """Print every cell across all sessions, after a swap that is to be recorded."""
    battery, cell = chosen_battery(args)
    with naming_cells(battery.segments):
        return _of_battery(args, battery, cell)


def _of_battery(args: argparse.Namespace, battery: Battery, cell: CellModel) -> int:
    keeper = PassportKeeper(data_folder(args), catalogue(args), cell, battery=battery, simulated=args.simulated)
    try:
        if args.take_back is not None and not keeper.store.remove_swap(args.take_back):
            raise ConfigError("--take-back", args.take_back, "the number of a swap that is listed")
        progress = Progress("passports")
        keeper.read_new(progress)  # before a swap: it says which cars there are
        progress.end()
        if args.swap is not None:
            _swap(keeper, args)
        car, cars = keeper.car(args.car), sorted(keeper.store.cars())
        made, swaps = keeper.passports(car), swaps_of(keeper, car)
    finally:
        keeper.close()
    if args.json:
        _print_json(made, swaps, {"car": car, "cars": cars})
    else:
        if len(cars) > 1:
            print(f"car {car}, of {', '.join(cars)}")
        _print_table(made, swaps)
    return 0


def _swap(keeper: PassportKeeper, args: argparse.Namespace) -> None:
    cells, at_s = [cell_index(keeper.battery, part) for part in args.swap.split(",")], _time(args.at)
    keeper.swap(cells, at_s, args.note, None, args.car)
    print(f"recorded: {_swap_text(sorted(set(cells)), at_s, args.note)}", file=sys.stderr)


def _swap_text(cells: list[int], at_s: float, note: str) -> str:
    when = datetime.fromtimestamp(at_s, UTC).strftime("%Y-%m-%d %H:%MZ")
    return f"{', '.join(short_place(cell) for cell in cells)} replaced {when}" + (f": {note}" if note else "")


def _print_json(made: Passports, swaps: list[StoredSwap], whose: dict[str, object]) -> None:
    known = {name: listed(made.now(name)) for name in _NOW}
    shown = whose | {
        "sessions": made.sessions,
        "by_todays_cell": made.n_by_todays_cell,
        **known,
        "rank": listed(made.rank),
        "drifts": [asdict(drift) for drift in made.drifts],
        "swaps": [asdict(swap) for swap in swaps],
    }
    json.dump(shown, sys.stdout)
    print()


def _print_table(made: Passports, swaps: list[StoredSwap]) -> None:
    print(f"{len(made.sessions)} finished {'session' if len(made.sessions) == 1 else 'sessions'}")
    if made.n_by_todays_cell:
        print(f"{made.n_by_todays_cell} of them keep no cell file: today's judges them")
    for swap in swaps:
        print(f"swap {swap.id}: {_swap_text(swap.cells, swap.time_s, swap.note)}")
    for drift in made.drifts:
        print(f"{short_place(drift.cell)} {drift.text}")
    if not made.sessions:
        return
    now = {name: made.now(name).tolist() for name in _NOW}
    rows = []
    for index, rank in enumerate(made.rank.tolist()):
        ah, ohm, apart, rate, hours = (number(now[name][index]) for name in _NOW)
        figures = ((number(rank), 1, 0), (ah, 1, 2), (ohm, 1000, 3), (apart, 100, 1), (rate, 100, 3), (hours, 1, 1))
        rows.append((short_place(index), *(scaled(*figure) for figure in figures)))
    heads = ("rank", "capacity Ah", "resistance mohm", "against others %", "self-discharge %/day", "bled h")
    print_table(("cell", *heads), rows, "<>>>>>>")


_DIGITS = 4  # of a pack, and of a cell in it


def cell_index(battery: Battery, text: str, field: str = "--swap") -> int:
    """Return the index of pack/cell; ConfigError names the field."""
    pack, _, cell = text.strip().partition("/")
    is_place = all(part.isascii() and part.isdigit() and len(part) <= _DIGITS for part in (pack, cell))
    index = battery.cell_at(int(pack) - 1, int(cell) - 1) if is_place else None
    if index is None:
        raise ConfigError(field, text, f"pack/cell, 1/1 to {battery.n_segments}/{battery.segments[-1]}")
    return index


def _time(text: str | None) -> float:
    if text is None:
        return Clock().wall_s()
    try:
        at = datetime.fromisoformat(text)
    except ValueError as error:
        raise ConfigError("--at", text, f"a time as 2026-07-14T10:30: {error}") from error
    return (at if at.tzinfo else at.replace(tzinfo=UTC)).timestamp()
