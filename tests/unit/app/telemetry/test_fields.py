from dataclasses import dataclass
from typing import Annotated

from app.telemetry import Accumulator, Cells
from app.telemetry.fields import INTERNAL, TREND, Kept, SentAs, Unit, described, history_fields, marked, units


@dataclass(frozen=True)
class Example:
    voltage_v: Annotated[float | None, Unit("V", "voltage", 3), Kept("voltage")]
    t_ns: Annotated[int, SentAs("time", 1e9)]
    raw: Annotated[bytes, INTERNAL, TREND]
    name: str


def test_a_field_is_described_in_order_with_its_type_and_its_names():
    voltage, time, raw, name = described(Example)
    assert (voltage.type, voltage.mark(Unit).decimals, voltage.mark(SentAs)) == (float | None, 3, None)
    assert (time.name, time.json_name, time.is_internal) == ("t_ns", "time", False)
    assert raw.is_internal
    assert (name.type, name.json_name, name.marks) == (str, "name", ())


def test_names_are_found_by_their_marks():
    assert marked(Example, TREND) == ("raw",)
    assert [name for name, _ in units(Example)] == ["voltage_v"]
    assert [(name, part) for name, _, part in history_fields(Example)] == [("voltage_v", "voltage")]


def test_every_number_of_the_battery_has_a_unit_that_its_name_agrees_with():
    endings = {
        "V": "_v",
        "A": "_a",
        "W": "_w",
        "degC": "_degc",
        "ohm": "_ohm",
        "Ah": "_ah",
        "Wh": "_wh",
        "%": "_percent",
        "s": "_s",
    }
    for owner in (Accumulator, Cells):
        for name, unit in units(owner):
            assert name.endswith(endings.get(unit.unit, "")), name
            assert unit.unit in endings or unit.unit == "1"
        for field in described(owner):
            is_number = "float" in str(field.type)
            assert is_number <= (field.mark(Unit) is not None), field.name
