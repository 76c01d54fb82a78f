"""Where each rule begins, to the count, and what it says; from a configuration that none of them minds."""

from dataclasses import replace

import pytest

from app.configuration.rules import Context, measured_range_a, review, review_change
from app.estimation.cell_model.cell_file import load_cell
from app.words import render
from firmware_protocol.config_image import ORDERED, default_image, with_raw, with_value
from firmware_protocol.memory_map import CONFIG

CELL = load_cell()  # 2.5 to 4.2 V, -20 to 75 degC, 200 A out, 40 A in, 25 Ah
CONTEXT = Context(CELL)
SENSOR = "end of the sensor range with this gain and offset: the limit could never trip"


def changed(image, **values):
    for name, value in values.items():
        image = with_value(image, name, value)
    return image


DEFAULT = default_image()
QUIET = changed(DEFAULT, i_disc_min=-40.0, fan_ramp_stop=45)


def found(image, context=CONTEXT):
    return [(f.level, f.code, f.error.field, f.error.value, f.error.limit, f.error.why) for f in review(image, context)]


def test_the_base_of_these_tests_has_no_finding():
    assert found(QUIET) == []


@pytest.mark.parametrize(
    ("change", "level", "code", "limit", "why"),
    [
        ({"v_cell_max": 4.2001}, "error", "data-sheet", "at most 4.2 V", f"data sheet limit of {CELL.name}"),
        ({"v_cell_min": 2.4999}, "error", "data-sheet", "at least 2.5 V", f"data sheet limit of {CELL.name}"),
        ({"v_cell_chrg": 3.0, "v_cell_min": 3.0}, "error", "order", "below v_cell_chrg = 3 V",
         "a full cell would read as empty"),
        ({"v_cell_chrg": 4.1901}, "warning", "charge-margin", "10 mV below v_cell_max, 4.19 V",
         "charging would end with a trip"),
        ({"v_cell_chrg": 4.1999}, "warning", "charge-margin", "10 mV below v_cell_max, 4.19 V",
         "charging would end with a trip"),
        ({"v_cell_chrg": 4.2}, "error", "charge-margin", "10 mV below v_cell_max, 4.19 V",
         "charging would end with a trip"),
        ({"t_cell_max": 61}, "error", "rules", "at most 60 °C",
         "rule limit 60 °C, or the data sheet limit of the cell if lower"),
        ({"t_cell_min": -21}, "error", "data-sheet", "at least -20 °C", f"data sheet limit of {CELL.name}"),
        ({"c_avg": 30.01}, "warning", "other-cell", "within 20 % of 25 Ah",
         f"the service uses the cell model {CELL.name}: one of the two is wrong"),
        ({"c_avg": 19.99}, "warning", "other-cell", "within 20 % of 25 Ah",
         f"the service uses the cell model {CELL.name}: one of the two is wrong"),
        ({"i_disc_max": 0.0}, "error", "window", "above 0 A", "the car could not drive"),
        ({"i_chrg_max": 40.01}, "error", "data-sheet", "at most 40 A", f"data sheet limit of {CELL.name}"),
        ({"i_disc_max": 200.01}, "warning", "data-sheet", "at most 200 A",
         f"continuous limit in the data sheet of {CELL.name}; short pulses may be acceptable"),
        ({"i_disc_min": -40.01}, "warning", "data-sheet", "at least -40 A",
         f"continuous charge limit in the data sheet of {CELL.name}; short pulses may be acceptable"),
        ({"i_offset": 1945.1}, "warning", "offset", "1945..2150 counts",
         "the sensor output is mid-range at zero current; a larger offset means it is unplugged or broken"),
        ({"i_offset": 2149.9}, "warning", "offset", "1945..2150 counts",
         "the sensor output is mid-range at zero current; a larger offset means it is unplugged or broken"),
        ({"fan_ramp_stop": 46}, "warning", "fans", "at most t_cell_max = 45 °C",
         "the contactors open before the fans reach full duty"),
        ({"telemetry_period": 35}, "warning", "line", "at least 36 ms",
         "transmission time of a telemetry frame: signals that do not fit are not sent"),
    ],
)  # fmt: skip
def test_one_count_beyond_a_limit_is_told(change, level, code, limit, why):
    [(name, value)] = list(change.items())[-1:]
    assert found(changed(QUIET, **change)) == [(level, code, name, value, limit, why)]


