"""What users and test rigs call their columns, and what a column so called holds."""

from __future__ import annotations

import re

NAMES = {
    "time_s": (
        "time",
        "testtime",
        "test",
        "t",
        "elapsed",
        "elapsedtime",
        "timestamp",
        "seconds",
        "totaltime",
        "zeit",
        "tid",
    ),
    "current_a": (
        "current",
        "i",
        "<i>",
        "cur",
        "cellcurrent",
        "icell",
        "ibatt",
        "ibat",
        "amps",
        "batterycurrent",
        "strom",
        "strøm",
    ),
    "voltage_v": (
        "voltage",
        "v",
        "u",
        "cellvoltage",
        "terminalvoltage",
        "vcell",
        "ucell",
        "vbatt",
        "vbat",
        "volts",
        "ewe",
        "ecell",
        "potential",
        "batteryvoltage",
        "spannung",
        "spenning",
    ),
    "temperature_degc": (
        "temperature",
        "temp",
        "celltemperature",
        "celltemp",
        "tcell",
        "t1",
        "auxtemperature1",
        "surfacetemperature",
        "surfacetemp",
        "batterytemperature",
        "batterytemp",
        "temperatur",
    ),
    "soc": ("soc", "stateofcharge"),
}
WALL_NAMES = ("datetime", "date", "dateandtime", "absolutetime", "systemtime")  # clocks, if there is no other
UNITS = {
    "time_s": {
        "s": 1.0,
        "sec": 1.0,
        "seconds": 1.0,
        "ms": 1e-3,
        "min": 60.0,
        "h": 3600.0,
        "hr": 3600.0,
        "hours": 3600.0,
        "hh:mm:ss": 1.0,
        "h:min:s.ms": 1.0,
    },
    "current_a": {"a": 1.0, "ma": 1e-3, "amps": 1.0},
    "voltage_v": {"v": 1.0, "mv": 1e-3, "volts": 1.0},
    "temperature_degc": {"c": 1.0, "degc": 1.0, "°c": 1.0, "oc": 1.0, "k": 1.0},
    "soc": {"1": 1.0, "frac": 1.0, "%": 0.01, "percent": 0.01, "pct": 0.01},
}


def field_of(name: str) -> tuple[str, float] | None:
    """Return the field a header text names and the factor of its unit, None for a column that is not ours."""
    if name.strip() == "T":
        return "temperature_degc", 1.0
    words = _words(name)
    for field, known in NAMES.items():
        for cut in (len(words), len(words) - 1):
            if cut < 1 or "".join(words[:cut]) not in known:
                continue
            unit = words[cut] if cut < len(words) else None
            if unit is None:
                return field, 1.0
            if unit in UNITS[field]:
                return field, UNITS[field][unit]
    return None


def _words(name: str) -> list[str]:
    return [word for word in re.split(r"[\s_/()\[\]{}]+", name.strip().lower()) if word]


def is_wall_clock(name: str) -> bool:
    """Return whether a header text names a date with its time."""
    return "".join(_words(name)) in WALL_NAMES
