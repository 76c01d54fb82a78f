"""Whether numbers can be cell voltages or temperatures: the unit that is found, or that it is not known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.battery.source import TEMPERATURE_UNITS, VOLTAGE_UNITS, ZERO_AT
from app.sources.dbc.definitions import BitLayout, SignalDefinition
from app.sources.dbc.infer.bus_survey import ReceivedSignal
from app.sources.dbc.infer.proposal import (
    converted,
    declared_fit,
    fit,
    fits,
)


def signal(unit="", scale=1.0, length=16, *, is_signed=False, choices=None):
    return SignalDefinition("x", BitLayout(0, length, is_signed=is_signed, scale=scale), unit, choices=choices or {})


def received(raw, scale=1.0):
    numbers = np.array(raw, np.int64)
    return ReceivedSignal(np.arange(len(numbers)) * 1_000_000, numbers * scale, numbers)


def fitted(kind, raw, unit="", scale=1.0, **layout):
    return fit(kind, [(signal(unit, scale, **layout), received(raw, scale))])


@given(
    st.sampled_from([unit for unit in VOLTAGE_UNITS if unit != "0.1V"]),
    st.lists(st.floats(2.5, 4.25), min_size=2, max_size=20),
)
def test_the_unit_of_any_cell_voltages_without_one_is_found(unit, volts):
    factor = VOLTAGE_UNITS[unit]
    raw = [round(volt / factor) for volt in volts] if unit != "V" else volts
    values = np.array(raw, float)
    found = fit(
        "voltage", [(signal(), ReceivedSignal(np.arange(len(raw)), values, np.rint(values * 1000).astype(np.int64)))]
    )
    assert found.unit in ("", unit)
    got = converted("voltage", values, found.unit, "")
    np.testing.assert_allclose(got, volts, atol=0.51 * factor if unit != "V" else 1e-9)
    assert found.others == ()
    assert fits(found)


@given(
    st.sampled_from(sorted(set(TEMPERATURE_UNITS) - {"degF"})),  # 77 is sound in degC too: a DBC has to name degF
    st.lists(st.floats(15.0, 60.0), min_size=2, max_size=20),
)
def test_a_temperature_without_a_unit_is_right_or_the_right_unit_is_named_as_possible_too(unit, degrees):
    zero = ZERO_AT.get(unit, 0.0)
    raw = [round((degree - zero) / TEMPERATURE_UNITS[unit]) for degree in degrees]
    found = fitted("temperature", raw)
    got = converted("temperature", np.array(raw, float), found.unit, "")
    is_right = np.allclose(got, degrees, atol=0.51 * TEMPERATURE_UNITS[unit])
    assert is_right or unit in found.others


@pytest.mark.parametrize(
    ("raw", "unit"),
    [([1850, 2120, 3010], "0.01degC"), ([3010, 3690, 3700], "0.01degC"), ([18, 25, 40], ""), ([-5, 3, 40], "")],
)
def test_a_range_that_only_one_unit_allows_decides(raw, unit):
    found = fitted("temperature", raw, is_signed=True)
    assert (found.unit, found.others) == (unit, ())


@pytest.mark.parametrize(
    ("code", "is_signed"), [(0, False), (0xFFFF, False), (-1, True), (-(1 << 15), True), ((1 << 15) - 1, True)]
)
def test_a_number_that_means_not_measured_is_no_voltage(code, is_signed):
    found = fitted("voltage", [3700, 3710, code, code], "mV", is_signed=is_signed)
    assert found.invalid == (code,)
    assert (found.share, found.n) == (1.0, 2)
    assert found.low == pytest.approx(3.7)


@pytest.mark.parametrize(
    ("raw", "unit", "is_fit"),
    [
        ([12_000, 13_800, 14_000], "mV", False),
        ([0, 0, 0], "", False),
        ([3700] * 90 + [9000] * 10, "mV", True),  # a few out of range
        ([3700] * 50 + [9000] * 50, "mV", False),
    ],
)
def test_numbers_that_are_mostly_no_cell_voltage_do_not_fit(raw, unit, is_fit):
    assert fits(fitted("voltage", raw, unit)) is is_fit
    assert not fits(fit("voltage", []))
    assert fitted("temperature", [0, 5, 9], "degC").invalid == (), "zero degrees are a temperature"


@pytest.mark.parametrize(
    ("kind", "declared", "expected"),
    [
        ("voltage", signal("mV"), 1.0),
        ("voltage", signal(""), 0.0),
        ("voltage", signal("A"), -1.0),
        ("voltage", signal("degC"), -1.0),
        ("voltage", signal("V", length=4), -1.0),
        ("voltage", signal("mV", length=8), -1.0),  # 255 mV at most
        ("voltage", signal("V", 0.02, length=8), 1.0),
        ("voltage", signal("V", choices={0: "off"}), -1.0),
        ("temperature", signal("degC", length=8), 1.0),
        ("temperature", signal("", length=8), 0.0),
        ("temperature", signal("V", length=8), -1.0),
        ("temperature", signal("degC", length=4), -1.0),
    ],
)
def test_what_a_declaration_can_be(kind, declared, expected):
    assert declared_fit(kind, declared) == expected
