"""Under which condition each prediction holds, or why there is none: messages for the pages and the API."""

from dataclasses import replace
from math import inf

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import CellModel
from app.estimation.prediction.constant_current import is_beyond_temperatures
from app.estimation.prediction.energy import LapsLeft
from app.estimation.prediction.laps import LapWatch
from app.estimation.prediction.power import HORIZONS_S, PowerLimit, StatePower, TimeToTrip
from app.telemetry import Prediction
from app.telemetry.measurement import Measurement
from app.words import Message, Quantity


def cells_unknown(n: int) -> Message | None:
    """Return why there is no figure for all cells: the number of cells without a SOC."""
    return Message("soc-of-cells-unknown", n=n) if n else None


def power_held(power: StatePower | None, temperatures: Message | None) -> Message:
    """Power: whether it is beyond what the cell file was measured with, and then what is furthest beyond.

    Args:
        power: as predicted.
        temperatures: `beyond_temperatures`.
    """
    if power is None:
        return Message("power-not-known")
    limits = (*power.discharge, *power.charge)
    if temperatures is not None:
        return temperatures
    if any(limit.measured_a is None for limit in limits):
        return Message("power-held-not-measured")
    if any(limit.beyond_measured for limit in limits):
        furthest = max(limits, key=lambda limit: limit.current_a / (limit.measured_a or inf))
        return Message(
            "power-held-beyond",
            measured=Quantity(furthest.measured_a, "A", 0),
            time=Quantity(furthest.horizon_s, "s", 0),
            asked=Quantity(furthest.current_a, "A", 0),
        )
    return Message("power-held")


def beyond_temperatures(cell: CellModel, temperatures_degc: FloatArray) -> Message | None:
    """All of it: the cells' temperatures, where those that the cell file was measured at are too far from them."""
    finite = temperatures_degc[np.isfinite(temperatures_degc)]
    if not is_beyond_temperatures(cell, finite):
        return None
    low, high = (Quantity(float(cell.measured_degc[end]), "degC", 0) for end in (0, -1))
    furthest = float(finite[cell.drop_error(finite).argmax()])
    return Message("beyond-temperatures", low=low, high=high, now=Quantity(furthest, "degC", 0))


def at_load(load_a: float, trips: tuple[TimeToTrip, ...], temperatures: Message | None) -> Message:
    """Times to the limits, at the mean current of the last seconds [A]; 0 = no current to speak of."""
    if not load_a:
        return Message("to-trip-at-rest")
    if temperatures is not None:
        return temperatures
    if any(trip.beyond_measured for trip in trips):
        return Message("to-trip-at-load-beyond", load=Quantity(load_a, "A", 0))
    return Message("to-trip-at-load", load=Quantity(load_a, "A", 0))


def until_empty(driven_a: float, is_beyond: bool | None, temperatures: Message | None) -> Message:
    """Energy, with the losses of driving at a mean current [A]; 0 = nothing was driven yet."""
    if not driven_a:
        return Message("energy-without-load")
    if temperatures is not None:
        return temperatures
    if is_beyond:
        return Message("energy-at-load-beyond", load=Quantity(driven_a, "A", 0))
    return Message("energy-at-load", load=Quantity(driven_a, "A", 0))


def laps_known(watch: LapWatch, left: LapsLeft | None) -> Message:
    """Laps: how those that were driven are known, or why there is no number."""
    laps = watch.laps
    if laps is None or left is None:
        return Message("laps-overdue") if watch.is_overdue else Message("laps-few")
    n, time = int(laps.energies_wh.size), Quantity(laps.period_s, "s", 0)
    if laps.source == "marks":
        return Message("laps-by-marks", n=n, time=time)
    return Message("laps-by-period", n=n, time=time)


def as_of(prediction: Prediction | None, measured: Measurement, judged_ns: int | None) -> Prediction | None:
    """Return a prediction as it holds at a measurement: with its age, and without what open relays forbid."""
    if prediction is None or judged_ns is None:
        return prediction
    aged = replace(prediction, age_s=max(measured.t_mono_ns - judged_ns, 0) / 1e9)
    if measured.master.state == "fault":
        why_power, why_laps = Message("power-none-fault"), Message("laps-none-fault")
        aged = _without_energy(aged)
    elif measured.relays_open:
        why_power, why_laps = Message("power-none-relays-open"), Message("laps-none-relays-open")
    else:
        return aged
    nothing = tuple(PowerLimit(h, 0.0, 0.0, 0.0, 0.0, None, "relays", None, False) for h in HORIZONS_S)
    return replace(
        aged,
        power=StatePower(nothing, nothing),
        to_trip=(),
        to_trip_full=(),
        nearest=None,
        laps=None,
        load_a=0.0,
        power_condition=why_power,
        to_trip_condition=Message("to-trip-at-rest"),
        laps_condition=why_laps,
    )


def _without_energy(prediction: Prediction) -> Prediction:
    """Of a car that may not drive nobody knows how it will be driven, so not what of its charge is of use."""
    return replace(
        prediction,
        energy_left_wh=None,
        energy_left_sigma_wh=None,
        energy_left_low_wh=None,
        energy_left_high_wh=None,
        energy_left_cell=None,
        energy_left_beyond_measured=None,
        target=None,
        energy_condition=Message("energy-none-fault"),
    )
