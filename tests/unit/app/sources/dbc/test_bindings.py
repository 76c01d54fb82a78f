import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.battery.battery import Battery, SignalName
from app.battery.source import CellSignals, DbcMapping, ScalarSignal, StateSignal
from app.sources.dbc.bindings import bind_signals, channel, conversion, find_signals, known_conversion, segments_of
from app.sources.dbc.dbc_file import parse_definitions
from tests.peer_messages import HEAD


def definitions(*messages):
    return parse_definitions((HEAD + "\n".join(messages) + "\n").encode(), "x.dbc")


def message(can_id, name, *signals, length=8):
    lines = [f"BO_ {can_id} {name}: {length} BMS"]
    return "\n".join([*lines, *(f' SG_ {each} : {16 * i}|16@1+ (1,0) [0|0] "mV" X' for i, each in enumerate(signals))])


def troubles_of(entry, n_cells=2, **source):
    found = bind_signals(
        Battery("x", (n_cells,)),
        DbcMapping(("x.dbc",), {"voltage": (entry,)}, **source),
        definitions(message(1, "M", "V1", "V2"), message(2, "N", "V1", "I")),
    )
    return [(each.line, each.field, each.what.code) for each in found.troubles]


@given(st.integers(1, 12), st.integers(0, 30), st.integers(0, 12))
def test_groups_of_cells_follow_each_other_from_the_first(group_cells, group, cell):
    entry = CellSignals("V", base={"group": 1, "cell": 0}, group_cells=group_cells, first=3)
    parts = {"group": np.array([group]), "cell": np.array([cell])}
    expected = 3 + (group - 1) * group_cells + cell
    assert channel(entry, (400,), parts)[0] == (expected if 0 <= expected < 400 else -1)


def test_an_order_says_which_cell_the_kth_value_is_of():
    entry = CellSignals("V", order=(2, 0, 1))
    assert channel(entry, (4,), {"cell": np.arange(5)}).tolist() == [2, 0, 1, 3, -1]


def test_a_sensor_is_of_the_segment_of_its_first_cell():
    battery = Battery("x", (2, 3), sensors=((0,), (1, 2), (4,), ()))
    assert segments_of(battery, "temperature") == (3, 1)
    assert segments_of(battery, "voltage") == (2, 3)


def test_what_of_a_profile_fits_nothing_is_told_by_line_and_field():
    assert troubles_of(CellSignals("W{cell}", line=7)) == [(7, "source.voltage[0].signal", "no-signal-fits")]
    assert troubles_of(CellSignals("V{cel}", line=7)) == [(7, "source.voltage[0].signal", "no-such-placeholder")]
    assert troubles_of(CellSignals("V{cell}", "M", base={"cell": 1}, line=7), n_cells=1) == [
        (7, "source.voltage[0].signal", "cell-beyond")
    ]
    flag = CellSignals("V{cell}", "M", base={"cell": 1}, invalid_signal="Bad{cell}", line=7)
    assert troubles_of(flag) == [(7, "source.voltage[0]", "signal-not-in-dbc")]
    number = CellSignals("V1", "M", numbers={"cell": "Cell_Id"}, line=7)
    assert troubles_of(number) == [(7, "source.voltage[0]", "signal-not-in-dbc")]


def test_a_signal_that_is_missing_or_of_several_messages_is_told_and_the_first_counts():
    good = CellSignals("V{cell}", "M", base={"cell": 1})
    missing = ScalarSignal(SignalName("", "J"), line=9)
    assert troubles_of(good, current=missing) == [(9, "source.current.signal", "signal-not-in-dbc")]
    closed = StateSignal(SignalName("", "V1"), line=11)
    assert troubles_of(good, states={"closed": closed}) == [(11, "source.state.closed.signal", "signal-of-several")]
    several = []
    known = definitions(message(1, "M", "V1"), message(2, "N", "V1"))
    found = find_signals(known, SignalName("N", "V1"), several, "x", None)
    assert [each.name for each, _ in found] == ["N"]
    assert several == []


@pytest.mark.parametrize(
    ("dbc_unit", "unit", "scale", "offset"),
    [("V", "", 1.0, 0.0), ("mV", "", 1e-3, 0.0), ("V", "mV", 1e-3, 0.0), ("", "0.1mV", 1e-4, 0.0), ("", "", 1.0, 0.0)],
)
def test_the_unit_of_the_profile_counts_and_else_that_of_the_dbc(dbc_unit, unit, scale, offset):
    text = f'BO_ 1 M: 8 BMS\n SG_ V1 : 0|16@1+ (1,0) [0|0] "{dbc_unit}" X\n'
    source = DbcMapping(("x.dbc",), {"voltage": (CellSignals("V{cell}", base={"cell": 1}, unit=unit),)})
    (lane,) = bind_signals(Battery("x", (1,)), source, definitions(text)).by_id[1]
    assert (lane.layout.scale, lane.layout.offset) == pytest.approx((scale, offset))


def test_many_signals_of_cells_that_are_not_there_are_one_trouble():
    names = [f"V{k}" for k in range(1, 41)]
    source = DbcMapping(("x.dbc",), {"voltage": (CellSignals("V{cell}", "M", base={"cell": 1}),)})
    (trouble,) = bind_signals(Battery("x", (2,)), source, definitions(message(1, "M", *names))).troubles
    assert (trouble.what.code, trouble.what.args["n"]) == ("cell-beyond", 38)
    assert trouble.what.args["names"][:2] == ("V3", "V4")


def value(kind, unit, number):
    factor, zero = conversion(kind, unit)
    return number * factor + zero


@pytest.mark.parametrize(
    ("kind", "unit", "number", "expected"),
    [
        ("voltage", "100uV", 37000, 3.7),
        ("voltage", "100 µV", 37000, 3.7),
        ("voltage", "Volts", 3.7, 3.7),
        ("voltage", "millivolts", 3700, 3.7),
        ("current", "Amps", 120, 120.0),
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
    st.sampled_from(
        [
            ("voltage", "V"),
            ("pack_voltage", "V"),
            ("charger_voltage", "V"),
            ("current", "A"),
            ("charger_current", "A"),
            ("resistance", "Ohm"),
        ]
    ),
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
