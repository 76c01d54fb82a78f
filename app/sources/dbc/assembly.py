"""Values as they come into measurements of the whole battery: the newest of each cell with its own time.

One code for live batches and for logs: values in, in their order; measurements out, one a period.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.battery.battery import Battery
from app.battery.serial import SerialMapping
from app.battery.source import STATES, DbcMapping
from app.estimation.arrays import BoolArray, FloatArray
from app.sources.dbc.battery_decoder import ChannelValues

PERIODS_BRIDGED = 3.0  # a value is old after so many of its own periods
LEAST_AGE_S = 0.5
FIRST_ROUND_S = 3.0  # messages of a battery that comes more often than this may differ in how often they come
UNKNOWN_AGE_S = 60.0  # age limit of a channel that was received once only
_SCALARS = ("current", "pack_voltage", "soc", "charger_voltage", "charger_current")
_ARRAYS = ("voltage", "temperature", "resistance", "balancing")
PARTS = {  # parts of a measurement with their own age
    "voltage": ("voltage",),
    "temperature": ("temperature",),
    "current": ("current",),
    "status": tuple(f"state.{name}" for name in STATES),
    "soc": ("soc",),
    "charger": ("charger_voltage", "charger_current"),
}
_KEPT = 0.95  # share of a new period in the kept one
_SILENCE_NS = round(2 * UNKNOWN_AGE_S * 1e9)
_NEVER = -(2**62)  # ns; older than any time


@dataclass(frozen=True, slots=True)
class BatteryMeasurement:
    """Measurement of a battery at one instant. NaN = missing or too old; times are those of the frames [ns]."""

    t_ns: int
    voltage_v: FloatArray  # (n_cells,)
    voltage_t_ns: NDArray[np.int64]  # (n_cells,)
    temperature_degc: FloatArray  # (n_sensors,)
    temperature_t_ns: NDArray[np.int64]  # (n_sensors,)
    resistance_ohm: FloatArray  # (n_cells,) by the BMS
    balancing: FloatArray  # (n_cells,) 0 or 1
    current_a: float  # positive on discharge
    current_t_ns: int
    pack_voltage_v: float
    soc: float  # SOC of the BMS, 0..1
    charger_voltage_v: float
    charger_current_a: float
    states: Mapping[str, bool | None]  # closed, precharge, fault, charging, balancing; None = unknown
    limits: Mapping[str, float]  # those that signals carry
    is_sample: bool  # the current is new since the measurement before, and a voltage is known
    newest_ns: Mapping[str, int]  # by a name of PARTS: the newest value of it that is not too old


@dataclass(slots=True)
class _Channels:
    """The newest value of each channel of a kind."""

    value: FloatArray
    t_ns: NDArray[np.int64]
    period_s: FloatArray  # as received, NaN until a channel was received twice
    max_age_s: float | None

    @classmethod
    def empty(cls, n: int, max_age_s: float | None) -> "_Channels":
        return cls(np.full(n, np.nan), np.full(n, _NEVER, np.int64), np.full(n, np.nan), max_age_s)

    def take(self, values: ChannelValues, first: int, last: int) -> int:
        """Take values of `first` up to `last`; return how many channels are new."""
        index, t_ns = values.index[first:last], values.t_ns[first:last]
        counts = np.bincount(index, minlength=len(self.value))
        channels = np.flatnonzero(counts)
        before = self.t_ns[channels]
        self.value[index] = values.value[first:last]  # the last one of several stays
        self.t_ns[index] = t_ns
        if self.max_age_s is None:
            is_known = before != _NEVER
            gap_s = (self.t_ns[channels] - before) / (1e9 * counts[channels])
            old = self.period_s[channels]
            longer = np.minimum(gap_s, PERIODS_BRIDGED * old)  # a pause is no period
            smooth = np.where(gap_s > old, longer, _KEPT * old + (1 - _KEPT) * gap_s)
            self.period_s[channels] = np.where(is_known, np.where(np.isnan(old), gap_s, smooth), old)
        return len(channels)

    def at(self, t_ns: int) -> FloatArray:
        """The values that are not too old at an instant."""
        if self.max_age_s is not None:
            most_ns: FloatArray | float = 1e9 * self.max_age_s
        else:
            most_ns = np.maximum(1e9 * LEAST_AGE_S, 1e9 * PERIODS_BRIDGED * self.period_s)
            most_ns = np.where(np.isnan(most_ns), 1e9 * UNKNOWN_AGE_S, most_ns)
        return np.where(t_ns - self.t_ns.astype(np.float64) <= most_ns, self.value, np.nan)


@dataclass(slots=True)
class _Scalar:
    """The newest value of one signal."""

    max_age_s: float | None
    value: float = float("nan")
    t_ns: int = _NEVER
    period_s: float = float("nan")

    def take(self, values: ChannelValues, first: int, last: int) -> int:
        """Take new values, as `_Channels.take`."""
        t_ns = int(values.t_ns[last - 1])
        if self.t_ns != _NEVER:
            gap_s = (t_ns - self.t_ns) / 1e9 / (last - first)
            if math.isnan(self.period_s):
                self.period_s = gap_s
            elif gap_s > self.period_s:
                self.period_s = min(gap_s, PERIODS_BRIDGED * self.period_s)
            else:
                self.period_s = _KEPT * self.period_s + (1 - _KEPT) * gap_s
        self.value, self.t_ns = float(values.value[last - 1]), t_ns
        return 1

    def at(self, t_ns: int) -> float:
        """The value, NaN where it is too old."""
        most_s = self.max_age_s
        if most_s is None:
            is_known = self.period_s == self.period_s
            most_s = max(LEAST_AGE_S, PERIODS_BRIDGED * self.period_s) if is_known else UNKNOWN_AGE_S
        return self.value if t_ns - self.t_ns <= 1e9 * most_s else float("nan")


class NewestValues:
    """The newest value of each channel and signal of a battery, with its time."""

    def __init__(self, battery: Battery, ages: Mapping[str, float | None]) -> None:
        """`ages`: seconds by kind after which a value is old; else after some of its own periods."""
        self._battery = battery
        sizes = dict.fromkeys(_ARRAYS, battery.n_cells) | {"temperature": battery.n_sensors}
        self._arrays = {kind: _Channels.empty(sizes[kind], ages.get(kind)) for kind in _ARRAYS}
        self._scalars = {f"limit.{name}": _Scalar(None) for name in battery.limits}
        self._scalars |= {f"state.{name}": _Scalar(None) for name in STATES}
        self._scalars |= {name: _Scalar(ages.get(name)) for name in _SCALARS}
        self._kinds: dict[str, _Channels | _Scalar] = {**self._arrays, **self._scalars}

    def __contains__(self, kind: str) -> bool:
        return kind in self._kinds

    @property
    def voltage(self) -> _Channels:
        """The cells' voltages."""
        return self._arrays["voltage"]

    def take(self, kind: str, values: ChannelValues, first: int = 0, last: int | None = None) -> int:
        """Take values of a kind, `first` up to `last`, in their order; return how many channels are new."""
        return self._kinds[kind].take(values, first, len(values.t_ns) if last is None else last)

    def measure(self, t_ns: int, new: Mapping[str, int] | None = None) -> BatteryMeasurement:
        """Return what is known at an instant; `new` = channels of each kind that are new since the one before."""
        new = new or {}
        of = {kind: channels.at(t_ns) for kind, channels in self._arrays.items()}
        one = {kind: scalar.at(t_ns) for kind, scalar in self._scalars.items()}
        states = {name: one[f"state.{name}"] for name in STATES}
        newest_ns = {kind: int(self._arrays[kind].t_ns[np.isfinite(of[kind])].max(initial=_NEVER)) for kind in _ARRAYS}
        newest_ns |= {kind: scalar.t_ns for kind, scalar in self._scalars.items() if not math.isnan(one[kind])}
        newest_of_part = {
            part: max((newest_ns.get(kind, _NEVER) for kind in kinds), default=_NEVER) for part, kinds in PARTS.items()
        }
        return BatteryMeasurement(
            t_ns=t_ns,
            voltage_v=of["voltage"],
            voltage_t_ns=self._arrays["voltage"].t_ns.copy(),
            temperature_degc=of["temperature"],
            temperature_t_ns=self._arrays["temperature"].t_ns.copy(),
            resistance_ohm=of["resistance"],
            balancing=of["balancing"],
            current_a=one["current"],
            current_t_ns=self._scalars["current"].t_ns,
            pack_voltage_v=one["pack_voltage"],
            soc=one["soc"],
            charger_voltage_v=one["charger_voltage"],
            charger_current_a=one["charger_current"],
            states={name: None if math.isnan(value) else bool(value) for name, value in states.items()},
            limits={name: one[f"limit.{name}"] for name in self._battery.limits},
            is_sample=bool(new.get("current")) and bool(np.isfinite(of["voltage"]).any()),
            newest_ns={part: t_ns for part, t_ns in newest_of_part.items() if t_ns != _NEVER},
        )


