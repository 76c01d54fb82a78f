"""Keeps what was last measured of every quantity, for as long as it is missing."""

from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from app.telemetry import Accumulator, FloatArray, Snapshot
from app.telemetry.fields import Part, history_fields
from app.telemetry.last_known import LastCells, LastKnown, LastNumber, LastOfAccumulator, LastOfCells, LastOfPack
from app.telemetry.measurement import BLANK_S, STALE_S

_TOTALS = tuple(field.name for field in fields(LastOfAccumulator))
_OF_PACK = tuple(field.name for field in fields(LastOfPack))
_PART: dict[str, Part] = dict.fromkeys((*_TOTALS, *_OF_PACK), "voltage")
_PART |= {name: part for name, _, part in history_fields(Accumulator)}
_PART |= {name: "temperature" for name in _OF_PACK if name.startswith("temperature")}
_CELL = {name: name.removesuffix("_v").removesuffix("_degc") + "_cell" for name in _TOTALS}
_SOC = ("soc", "driver_soc_percent")  # the master's where the filter's is missing
_PARTS: tuple[Part, ...] = ("current", "voltage", "temperature", "soc")
_Wall = Callable[[Any], Any]  # unix seconds of monotonic nanoseconds


def _age_s(snapshot: Snapshot, part: Part) -> float:
    """Age of a part, at most that at which its values go: one that is there while its part is older came elsewhere."""
    age_s = getattr(snapshot.age_s, part)
    live_s = None if snapshot.live_s is None else getattr(snapshot.live_s, part)
    most_s = max(BLANK_S, live_s or 0.0)
    return most_s if age_s is None else min(float(age_s), most_s)


class LastValues:
    """The last measured values, dated by the monotonic clock: setting the wall clock makes nothing older."""

    def __init__(self, n_cells: int, n_packs: int) -> None:
        self._voltage, self._temperature, self._soc = (_Cells(n_cells) for _ in range(3))
        self._packs = tuple(_Numbers(_OF_PACK) for _ in range(n_packs))
        self._accumulator = _Numbers(_TOTALS)

    def step(self, snapshot: Snapshot) -> LastKnown | None:
        """Take what a snapshot has; return what it has not and an earlier one had, None where that is nothing."""
        now_ns, cells, ages_s = snapshot.t_mono_ns, snapshot.cells, snapshot.cells.voltage_age_s
        at_ns = {part: now_ns - 1e9 * _age_s(snapshot, part) for part in _PARTS}
        voltage_ns = at_ns["voltage"] if ages_s is None else now_ns - 1e9 * ages_s

        def wall_s(t_ns: Any) -> Any:
            return (snapshot.t_wall_ns - now_ns + t_ns) / 1e9

        of_cells = LastOfCells(
            self._voltage.step(cells.voltage_v, voltage_ns, wall_s),
            self._temperature.step(cells.temperature_degc, at_ns["temperature"], wall_s),
            self._soc.step(cells.soc, at_ns["voltage"], wall_s),
        )
        packs = zip(self._packs, snapshot.packs, strict=True)
        of_packs = tuple(LastOfPack(**kept.step(pack, at_ns, wall_s)) for kept, pack in packs)
        of_all = LastOfAccumulator(**self._accumulator.step(snapshot.accumulator, at_ns, wall_s))
        is_nothing = of_cells == LastOfCells() and of_all == LastOfAccumulator() and set(of_packs) <= {LastOfPack()}
        return None if is_nothing else LastKnown(of_cells, of_packs, of_all)


class _Cells:
    """The last value of each cell, and when it was measured."""

    def __init__(self, n_cells: int) -> None:
        self._values = np.full(n_cells, np.nan)
        self._at_ns: FloatArray = np.zeros(n_cells)

    def step(self, values: FloatArray, at_ns: FloatArray | float, wall_s: _Wall) -> LastCells | None:
        missing = np.isnan(values)
        self._values = np.where(missing, self._values, values)
        self._at_ns = np.where(missing, self._at_ns, at_ns)
        old = missing & ~np.isnan(self._values)
        if not old.any():
            return None
        times = np.where(old, wall_s(self._at_ns), np.nan)
        first, last = float(np.nanmin(times)), float(np.nanmax(times))
        return LastCells(np.where(old, self._values, np.nan), first, times if last - first >= STALE_S else None)


class _Numbers:
    """The last of each number of an object, and when it was measured."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self._names = names
        self._kept: dict[str, tuple[float, float, int | None]] = {}  # value, time [ns], cell

    def step(self, source: Any, at_ns: Mapping[Part, float], wall_s: _Wall) -> dict[str, LastNumber]:
        """Take those that are there; return those that are not."""
        by_master = getattr(source, "soc_source", None) == "master"
        missing = {}
        for name in self._names:
            value, kept = getattr(source, name), self._kept.get(name)
            if value is not None:
                t_ns = at_ns["soc" if by_master and name in _SOC else _PART[name]]
                if by_master and name in _SOC and kept is not None and t_ns - kept[1] < STALE_S * 1e9:
                    continue  # same moment: the filter's value stays
                self._kept[name] = value, t_ns, getattr(source, _CELL.get(name, ""), None)
            elif kept is not None:
                value, t_ns, cell = kept
                missing[name] = LastNumber(value, wall_s(t_ns), cell)
        return missing
