"""Names of quantities in the columns of users, test rigs and other systems: one vocabulary, by name and by numbers.

Every reader of tables asks `candidates` which columns may be a quantity: the best one first, by what its name says and
by whether its numbers can be that. Words are of Arbin, Maccor, Neware, BioLogic, Basytec, Digatron, PEC, Novonix, the
Battery Data Format, Orion, VESC, LeafSpy and DIYBMS.
"""

import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from app.estimation.arrays import FloatArray

_DAY_S = 86_400.0
Conversion = tuple[float, float]  # factor and offset into s, A, V, degC, fraction
UNITS: dict[str, dict[str, Conversion]] = {
    "time": {"s": (1, 0), "ms": (1e-3, 0), "us": (1e-6, 0), "min": (60, 0), "h": (3600, 0)},
    "current": {"A": (1, 0), "mA": (1e-3, 0), "0.1A": (0.1, 0)},
    "voltage": {"V": (1, 0), "mV": (1e-3, 0), "0.1mV": (1e-4, 0)},
    "temperature": {
        "degC": (1, 0),
        "K": (1, -273.15),
        "degF": (5 / 9, -160 / 9),
        "0.1degC": (0.1, 0),
        "mdegC": (1e-3, 0),
    },
    "soc": {"percent": (0.01, 0), "fraction": (1, 0)},
}
UNIX_FROM_S = 9.0e8  # a time beyond it, in 1998, is since 1970; before it, since a start
SLOW_STEP_S = 50.0  # whole numbers so far apart are rather ms
LEAST_SPAN_S, SAME_SPAN = 10.0, 0.05  # dates over less show no unit; share by which the spans may differ
_SPELLINGS = {  # other ways to write a unit, in lower case
    "sec": "s", "seconds": "s", "hh:mm:ss": "s", "h:min:s.ms": "s", "h:min:s": "s", "h:m:s": "s",
    "hr": "h", "hours": "h", "amps": "A", "volts": "V",
    "c": "degC", "celsius": "degC", "celcius": "degC", "degreecelsius": "degC",
    "degreescelsius": "degC", "degreecelcius": "degC",
    "mc": "mdegC", "fahrenheit": "degF", "kelvin": "K",
    "°c": "degC", "℃": "degC", "oc": "degC",
    "f": "degF", "°f": "degF",
    "1": "fraction", "frac": "fraction", "%": "percent", "pct": "percent",
}  # fmt: skip
_OTHER_UNITS = {
    "ah", "mah", "wh", "mwh", "kwh", "w", "mw", "ohm", "mohm", "cnt", "#", "d", "hz", "%", "bar", "v/s", "v/h", "a/h",
}  # fmt: skip
_NAMES = {  # whole names without their unit, in lower case and without spaces
    "time": "time testtime t elapsed elapsedtime timestamp seconds totaltime cumulativetime progtime runtime"
    " programtime epochtime unixtime mstoday timeus zeit prüfzeit testzeit messzeit laufzeit gesamtzeit tid temps"
    " tiempo 时间 总时间 测试时间 运行时间",
    "current": "current i <i> cur cellcurrent icell ibatt ibat amps batterycurrent strom zellstrom strøm"
    " courant corriente corrente 电流",
    "voltage": "voltage v u cellvoltage terminalvoltage vcell ucell vbatt vbat volts ewe ecell eweece potential"
    " batteryvoltage spannung zellspannung spenning tension tensión voltaje tensione 电压",
    "temperature": "temperature temp celltemperature celltemp tcell t1 temp1 auxtemperature1 surfacetemperature"
    " surfacetemp batterytemperature batterytemp temperatur zelltemperatur température temperatura 温度",
    "soc": "soc batterylevel stateofcharge",
}
_WITH_UNIT = {"test", "rec"}  # `Test (Sec)` is a time, `Test` is its number
_UNITS_IN_NAMES = {"mstoday": "ms", "timeus": "us"}
_WALL_CLOCKS = (
    "datetime", "date", "dateandtime", "absolutetime", "systemtime", "realtime", "datestamp", "datetimestamp",
    "dpttime", "dpttimestamp", "绝对时间", "系统时间",
)  # fmt: skip
_PARTS = {  # words of longer names
    "time": {"time", "seconds", "timestamp", "zeit"},
    "current": {"current", "currents", "i", "amp", "amps", "ampere", "strom"},
    "voltage": {"voltage", "voltages", "volt", "volts", "v", "u", "cell", "vcell", "cp", "spannung"},
    "temperature": {"temp", "temperature", "therm", "thermistor", "ntc", "t", "temps"},
    "soc": {"soc"},
}
_NEVER = {  # words that make another quantity of such a name
    "time": "step set cyc cycle start end load hold left remaining charge discharge gnss gps imu setup zone date",
    "current": "hr hrs hour hours ah h limit lim ccl dcl setpoint target ref density stamp time range offset fault"
    " voltage power temp temperature resistance sigma",
    "voltage": "open ocv circuit limit target ref reference resistance sigma model balance balancing fault current temp"
    " temperature amp amps soc di dv dq dt power energy capacity status count diff delta number nr ir t",
    "temperature": "limit target ref dt fault ambient environment env chamber station circuit board pcb mos mosfet"
    " motor inverter fet coolant room oven controller time sigma",
    "soc": "limit target sigma",
}  # fmt: skip
_RATHER_NOT = {
    "motor", "axis", "setup", "max", "min", "avg", "average", "mean", "peak", "high", "low", "phase", "12v", "aux",
    "charger",
}  # fmt: skip
_FULL_CELL = {"ecell", "ece"}  # BioLogic: `Ewe` alone is against the reference
_OF_THE_WHOLE = {"test", "total", "cumulative", "prog", "run", "elapsed", "epoch"}  # not of a step


