"""Units as DBCs write them: factor and zero into V, A, degC, a fraction of 1, ohm."""

import re

_PREFIX = {"": 1.0, "m": 1e-3, "u": 1e-6, "µ": 1e-6, "k": 1e3, "c": 1e-2, "d": 0.1}
_CELSIUS, _FAHRENHEIT, _KELVIN = (1.0, 0.0), (5 / 9, -160 / 9), (1.0, -273.15)
_TEMPERATURES = {
    **dict.fromkeys(
        ("degc", "degreec", "degreesc", "c", "°c", "cel", "celsius", "degcelsius", "grad", "gradc", "oc", "deg"),
        _CELSIUS,
    ),
    **dict.fromkeys(("f", "degf", "°f", "fahrenheit"), _FAHRENHEIT),
    **dict.fromkeys(("k", "kelvin"), _KELVIN),
    "ddegc": (0.1, 0.0),
    "cdegc": (0.01, 0.0),
}
_WORDS = {"volt": "v", "volts": "v", "ampere": "a", "amps": "a", "amp": "a", "amperes": "a", "millivolt": "mv",
          "millivolts": "mv", "milliampere": "ma", "milliamps": "ma"}  # fmt: skip
_BASE = {
    "voltage": "v", "pack_voltage": "v", "charger_voltage": "v", "current": "a", "charger_current": "a",
    "resistance": "ohm",
}  # fmt: skip


def conversion(kind: str, unit: str) -> tuple[float, float]:
    """Return factor and zero of a DBC's unit for a quantity; 1 and 0 where the unit is unknown or none."""
    return known_conversion(kind, unit) or (1.0, 0.0)


def known_conversion(kind: str, unit: str) -> tuple[float, float] | None:
    """Return factor and zero of a DBC's unit for a quantity; None where the unit is not one of it."""
    text = re.sub(r"[\s_\[\]()]", "", unit)
    count, text = _count(text)
    low = text.lower()
    if kind == "soc":
        return {"%": (0.01 * count, 0.0), "percent": (0.01 * count, 0.0), "pct": (0.01 * count, 0.0)}.get(low)
    if kind == "temperature":
        found = _TEMPERATURES.get(low.replace("�", "°").replace("º", "°").replace("â", ""))
        return (found[0] * count, found[1]) if found else None
    base = _BASE.get(kind, "")
    low = _WORDS.get(low, low).replace("ω", "ohm").replace("ohms", "ohm")
    if not base or not low.endswith(base):
        return None
    prefix = text[: len(low) - len(base)] if len(text) == len(low) else low[: -len(base)]
    factor = _PREFIX.get(prefix, _PREFIX.get(prefix.lower()))
    return None if factor is None else (factor * count, 0.0)


def _count(text: str) -> tuple[float, str]:
    """A number in front of the unit, as in 0.1mV or 100uV."""
    found = re.match(r"(\d+(?:[.,]\d+)?)[*x]?(.+)", text)
    return (float(found[1].replace(",", ".")), found[2]) if found else (1.0, text)
