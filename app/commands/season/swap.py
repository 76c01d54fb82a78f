"""`voltwall season swap`: which modules were replaced, and when."""

import argparse
import json
import sys
from dataclasses import asdict
from datetime import UTC, datetime

from app.battery.battery import Battery
from app.clock import Clock
from app.commands.season.kept import kept_season
from app.commands.session_commands.analysis import short_place
from app.commands.session_commands.selection import data_folder
from app.errors import ConfigError
from app.sessions.swaps import SwapFile

MOST_DIGITS = 9  # of a pack or a cell


def swap_modules(args: argparse.Namespace) -> int:
    """Record a swap, or take one back, where that is asked for; print those of the car, or of all."""
    source = kept_season(args)
    swaps = SwapFile(data_folder(args), source.battery, simulated=args.simulated)
    if args.take_back is not None and not swaps.remove(args.take_back):
        raise ConfigError("--take-back", args.take_back, "the number of a swap that is listed")
    if args.cells is not None:
        cells = [cell_index(source.battery, part) for part in args.cells.split(",")]
        cars = [history.car for history in source.histories()]
        swaps.add(cells, _time(args.at), args.note, None, args.car, cars)
    listed = [swap for swap in swaps.read() if not args.car or swap.is_of(args.car)]
    if args.json:
        json.dump([asdict(swap) for swap in listed], sys.stdout)
        print()
        return 0
    for swap in listed:
        when = datetime.fromtimestamp(swap.time_s, UTC).strftime("%Y-%m-%d %H:%MZ")
        cells_text = ", ".join(short_place(cell, source.battery.segments) for cell in swap.cells)
        whose = "" if swap.car is None else f" of {swap.car}"
        print(f"swap {swap.id}: {cells_text}{whose} replaced {when}" + (f": {swap.note}" if swap.note else ""))
    return 0


def cell_index(battery: Battery, text: str) -> int:
    """Return the index of a cell named PACK/CELL.

    Raises:
        ConfigError: the battery has no such cell.
    """
    pack, _, cell = text.strip().partition("/")
    is_place = all(part.isascii() and part.isdecimal() and len(part) <= MOST_DIGITS for part in (pack, cell))
    index = battery.cell_at(int(pack) - 1, int(cell) - 1) if is_place else None
    if index is None:
        raise ConfigError("CELLS", text, f"pack/cell, 1/1 to {battery.n_segments}/{battery.segments[-1]}")
    return index


def _time(text: str | None) -> float:
    if text is None:
        return Clock().wall_s()
    try:
        at = datetime.fromisoformat(text)
    except ValueError as error:
        raise ConfigError("--at", text, f"a time such as 2026-07-14T10:30: {error}") from error
    return (at if at.tzinfo else at.replace(tzinfo=UTC)).timestamp()