class Candidate(NamedTuple):
    """A column that may be a quantity; the higher score is the likelier."""

    name: str
    unit: str | None  # as `UNITS` has it; None: the name does not say
    is_plain: bool  # its whole name means the quantity
    score: float


def candidates(quantity: str, columns: Mapping[str, FloatArray]) -> list[Candidate]:
    """Return the columns that may be a quantity, the likeliest first; of equals the first in the table.

    Args:
        quantity: one of `UNITS`.
        columns: (n,) values by name; a column without one number is nothing.
    """
    ranked = []
    for name, values in columns.items():
        score = _score_of_name(name, quantity)
        if score > 0.0:
            unit = unit_of(name, quantity)
            score += _score_of_values(values, quantity, unit)
        if score > 0.0:
            ranked.append(Candidate(name, unit, quantity_of(name) == quantity, score))
    return sorted(ranked, key=lambda candidate: -candidate.score)


def quantity_of(name: str) -> str | None:
    """Return the quantity that a column's whole name means, None where it means none, or is in an unknown unit."""
    if name.strip() == "T":
        return "temperature"
    words = _words(name)
    for quantity, names in _NAMES.items():
        own_names = names.split()
        has_unit = find_unit(quantity, words[-1]) is not None
        if "".join(words) in own_names or (has_unit and "".join(words[:-1]) in own_names):
            return quantity
        if quantity == "time" and has_unit and "".join(words[:-1]) in _WITH_UNIT:
            return quantity
    return None


def sounds_like(name: str, quantity: str) -> bool:
    """Return whether a longer name, as `Pack Current (A)`, tells of a quantity, and of no other one."""
    words = set(_words(name))
    bare = {word.rstrip("0123456789") for word in words}
    is_numbered = any(word[-1:].isdigit() for word in words) or find_unit("temperature", _words(name)[-1]) is not None
    own_words = (words | bare) - (
        set() if is_numbered and len(words) > 1 else {"t"}
    )  # `Cell3_T`; not the `T/R` of a relay
    is_named = bool(own_words & _PARTS[quantity]) or (quantity == "soc" and "stateofcharge" in "".join(_words(name)))
    return is_named and not words & set(_NEVER[quantity].split())


def is_wall_clock(name: str) -> bool:
    """Return whether a column's name says that it is a date with its time."""
    return "".join(_words(name)) in _WALL_CLOCKS


def unit_of(name: str, quantity: str) -> str | None:
    """Return the unit that a column's name ends in, as `UNITS` has it."""
    words = _words(name)
    if quantity == "time" and "".join(words) in _UNITS_IN_NAMES:
        return _UNITS_IN_NAMES["".join(words)]
    return find_unit(quantity, words[-1]) if len(words) > 1 else None


def find_unit(quantity: str, text: str) -> str | None:
    """Return a unit as `UNITS` has it, however it is written."""
    spelled = _SPELLINGS.get(text.lower(), text).lower()
    return next((unit for unit in UNITS[quantity] if unit.lower() == spelled), None)


