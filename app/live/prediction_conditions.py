"""Under which condition each prediction holds, or why there is none: messages for the pages and the API."""

from dataclasses import replace

from app.estimation.prediction.energy import LapsLeft
from app.estimation.prediction.laps import LapWatch
from app.estimation.prediction.power import HORIZONS_S, PowerLimit, StatePower
from app.telemetry import Prediction
from app.telemetry.measurement import Measurement
from app.words import Message, Quantity


def cells_unknown(n: int) -> Message | None:
    """What is over all cells: why there is none without the SOC of so many."""
    return Message("soc-of-cells-unknown", n=n) if n else None


def power_held(power: StatePower | None, measured_a: float | None) -> Message:
    """Power: whether it lies beyond the currents that the cell file was measured with [A], None = it does not say."""
    if power is None:
        return Message("power-not-known")
    if measured_a is None:
        return Message("power-held-not-measured")
    if any(limit.beyond_measured for limit in (*power.discharge, *power.charge)):
        return Message("power-held-beyond", measured=Quantity(measured_a, "A"))
    return Message("power-held")


def at_load(load_a: float) -> Message:
    """Times to the limits, at the mean current of the last seconds [A]; 0 = no current to speak of."""
    return Message("to-trip-at-load", load=Quantity(load_a, "A", 0)) if load_a else Message("to-trip-at-rest")


def until_empty(driven_a: float) -> Message:
    """Energy, with the losses of driving at a mean current [A]; 0 = nothing was driven yet."""
    if not driven_a:
        return Message("energy-without-load")
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
    nothing = tuple(PowerLimit(h, 0.0, 0.0, 0.0, 0.0, None, "relays", False) for h in HORIZONS_S)
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
        target=None,
        energy_condition=Message("energy-none-fault"),
    )
