"""Recorded fields of a battery with a DBC: names, units and numbers of elements of its fields.

A name of the team's memory map means the same here. Values are floating-point numbers in the unit, NaN where missing.
"""

from dataclasses import dataclass

from app.battery.battery import Battery, each_cell
from app.battery.serial import SerialMapping
from app.battery.source import STATES, DbcMapping

FIELD_OF_KIND = {
    "voltage": "v",
    "balancing": "balancing",
    "resistance": "resistance",
    "current": "i_fs",
    "pack_voltage": "v_tot",
    "soc": "soc",
    "charger_voltage": "charger_voltage",
    "charger_current": "charger_current",
}
IS_NEW = "v.is_new"  # in rows: 1 where a cell's voltage is new within the row's period, 0 where it is held
EXTREMES = (("v", "V"), ("t", "degC"))  # fields that also have lowest, highest and mean


@dataclass(frozen=True, slots=True)
class BatteryField:
    """One value, or one a cell or sensor."""

    name: str
    count: int | None  # None: one value without an index
    unit: str
    resolution: float  # to which a table of text shows it


def has_sensor_a_cell(battery: Battery) -> bool:
    """Sensors and cells count alike: a reading is a cell's temperature."""
    return battery.sensors == each_cell(battery.n_cells)


def battery_fields(battery: Battery, source: DbcMapping | SerialMapping) -> dict[str, BatteryField]:
    """Return what a session of this battery may hold, by name, in the order in which people want to read it."""
    n = battery.n_cells
    listed = [
        BatteryField("i_fs", None, "A", 1e-3),
        BatteryField("v_tot", None, "V", 1e-3),
        BatteryField("soc", None, "1", 1e-4),
    ]
    for name, unit in EXTREMES:
        listed += [BatteryField(f"{name}_{which}", None, unit, 1e-4) for which in ("min", "max", "avg")]
        listed += [BatteryField(f"{name}_{which}_id", None, "", 1.0) for which in ("min", "max")]
    listed += [BatteryField("v", n, "V", 1e-5), BatteryField("t", n, "degC", 1e-2)]
    if battery.n_sensors and not has_sensor_a_cell(battery):
        listed.append(BatteryField("sensor", battery.n_sensors, "degC", 1e-2))
    if "balancing" in source.kinds:
        listed.append(BatteryField("balancing", n, "", 1.0))
    if "resistance" in source.kinds:
        listed.append(BatteryField("resistance", n, "ohm", 1e-6))
    listed += [BatteryField("charger_voltage", None, "V", 1e-3), BatteryField("charger_current", None, "A", 1e-3)]
    listed += [BatteryField(f"state.{name}", None, "", 1.0) for name in STATES if f"state.{name}" in source.kinds]
    listed += [BatteryField(f"limit.{name}", None, _unit_of(name), 1e-3) for name in battery.limits]
    return {field.name: field for field in listed}


def ages_of(source: DbcMapping | SerialMapping) -> dict[str, float | None]:
    """Return from what age on a field's values are missing, where the profile gives it [s]."""
    ages = source.ages
    temperature = ages.pop("temperature", None)
    return {FIELD_OF_KIND[name]: age for name, age in ages.items() if name in FIELD_OF_KIND} | {
        "t": temperature,
        "sensor": temperature,
    }


def _unit_of(limit: str) -> str:
    return {"v": "V", "degc": "degC", "a": "A"}[limit.rpartition("_")[2]]