def is_unit(text: str) -> bool:
    """Return whether a text is a unit, of a quantity or of something else that test rigs write."""
    return text.lower() in _OTHER_UNITS or any(find_unit(quantity, text) for quantity in UNITS)


def in_our_unit(values: FloatArray, quantity: str, unit: str) -> FloatArray:
    """Return values of a unit in ours: s, A, V, degC, fraction."""
    factor, offset = UNITS[quantity][unit]
    return values * factor + offset


def time_unit_of(name: str, columns: Mapping[str, FloatArray]) -> str | None:
    """Return the unit of a column of times: by a column of dates, its name or its values; None: not clear.

    Args:
        name: of the column.
        columns: (n,) values by name, of the whole table.
    """
    values = columns[name]
    finite = values[np.isfinite(values)]
    named, by_dates = unit_of(name, "time"), _unit_by_dates(values, columns)
    if by_dates or named or not len(finite):
        return by_dates or named or "s"
    for unit, from_s in (("us", 1e14), ("ms", 1e11), ("s", UNIX_FROM_S)):
        if finite[0] > from_s:
            return unit
    steps = np.diff(finite)
    steps = steps[steps > 0.0]
    is_slow = bool(len(steps)) and float(np.quantile(steps, 0.75)) >= SLOW_STEP_S and not np.any(finite % 1.0)
    return None if is_slow else "s"


def _unit_by_dates(values: FloatArray, columns: Mapping[str, FloatArray]) -> str | None:
    """Return the unit in which a column of times spans as long as a column of dates and times."""
    for name, dates_s in columns.items():
        if not is_wall_clock(name):
            continue
        rows = np.flatnonzero(np.isfinite(values) & np.isfinite(dates_s))
        if not len(rows) or dates_s[rows[0]] < UNIX_FROM_S or values[rows[0]] > UNIX_FROM_S:
            continue
        span, span_s = np.ptp(values[rows]), np.ptp(dates_s[rows])
        for unit, (factor, _) in UNITS["time"].items():
            if span_s > LEAST_SPAN_S and abs(span * factor / span_s - 1.0) < SAME_SPAN:
                return unit
    return None


def _score_of_name(name: str, quantity: str) -> float:
    words = set(_words(name))
    if quantity == "time" and is_wall_clock(name):
        return 6.0
    if quantity_of(name) == quantity:
        score = 10.0
    elif sounds_like(name, quantity):
        score = 5.0
    else:
        return 0.0
    score += 3.0 if unit_of(name, quantity) else 0.0
    score -= 4.0 if words & _RATHER_NOT else 0.0
    score += 1.0 if quantity == "voltage" and words & _FULL_CELL else 0.0
    return score + (2.0 if quantity == "time" and words & _OF_THE_WHOLE else 0.0)


