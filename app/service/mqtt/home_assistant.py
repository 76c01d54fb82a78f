"""Tells Home Assistant by MQTT discovery what to show: one device a car, with its main values.

https://www.home-assistant.io/integrations/mqtt/#device-discovery-payload
"""

import re
from typing import NamedTuple

from app import __version__

TOPIC = "homeassistant/device/{}/config"  # retained, outside the prefix of the car's topics


class _Sensor(NamedTuple):
    """A value of the topic `accumulator`; `factor` brings it into the unit."""

    field: str
    name: str
    unit: str
    device_class: str
    factor: int = 1


_SENSORS = (
    _Sensor("soc", "State of charge", "%", "battery", 100),
    _Sensor("voltage_v", "Voltage", "V", "voltage"),
    _Sensor("current_a", "Current, positive on discharge", "A", "current"),
    _Sensor("power_w", "Power, positive on discharge", "W", "power"),
    _Sensor("voltage_min_v", "Lowest cell voltage", "V", "voltage"),
    _Sensor("voltage_max_v", "Highest cell voltage", "V", "voltage"),
    _Sensor("temperature_min_degc", "Coldest cell", "°C", "temperature"),
    _Sensor("temperature_max_degc", "Hottest cell", "°C", "temperature"),
)


def discovery(prefix: str, name: str, url: str | None = None) -> tuple[str, dict[str, object]]:
    """Return topic and payload that announce a car.

    Args:
        prefix: of the car's topics; different cars have different ones.
        name: what it is called.
        url: of its pages.
    """
    unique = "voltwall_" + re.sub(r"[^A-Za-z0-9_-]", "_", prefix)
    device: dict[str, object] = {"identifiers": [unique], "name": name, "manufacturer": "Voltwall"}
    if url is not None:
        device["configuration_url"] = url
    components: dict[str, object] = {each.field: _component(each, prefix, unique) for each in _SENSORS}
    components["alarms"] = {
        "platform": "sensor",
        "name": "Alarms",
        "unique_id": f"{unique}_alarms",
        "state_topic": f"{prefix}/alarms",
        "value_template": "{{ value_json | length }}",
        "state_class": "measurement",
    }
    payload: dict[str, object] = {
        "device": device,
        "origin": {"name": "voltwall", "sw_version": __version__},
        "availability": [{"topic": f"{prefix}/status"}],  # online, offline
        "components": components,
    }
    return TOPIC.format(unique), payload


def _component(sensor: _Sensor, prefix: str, unique: str) -> dict[str, object]:
    value = f"value_json.{sensor.field}"
    scaled = value if sensor.factor == 1 else f"{value} * {sensor.factor}"
    return {
        "platform": "sensor",
        "name": sensor.name,
        "unique_id": f"{unique}_{sensor.field}",
        "state_topic": f"{prefix}/accumulator",
        "value_template": f"{{{{ {scaled} if {value} is not none else None }}}}",  # None: unknown there
        "unit_of_measurement": sensor.unit,
        "device_class": sensor.device_class,
        "state_class": "measurement",
    }
