"""What users, test rigs and other systems call their columns: the quantity that a name means, and its unit."""

import re
from collections.abc import Iterable
from itertools import chain

from app.estimation.arrays import FloatArray

Conversion = tuple[float, float]  # factor and offset into s, A, V, degC, fraction
UNITS: dict[str, dict[str, Conversion]] = {
    "time": {"s": (1, 0), "ms": (1e-3, 0), "us": (1e-6, 0), "min": (60, 0), "h": (3600, 0)},
    "current": {"A": (1, 0), "mA": (1e-3, 0), "0.1A": (0.1, 0)},
    "voltage": {"V": (1, 0), "mV": (1e-3, 0), "0.1mV": (1e-4, 0)},
    "temperature": {"degC": (1, 0), "K": (1, -273.15), "degF": (5 / 9, -160 / 9), "0.1degC": (0.1, 0)},
    "soc": {"percent": (0.01, 0), "fraction": (1, 0)},
}
_SPELLINGS = {  # other ways to write a unit, in lower case
    "sec": "s", "seconds": "s", "hh:mm:ss": "s", "h:min:s.ms": "s", "hr": "h", "hours": "h", "amps": "A", "volts": "V",
    "c": "degC", "°c": "degC", "oc": "degC", "f": "degF", "°f": "degF",
    "1": "fraction", "frac": "fraction", "%": "percent", "pct": "percent",
}  # fmt: skip
_NAMES = {  # whole names without their unit, in lower case and without spaces
    "time": "time testtime test t elapsed elapsedtime timestamp seconds totaltime zeit tid",
    "current": "current i <i> cur cellcurrent icell ibatt ibat amps batterycurrent strom strøm",
    "voltage": "voltage v u cellvoltage terminalvoltage vcell ucell vbatt vbat volts ewe ecell potential"
    " batteryvoltage spannung spenning",
    "temperature": "temperature temp celltemperature celltemp tcell t1 auxtemperature1 surfacetemperature surfacetemp"
    " batterytemperature batterytemp temperatur",
    "soc": "soc stateofcharge",
}
_WALL_CLOCKS = ("datetime", "date", "dateandtime", "absolutetime", "systemtime")
_PARTS = {  # what occurs in longer names
    "time": re.compile(r"time|seconds|\bt\b", re.IGNORECASE),
    "current": re.compile(r"current|\bi\b|(?<!s)amp", re.IGNORECASE),
    "voltage": re.compile(r"cell|volt|\bv|vcell|\bu\d", re.IGNORECASE),
    "temperature": re.compile(r"temp|therm|ntc|degc|°c", re.IGNORECASE),
    "soc": re.compile(r"\bsoc\b|state.?of.?charge", re.IGNORECASE),
}


def quantity_of(name: str) -> str | None:
    """Return the quantity that a column's whole name means, None where it means none, or is in an unknown unit."""
    if name.strip() == "T":
        return "temperature"
    words = _words(name)
    for quantity, names in _NAMES.items():
        known = names.split()
        if "".join(words) in known or ("".join(words[:-1]) in known and find_unit(quantity, words[-1])):
            return quantity
    return None


def sounds_like(name: str, quantity: str) -> bool:
    """Return whether a longer name, as `Pack Current (A)`, tells of a quantity."""
    return _PARTS[quantity].search(name) is not None


def column_of(quantity: str, names: Iterable[str]) -> str:
    """Return the first column that is named as a quantity, preferably with a unit, else sounds like it, else ""."""
    names = list(names)
    exact = [name for name in names if quantity_of(name) == quantity]
    with_unit = [name for name in exact if unit_of(name, quantity)]
    return next(chain(with_unit, exact, (name for name in names if sounds_like(name, quantity))), "")


def is_wall_clock(name: str) -> bool:
    """Return whether a column's name says that it is a date with its time."""
    return "".join(_words(name)) in _WALL_CLOCKS


def unit_of(name: str, quantity: str) -> str | None:
    """Return the unit that a column's name ends in, as `UNITS` has it."""
    words = _words(name)
    return find_unit(quantity, words[-1]) if len(words) > 1 else None


def find_unit(quantity: str, text: str) -> str | None:
    """Return a unit as `UNITS` has it, however it is written."""
    spelled = _SPELLINGS.get(text.lower(), text).lower()
    return next((unit for unit in UNITS[quantity] if unit.lower() == spelled), None)


def is_unit(text: str) -> bool:
    """Return whether a text is a unit of any quantity."""
    return any(find_unit(quantity, text) for quantity in UNITS)


def in_our_unit(values: FloatArray, quantity: str, unit: str) -> FloatArray:
    """Return values of a unit in ours: s, A, V, degC, fraction."""
    factor, offset = UNITS[quantity][unit]
    return values * factor + offset


def _words(name: str) -> list[str]:
    return [word for word in re.split(r"[\s_/()\[\]{}]+", name.strip().lower()) if word and word[0] != "#"] or [""]