@pytest.mark.parametrize(
    "change",
    [
        {"v_cell_max": 4.2},
        {"v_cell_min": 2.5},
        {"v_cell_chrg": 3.0, "v_cell_min": 2.9999},
        {"v_cell_chrg": 4.19},
        {"t_cell_max": 60},
        {"t_cell_min": -20},
        {"c_avg": 30.0},
        {"c_avg": 20.0},
        {"i_disc_max": 0.01},
        {"i_chrg_max": 40.0},
        {"i_disc_max": 200.0},
        {"i_disc_min": -40.0},
        {"i_offset": 1945.2},
        {"i_offset": 2149.8},
        {"fan_ramp_stop": 45},
        {"telemetry_period": 36},
    ],
)
def test_a_value_at_its_limit_is_fine(change):
    assert found(changed(QUIET, **change)) == []


def test_what_the_sensor_can_tell_follows_its_gain_and_offset():
    image = with_raw(with_raw(QUIET, "i_gain", 5000), "i_offset", 20000)
    assert measured_range_a(image) == pytest.approx((-200.0, 209.5))
    assert measured_range_a(with_raw(image, "i_gain", 10000)) == pytest.approx((-400.0, 419.0))


@pytest.mark.parametrize(
    ("change", "limit"),
    [({"i_disc_max": 209.5}, "below 209.5 A"), ({"i_disc_min": -200.0}, "above -200.0 A")],
)
def test_a_limit_where_the_sensor_ends_could_never_trip(change, limit):
    image = with_raw(with_raw(QUIET, "i_gain", 5000), "i_offset", 20000)
    [(name, value)] = change.items()
    errors = [each for each in found(changed(image, **change)) if each[0] == "error"]
    assert errors == [("error", "sensor", name, value, limit, SENSOR)]
    inside = changed(image, **{name: value - 0.01 if value > 0 else value + 0.01})
    assert not [each for each in found(inside) if each[0] == "error"]


def test_a_charging_current_that_the_sensor_cannot_tell_is_an_error():
    image = with_raw(with_raw(changed(QUIET, i_disc_max=10.0, i_disc_min=-1.0), "i_gain", 500), "i_offset", 20000)
    assert measured_range_a(image)[0] == pytest.approx(-20.0)
    assert found(changed(image, i_chrg_max=19.99)) == []
    assert found(changed(image, i_chrg_max=20.0)) == [
        ("error", "sensor", "i_chrg_max", 20.0, "below 20.0 A", SENSOR)
    ]  # fmt: skip


def test_a_data_sheet_that_says_nothing_judges_nothing():
    silent = replace(
        CELL,
        limits=replace(
            CELL.limits,
            temperature_min_degc=None,
            temperature_max_degc=None,
            discharge_max_a=None,
            charge_max_a=None,
        ),
    )
    wide = changed(QUIET, t_cell_min=-40, t_cell_max=60, i_disc_max=300.0, i_disc_min=-300.0, i_chrg_max=300.0)
    assert found(wide, Context(silent)) == []
    assert [each[4] for each in found(changed(wide, t_cell_max=61), Context(silent))] == ["at most 60 °C"]


def test_what_the_master_would_refuse_is_the_only_thing_told():
    refused = with_raw(changed(QUIET, v_cell_min=2.4999), "telemetry_period", 19)
    assert found(refused) == [("error", "range", "telemetry_period", 19, "20..10000 ms", "limit of the master")]
    why = "size of the current sample buffer"
    assert found(with_raw(QUIET, "ts", 201)) == [("error", "range", "ts", 201, "1..200 sample", why)]


def test_errors_come_first_each_in_order_of_offset():
    image = changed(QUIET, telemetry_period=35, v_cell_min=2.4999, t_cell_max=61, fan_ramp_stop=62, c_avg=19.0)
    assert [(each[0], each[2]) for each in found(image)] == [
        ("error", "v_cell_min"),
        ("error", "t_cell_max"),
        ("warning", "c_avg"),
        ("warning", "fan_ramp_stop"),
        ("warning", "telemetry_period"),
    ]


def test_a_warning_stands_only_while_its_value_does():
    before = changed(QUIET, telemetry_period=35)
    [standing] = review_change(before, before, CONTEXT)
    assert (standing.is_standing, standing.needs_reason, standing.blocks) == (True, False, False)
    [other] = review_change(before, changed(QUIET, telemetry_period=34), CONTEXT)
    assert (other.is_standing, other.needs_reason) == (False, True)
    assert review_change(before, QUIET, CONTEXT) == []