def _score_of_values(values: FloatArray, quantity: str, unit: str | None) -> float:
    """How well the numbers go with a quantity; far below 0 where they cannot be it."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return -100.0
    if quantity == "time":
        return _score_of_times(finite)
    usual = float(np.median(finite if unit is None else in_our_unit(finite, quantity, unit)))
    if quantity == "current":
        steps = np.diff(finite)
        is_counter = len(finite) > 3 and np.all(steps >= 0.0) and np.count_nonzero(steps) > 0.5 * len(steps)
        return (-3.0 if is_counter else 0.0) - (3.0 if abs(usual) > 5000.0 and unit else 0.0)
    if quantity == "voltage":
        return 2.0 if 0.5 < usual < 10.0 or (unit is None and 500.0 < usual < 10_000.0) else -3.0
    limits = (-60.0, 400.0 if unit is None else 150.0) if quantity == "temperature" else (-0.05, 105.0)
    return 1.0 if limits[0] < usual < limits[1] else -100.0


def _score_of_times(times_s: FloatArray) -> float:
    steps = np.diff(times_s)
    if not len(steps) or not np.any(steps):
        return 0.0
    if times_s[0] > 1e9 and not np.any(steps % _DAY_S):
        return -20.0  # a date without its time of the day
    whole = bool(np.all(times_s == np.floor(times_s)))
    score = -6.0 if np.any(steps < 0.0) else 3.0  # a clock that begins again with each step is no time of the test
    return score - (2.0 if whole and np.any(steps == 0.0) else 0.0) + (0.0 if whole else 1.0)


def _words(name: str) -> list[str]:
    parts = re.split(r"[\s_/()\[\]{},~-]+|(?<=[a-z]{2})(?=[A-Z][a-z])", name.strip())
    return [word.lower() for word in parts if word and word[0] != "#"] or [""]


_STATE_NAMES = {
    "state", "status", "md", "mode", "steptype", "stepname", "step", "command", "instructionname",
    "工步类型", "工步名称", "状态", "工作模式",
}  # fmt: skip
_DISCHARGING = re.compile(r"d|dis\b.*|dch\w*|.*dchg\w*|.*discharg\w*|.*放电", re.IGNORECASE)
_CHARGING = re.compile(r"c|cha|chg|.*\bchg|.*_chg|.*charg\w*|.*充电", re.IGNORECASE)
SIGN_EVIDENCE = 0.4  # least correlation of voltage and current that decides the sign
REST_SHARE, FLOW_SHARE = 0.02, 0.2  # at rest below this share of the largest current, flowing above
MIXED_RISES = 0.15  # least share of rises of the current either way
_BLOCKS = 200  # blocks of a test over which charge counts: in a slow one each row changes less than its meter resolves


def states_direction(name: str) -> bool:
    """Return whether a column of this name may say what the cell does."""
    return re.sub(r"[\W\d_]", "", name.lower()) in _STATE_NAMES


def state_of(word: str) -> float:
    """Return -1 for a word that means discharge, 1 for charge, 0 for another."""
    word = word.strip(' \t"')
    if _DISCHARGING.fullmatch(word):
        return -1.0
    return 1.0 if _CHARGING.fullmatch(word) else 0.0


def signed(current: FloatArray, columns: Mapping[str, FloatArray]) -> tuple[FloatArray, str | None]:
    """Return a (n,) current, positive on discharge, whose sign another column tells; None: it has its own sign.

    Args:
        current: as it is in the table.
        columns: of the table; one of words has -1, 0 and 1.

    Returns:
        The current, and the name of the column of its direction.
    """
    finite = current[np.isfinite(current)]
    if not len(finite) or np.min(finite) < 0.0:
        return current, None
    for name, values in columns.items():
        if states_direction(name) and {-1.0, 1.0} <= set(np.unique(values[np.isfinite(values)])) <= {-1.0, 0.0, 1.0}:
            return np.where(values == 0.0, current, -values * current), name
    return current, None


def charges_positive(current: FloatArray, voltage: FloatArray) -> bool:
    """Return whether the voltage rises with the current, from row to row or along the test: then charging is positive.

    Args:
        current: (n,) as it is in the table.
        voltage: (n,) at the same rows, in any unit.
    """
    is_finite = np.isfinite(current) & np.isfinite(voltage)
    current, voltage = current[is_finite], voltage[is_finite]
    if flows_both_ways_unsigned(current, voltage):
        return False
    together = _alike(np.diff(current), np.diff(voltage))
    if abs(together) < SIGN_EVIDENCE:
        ends = np.unique(np.linspace(0, len(voltage), _BLOCKS + 1, dtype=np.intp))
        starts = ends[:-1]
        if len(starts) < 2:
            return False
        mean = np.add.reduceat(current, starts) / np.diff(ends)
        together = _alike(mean[:-1], np.diff(voltage[starts]))
    return together > SIGN_EVIDENCE


def flows_both_ways_unsigned(current: FloatArray, voltage: FloatArray) -> bool:
    """Return whether a current that is never negative lets the voltage fall at some of its rises, and rise at others.

    Args:
        current: (n,) as it is in the table, finite.
        voltage: (n,) at the same rows, finite, in any unit.
    """
    if len(current) < 3 or np.min(current) < 0.0:
        return False
    largest = float(np.max(current))
    rises = np.flatnonzero((current[:-1] <= REST_SHARE * largest) & (current[1:] >= FLOW_SHARE * largest))
    steps = voltage[rises + 1] - voltage[rises]
    falls = int(np.sum(steps < 0.0))
    return min(falls, len(steps) - falls) >= MIXED_RISES * max(len(steps), 2 / MIXED_RISES)


def _alike(one: FloatArray, other: FloatArray) -> float:
    """How far two (n,) arrays are each other's multiple, -1..1; 0 where one has nothing in it."""
    size = float(np.linalg.norm(one) * np.linalg.norm(other))
    return float(one @ other) / size if size > 0.0 else 0.0
