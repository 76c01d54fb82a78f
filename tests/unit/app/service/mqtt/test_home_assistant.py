"""What Home Assistant is told: every value by the template that its own engine renders."""

from typing import Any, cast

import pytest

from app.service.mqtt.home_assistant import discovery

jinja2 = pytest.importorskip("jinja2")


def rendered(template: str, value: object) -> str:
    return str(jinja2.Environment(autoescape=False).from_string(template).render(value_json=value))


def components(prefix: str = "pit/red") -> dict[str, dict[str, Any]]:
    return cast("dict[str, dict[str, Any]]", discovery(prefix, "red")[1]["components"])


def test_values_come_in_their_units_and_what_is_missing_is_unknown() -> None:
    found = components()
    assert rendered(found["soc"]["value_template"], {"soc": 0.25}) == "25.0"
    assert rendered(found["voltage_min_v"]["value_template"], {"voltage_min_v": 3.7}) == "3.7"
    assert rendered(found["soc"]["value_template"], {"soc": None}) == "None"
    assert rendered(found["alarms"]["value_template"], [{}, {}]) == "2"


def test_cars_of_different_topics_are_different_devices() -> None:
    red, blue = (discovery(prefix, "car") for prefix in ("pit/red", "pit/blue"))
    assert red[0] != blue[0]
    ids = {each["unique_id"] for prefix in ("pit/red", "pit/blue") for each in components(prefix).values()}
    assert len(ids) == 2 * len(components())


def test_the_address_of_the_pages_is_left_out_where_it_is_not_known() -> None:
    assert "configuration_url" not in cast("dict[str, Any]", discovery("pit", "car")[1]["device"])
    known = cast("dict[str, Any]", discovery("pit", "car", "http://pit:8000")[1]["device"])
    assert known["configuration_url"] == "http://pit:8000"