def test_an_error_that_stands_blocks_all_the_same():
    before = changed(QUIET, t_cell_max=61)
    [standing] = review_change(before, before, CONTEXT)
    assert (standing.is_standing, standing.blocks, standing.needs_reason) == (True, True, False)


def test_another_bit_rate_is_a_warning_of_the_change():
    after = changed(QUIET, can_brp=15)
    [warning] = review_change(QUIET, after, CONTEXT)
    assert (warning.level, warning.code, warning.error.field) == ("warning", "bit-rate", "can_brp")
    assert (warning.error.value, warning.error.limit) == (15, "the active value 7 without a reason")
    assert warning.error.why == "change every other node on the bus too, or communication stops"
    assert review_change(after, after, CONTEXT) == []


@pytest.mark.parametrize(
    ("name", "element", "raw"),
    [
        ("v_cell_min", 0, 65535),
        ("can_tx_msg_id", 0, 0x800),
        ("can_tx_msg_id", 0, 0xA0000000),
        ("can_tx_msg_data", 0, 65534),
        ("can_rx_msg_data", 0, 1),
        ("can_rx_msg_response", 0, 8),
    ],
)
def test_what_the_master_refuses_is_told_in_every_language(name, element, raw):
    image = bytearray(QUIET)
    raws = [*CONFIG[name].unpack(image)]
    raws[element] = raw
    CONFIG[name].pack_into(image, raws)
    refused = next(each for each in review(bytes(image), CONTEXT) if each.error.field == name)
    assert (render(refused.limit), render(refused.why)) == (refused.error.limit, refused.error.why)
    assert render(refused.why, language="nb") != refused.error.why


@pytest.mark.parametrize(("low", "high", "is_strict", "why"), ORDERED)
def test_a_pair_of_limits_in_the_wrong_order_is_told_in_every_language(low, high, is_strict, why):
    image = bytearray(QUIET)
    CONFIG[low].pack_into(image, [CONFIG[high].unpack(image)[0] + (not is_strict)])
    refused = next(each for each in review(bytes(image), CONTEXT) if each.error.why == why)
    limit, value = refused.limit, refused.limit.args["value"].value
    assert render(limit).startswith(f"{'below' if is_strict else 'at most'} {high} = ")
    assert f" {high} = {value}" in refused.error.limit
    assert render(limit, language="nb").startswith(f"{'under' if is_strict else 'høyst'} {high} = ")
    assert render(refused.why, language="nb") != why


def test_the_defaults_have_no_error_and_a_sensor_that_reaches_their_limits():
    assert [each for each in found(DEFAULT) if each[0] == "error"] == []
    assert measured_range_a(DEFAULT) == pytest.approx((-496.7, 495.9), abs=0.1)


def test_the_cells_own_limit_counts_where_it_is_below_the_rules():
    colder = replace(CELL, limits=replace(CELL.limits, temperature_max_degc=50.0))
    image = with_value(DEFAULT, "t_cell_max", 55)
    errors = [
        [each[1:3] for each in found(image, context) if each[0] == "error"] for context in (CONTEXT, Context(colder))
    ]
    assert errors == [[], [("rules", "t_cell_max")]]


def test_a_message_names_field_value_limit_and_why():
    [error] = [each for each in review(with_value(DEFAULT, "t_cell_max", 65), CONTEXT) if each.blocks]
    shown = render(error.message)
    assert shown.startswith("t_cell_max = 65 °C, allowed: at most 60 °C (rule limit 60 °C")


@pytest.mark.parametrize(
    ("name", "looser", "tighter"),
    [("t_cell_max", 46, 44), ("v_cell_min", 2.4, 2.6), ("i_chrg_min", -1.0, 1.0), ("i_chrg_max", 12.5, 11.5)],
)
def test_a_looser_limit_of_the_protection_is_noticed(name, looser, tighter):
    def noticed(before, after, stored=None):
        change = review_change(before, after, CONTEXT, stored)
        assert not any(f.needs_reason for f in change if f.code == "looser"), "a program may write it without"
        return [f.error.field for f in change if f.code == "looser"]

    higher, lower = with_value(DEFAULT, name, looser), with_value(DEFAULT, name, tighter)
    assert noticed(DEFAULT, higher) == [name]
    assert noticed(DEFAULT, lower) == []
    assert noticed(lower, DEFAULT) == [name]
    assert noticed(lower, DEFAULT, stored=DEFAULT) == [], "the master would start with it"
    assert noticed(lower, higher, stored=DEFAULT) == [name]
    assert noticed(higher, higher) == []
