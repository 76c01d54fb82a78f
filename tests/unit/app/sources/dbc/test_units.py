import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.sources.dbc.lanes import conversion, known_conversion


def value(kind, unit, number):
    factor, zero = conversion(kind, unit)
    return number * factor + zero


@pytest.mark.parametrize(
    ("kind", "unit", "number", "expected"),
    [
        ("voltage", "V", 3.7, 3.7),
        ("voltage", "mV", 3700, 3.7),
        ("voltage", "0.1mV", 37000, 3.7),
        ("voltage", "100uV", 37000, 3.7),
        ("voltage", "100 µV", 37000, 3.7),
        ("voltage", "Volts", 3.7, 3.7),
        ("voltage", "millivolts", 3700, 3.7),
        ("voltage", "0,1 V", 37, 3.7),
        ("pack_voltage", "kV", 0.4, 400.0),
        ("charger_voltage", "dV", 4000, 400.0),
        ("current", "A", 120, 120.0),
        ("current", "mA", 120000, 120.0),
        ("current", "Amps", 120, 120.0),
        ("current", "10mA", 12000, 120.0),
        ("charger_current", "dA", 120, 12.0),
        ("resistance", "mOhm", 2, 0.002),
        ("resistance", "mΩ", 2, 0.002),
        ("resistance", "uOhms", 2000, 0.002),
        ("temperature", "degC", 25, 25.0),
        ("temperature", "°C", 25, 25.0),
        ("temperature", "[C]", 25, 25.0),
        ("temperature", "0.1degC", 250, 25.0),
        ("temperature", "K", 298.15, 25.0),
        ("temperature", "0.1K", 2981.5, 25.0),
        ("temperature", "degF", 77, 25.0),
        ("temperature", "ddegC", 250, 25.0),
        ("soc", "%", 64, 0.64),
        ("soc", "0.5%", 128, 0.64),
    ],
)
def test_a_unit_as_dbcs_write_it_becomes_the_si_unit(kind, unit, number, expected):
    assert known_conversion(kind, unit) is not None
    assert value(kind, unit, number) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("kind", "unit"),
    [
        ("voltage", "A"),
        ("voltage", "degC"),
        ("current", "V"),
        ("temperature", "V"),
        ("soc", "V"),
        ("voltage", ""),
        *((kind, unit) for kind in ("voltage", "current") for unit in ("Ah", "VA", "Wh", "V/s", "pV", "1/10 V", "0")),
    ],
)
def test_a_unit_of_another_quantity_or_one_that_looks_alike_is_none_and_leaves_the_number(kind, unit):
    assert known_conversion(kind, unit) is None
    assert conversion(kind, unit) == (1.0, 0.0)


@given(
    st.sampled_from([("voltage", "V"), ("current", "A"), ("resistance", "Ohm")]),
    st.sampled_from([("", 1.0), ("m", 1e-3), ("u", 1e-6), ("k", 1e3), ("d", 0.1), ("c", 0.01)]),
    st.sampled_from([("", 1.0), ("0.1", 0.1), ("10", 10.0), ("2,5", 2.5)]),
    st.sampled_from(["{}", " {} ", "[{}]", "({})"]),
)
def test_a_number_a_prefix_and_a_unit_multiply_whatever_stands_around_them(kind, prefix, count, around):
    unit = around.format(count[0] + prefix[0] + kind[1])
    assert known_conversion(kind[0], unit) == (pytest.approx(prefix[1] * count[1]), 0.0)


@given(st.sampled_from(["voltage", "current", "temperature", "soc", "resistance", "other"]), st.text(max_size=8))
def test_any_text_is_a_unit_of_a_quantity_or_none_of_it(kind, unit):
    found = known_conversion(kind, unit)
    assert conversion(kind, unit) == (found or (1.0, 0.0))
    assert found is None or all(math.isfinite(each) for each in found)
