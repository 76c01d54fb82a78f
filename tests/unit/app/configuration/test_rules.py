"""What blocks a configuration, what needs a reason; each rule by the smallest change that breaks it."""

import pytest

from app.configuration.rules import Context, measured_range_a, review, review_change
from app.estimation.cell_model.cell_file import load_cell
from app.words import render
from firmware_protocol.can_tables import rx_messages, tx_messages, with_rx_messages, with_tx_messages
from firmware_protocol.config_image import default_image, with_raw, with_value

CELL = load_cell()
CONTEXT = Context(CELL)
DEFAULT = default_image()


def found(image, level=None, context=CONTEXT):
    return {(f.code, f.error.field) for f in review(image, context) if level in (None, f.level)}


def with_tx(index, **changes):
    from dataclasses import replace

    return with_tx_messages(DEFAULT, [replace(tx_messages(DEFAULT)[index], **changes)])


def with_rx(index, **changes):
    from dataclasses import replace

    return with_rx_messages(DEFAULT, [replace(rx_messages(DEFAULT)[index], **changes)])


def test_the_defaults_have_no_error():
    assert found(DEFAULT, "error") == set()


@pytest.mark.parametrize(
    ("name", "value", "code"),
    [
        ("v_cell_max", 4.21, "data-sheet"),
        ("v_cell_min", 2.49, "data-sheet"),
        ("t_cell_max", 61, "rules"),
        ("t_cell_min", -21, "data-sheet"),
        ("v_cell_chrg", 4.2, "charge-margin"),
        ("i_disc_max", 0, "window"),
        ("i_chrg_max", 41, "data-sheet"),
        ("v_cell_chrg", 4.3, "range"),
        ("fan_ramp_start", 50, "range"),
    ],
)
def test_an_error_blocks(name, value, code):
    assert (code, name) in found(with_value(DEFAULT, name, value), "error")


@pytest.mark.parametrize(
    ("name", "value", "code"),
    [
        ("v_cell_chrg", 4.195, "charge-margin"),
        ("i_disc_max", 201, "data-sheet"),
        ("i_offset", 2200, "offset"),
        ("fan_ramp_stop", 46, "fans"),
        ("telemetry_period", 20, "line"),
        ("c_avg", 19, "other-cell"),
        ("can_brp", 3, "charger-rate"),
    ],
)
def test_a_warning_needs_a_reason(name, value, code):
    image = with_value(DEFAULT, name, value)
    assert (code, name) in found(image, "warning")
    asked = {f.error.field for f in review_change(DEFAULT, image, CONTEXT) if f.needs_reason}
    assert name in asked
    again = [f for f in review_change(image, image, CONTEXT) if f.needs_reason]
    assert again == [], "what is in force already is shown, and not asked for again"


def test_a_limit_that_the_sensor_cannot_see_is_an_error():
    low_a, high_a = measured_range_a(DEFAULT)
    assert (low_a, high_a) == pytest.approx((-496.7, 495.9), abs=0.1)
    narrow = with_raw(DEFAULT, "i_gain", 4000)  # 164 A
    assert ("sensor", "i_disc_max") in found(narrow, "error")


def test_the_cells_own_limit_counts_where_it_is_below_the_rules():
    from dataclasses import replace

    colder = replace(CELL, limits=replace(CELL.limits, temperature_max_degc=50.0))
    image = with_value(DEFAULT, "t_cell_max", 55)
    assert found(image, "error") == set()
    assert found(image, "error", Context(colder)) == {("rules", "t_cell_max")}


def test_messages_name_field_value_limit_and_why():
    [error] = [f for f in review(with_value(DEFAULT, "t_cell_max", 65), CONTEXT) if f.blocks]
    told = render(error.message)
    assert told.startswith("t_cell_max = 65 °C, allowed: at most 60 °C: the rules allow 60 °C")


def test_two_messages_with_one_id():
    assert ("id-taken", "can_tx_msg_id") in found(with_tx(2, can_id=0x100), "error")
    assert ("id-taken", "can_rx_msg_id") in found(with_rx(1, can_id=0x100, length=1), "error")
    assert ("id-taken", "can_tx_msg_id") not in found(with_tx(2, can_id=0x1806E5F4 & 0x7FF), "error")


def test_lengths_match():
    assert ("empty", "can_tx_msg_len") in found(with_tx(3, enabled=True), "error")
    assert ("length", "can_tx_msg_len") in found(with_tx(1, length=7), "error")
    assert ("length", "can_tx_msg_len") in found(with_tx(0, length=5), "error"), "an ElCon command has 8 bytes"
    assert ("empty", "can_tx_msg_len") in found(with_rx(0, response=5), "error")


def test_the_bus_load_stays_below_70_percent():
    busy = with_tx(1, period_ms=1)
    assert found(busy, "error") == set()
    slow = with_value(busy, "can_brp", 31)  # 125 kbit/s: one frame takes longer than a millisecond
    assert ("load", "can_tx_msg_timing") in found(slow, "error")


def test_timeouts_are_longer_than_periods():
    assert ("timeout", "can_rx_msg_timeout") in found(with_rx(0, timeout_ms=1000), "error")
    heard = Context(CELL, {0x200: 0.5})
    image = with_rx(1, can_id=0x200, length=1, timeout_ms=400, data_offsets=(437, *[0xFFFF] * 7))
    assert ("timeout", "can_rx_msg_timeout") not in found(image, "error")
    assert ("timeout", "can_rx_msg_timeout") in found(image, "error", heard)
    assert ("charger-period", "can_tx_msg_timing") in found(with_tx(0, period_ms=5000), "error")


def test_what_the_master_measures_is_not_overwritten_without_a_reason():
    image = with_rx(1, can_id=0x200, length=2, data_offsets=(1896, 1897, *[0xFFFF] * 6))
    assert ("overwrites", "can_rx_msg_data") in found(image, "warning")


def test_half_a_number_is_worth_a_second_look():
    image = with_tx(3, can_id=0x300, length=1, data_offsets=(2288, *[0xFFFF] * 7))
    assert ("cut", "can_tx_msg_data") in found(image, "warning")


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