class Assembler:
    """Makes measurements of decoded values. Called from one thread; time comes with the values."""

    def __init__(self, battery: Battery, source: DbcMapping | SerialMapping) -> None:
        self._period_ns = round(source.period_s * 1e9)
        self._values = NewestValues(battery, source.ages)
        self._next_ns: int | None = None
        self._first_ns: int | None = None  # time of the first voltage
        self._rest: dict[str, ChannelValues] = {}  # values of the unfinished period: taken at its end, as in one batch

    def measure(self, t_ns: int) -> BatteryMeasurement:
        """Return what is known at an instant; nothing is new."""
        return self._values.measure(t_ns)

    def awaited(self, t_ns: int) -> BoolArray | None:
        """(n_cells,) which cells were not received yet while the first round of all may still go on; None: none."""
        voltage = self._values.voltage
        is_unheard = voltage.t_ns == _NEVER
        if self._first_ns is None or not is_unheard.any():
            return None
        waited_s = (t_ns - self._first_ns) / 1e9
        is_second_round = bool(np.isfinite(voltage.period_s).any())
        longest_s = UNKNOWN_AGE_S if voltage.max_age_s is None else voltage.max_age_s
        is_over = waited_s > FIRST_ROUND_S and (is_second_round or waited_s > longest_s)
        return None if is_over else is_unheard

    def feed(self, values: Mapping[str, ChannelValues], until_ns: int | None = None) -> list[BatteryMeasurement]:
        """Take values and return the measurements of the periods that ended.

        Args:
            values: by kind, as a decoder gives them, not older than those of the call before.
            until_ns: the time now; None: that of the newest value.
        """
        series_of = {kind: series for kind, series in values.items() if kind in self._values and len(series.t_ns)}
        newest = [int(series.t_ns[-1]) for series in series_of.values()]
        end_ns = max([*newest, *([] if until_ns is None else [until_ns])], default=None)
        if end_ns is None:
            return []
        if self._next_ns is None:
            first = min((int(series.t_ns[0]) for series in series_of.values()), default=end_ns)
            self._next_ns = (first // self._period_ns + 1) * self._period_ns
        if self._first_ns is None and "voltage" in series_of:
            self._first_ns = int(series_of["voltage"].t_ns[0])
        waiting = self._rest | {kind: _joined(self._rest.get(kind), series) for kind, series in series_of.items()}
        at = dict.fromkeys(waiting, 0)
        measurements = []
        while self._next_ns <= end_ns:
            if end_ns - self._next_ns > _SILENCE_NS:
                self._next_ns = max(self._next_ns, self._after_silence(waiting, at, end_ns))
            new = self._take(waiting, at, self._next_ns)
            measurements.append(self._values.measure(self._next_ns, new))
            self._next_ns += self._period_ns
        rest = ((kind, series, at[kind]) for kind, series in waiting.items())
        self._rest = {kind: _from(series, first) for kind, series, first in rest if first < len(series.t_ns)}
        return measurements

    def _after_silence(self, values: Mapping[str, ChannelValues], at: Mapping[str, int], end_ns: int) -> int:
        """The period with which to go on: none is made of a silence in which all values have become old."""
        next_ns = min((int(v.t_ns[at[k]]) for k, v in values.items() if at[k] < len(v.t_ns)), default=end_ns)
        is_silent = self._next_ns is not None and next_ns - self._next_ns > _SILENCE_NS
        return next_ns // self._period_ns * self._period_ns if is_silent else 0

    def _take(self, values: Mapping[str, ChannelValues], at: dict[str, int], until_ns: int) -> dict[str, int]:
        """Take what came up to an instant, from `at` on, which moves; return how many channels of each kind are new."""
        new = {}
        for kind, series in values.items():
            last = int(np.searchsorted(series.t_ns, until_ns, side="right"))
            if last > at[kind]:
                new[kind] = self._values.take(kind, series, at[kind], last)
                at[kind] = last
        return new


def _from(values: ChannelValues, first: int) -> ChannelValues:
    return ChannelValues(values.t_ns[first:], values.index[first:], values.value[first:])


def _joined(before: ChannelValues | None, after: ChannelValues) -> ChannelValues:
    if before is None:
        return after
    return ChannelValues(*(np.concatenate((getattr(before, n), getattr(after, n))) for n in ("t_ns", "index", "value")))
