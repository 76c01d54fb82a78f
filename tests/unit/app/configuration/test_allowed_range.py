"""The range that the page shows is the range that is accepted, judged by the rules themselves."""

import pytest

from app.configuration.rules import Context, allowed_ranges, review
from app.estimation.cell_model.cell_file import load_cell
from firmware_protocol.config_image import default_image, with_raw, with_value
from firmware_protocol.memory_map import CONFIG

CONTEXT = Context(load_cell())
DEFAULT = default_image()


@pytest.fixture(scope="module")
def ranges():
    return allowed_ranges(DEFAULT, CONTEXT)


def is_accepted(image, name, raw):
    return not [found for found in review(with_raw(image, name, raw), CONTEXT) if found.blocks]


def test_what_is_inside_is_accepted_and_what_is_outside_refused(ranges):
    assert len(ranges) > 20
    for name, (low, high) in ranges.items():
        field = CONFIG[name]
        for share in (0.0, 0.1, 0.5, 0.9, 1.0):
            assert is_accepted(DEFAULT, name, round(low + share * (high - low))), name
        for outside in (low - 1, high + 1):
            if field.minimum <= outside <= field.maximum:
                assert not is_accepted(DEFAULT, name, outside), name


def test_a_temperature_limit_ends_where_the_rules_end_it_and_not_where_its_integer_does(ranges):
    assert ranges["t_cell_max"] == (0, 60)
    assert CONFIG["t_cell_max"].maximum == 100


def test_the_range_follows_the_fields_beside_it():
    image = with_value(DEFAULT, "v_cell_chrg", 4.0)
    low, high = allowed_ranges(image, CONTEXT)["v_cell_max"]
    assert (low * 1e-4, high * 1e-4) == pytest.approx((4.0, 4.2), abs=2e-4)


def test_a_value_in_force_that_is_refused_has_the_range_of_its_default(ranges):
    too_hot = with_raw(DEFAULT, "t_cell_max", 80)
    found = allowed_ranges(too_hot, CONTEXT)
    assert found["t_cell_max"] == (0, 60)
    assert found["ts"] == ranges["ts"], "an error elsewhere bounds no other field"


def test_bits_and_tables_have_no_range(ranges):
    assert not {"can_tx_msg_en_startup", "can_tx_msg_id"} & ranges.keys()
