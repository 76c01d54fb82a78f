"""The last values of what is not measured now: for a silent car. Never live, in no sum and no alarm."""

from dataclasses import dataclass
from typing import Annotated

from app.estimation.arrays import FloatArray
from app.telemetry.fields import LEFT_OUT, Unit


@dataclass(frozen=True, slots=True)
class LastNumber:
    """A number that is missing now, as it was last measured."""

    value: Annotated[float, Unit("", "in the unit of its name")]
    time: Annotated[float, Unit("s", "unix time when it was measured", 1)]
    cell: Annotated[int | None, LEFT_OUT] = None


Last = Annotated[LastNumber | None, LEFT_OUT]


@dataclass(frozen=True, slots=True)
class LastCells:
    """One value a cell; null where it is measured now, or never was."""

    values: Annotated[FloatArray, Unit("", "in the unit of its name", 5)]
    time: Annotated[float, Unit("s", "unix time when the oldest of them was measured", 1)]
    times: Annotated[FloatArray | None, LEFT_OUT, Unit("s", "of each cell, where they differ", 1)] = None


@dataclass(frozen=True, slots=True)
class LastOfCells:
    """Arrays of `cells` in which a value is missing."""

    voltage_v: Annotated[LastCells | None, LEFT_OUT] = None
    temperature_degc: Annotated[LastCells | None, LEFT_OUT] = None
    soc: Annotated[LastCells | None, LEFT_OUT] = None


@dataclass(frozen=True, slots=True)
class LastOfPack:
    """Numbers of a pack that are missing; sum and spread of when all its cells were measured."""

    voltage_v: Last = None
    min_v: Last = None
    max_v: Last = None
    delta_v: Last = None
    temperature_max_degc: Last = None
    temperature_min_degc: Last = None


@dataclass(frozen=True, slots=True)
class LastOfAccumulator:
    """Numbers of the accumulator that are missing; what is over all cells is of when all were measured."""

    voltage_v: Last = None
    current_a: Last = None
    power_w: Last = None
    soc: Last = None
    soc_sigma: Last = None
    driver_soc_percent: Last = None
    soc_min: Last = None
    soc_max: Last = None
    soc_spread: Last = None
    voltage_min_v: Last = None
    voltage_max_v: Last = None
    voltage_mean_v: Last = None
    voltage_delta_v: Last = None
    temperature_min_degc: Last = None
    temperature_max_degc: Last = None


@dataclass(frozen=True, slots=True)
class LastKnown:
    """The last measured values since the service started, of what is missing now."""

    cells: LastOfCells
    packs: tuple[LastOfPack, ...]
    accumulator: LastOfAccumulator
