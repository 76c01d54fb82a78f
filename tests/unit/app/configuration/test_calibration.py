"""Calibration of the current sensor: a sensor that is wrong by a known amount is put right."""

import pytest

from app.configuration.calibration import Measured, propose_gain, propose_zero
from app.errors import ConfigError, NotNow
from firmware_protocol.config_image import default_image, with_raw

IMAGE = default_image()


def reading(mean_a, sigma_a=0.3, *, closed=False):
    return Measured(mean_a, sigma_a, 20, relays_closed=closed)


def current_a(image, count):
    """What the master makes of an ADC count."""
    gain, offset = int.from_bytes(image[12:14], "little"), int.from_bytes(image[10:12], "little")
    return (10 * count - offset) * gain / 5000 / 100


def test_a_zero_that_is_off_is_put_right():
    count = 2056.3  # at no current
    proposal = propose_zero(IMAGE, reading(current_a(IMAGE, count)))
    assert (proposal.field, proposal.before_raw) == ("i_offset", 20490)
    assert current_a(with_raw(IMAGE, "i_offset", proposal.after_raw), count) == pytest.approx(0, abs=0.02)
    assert proposal.after_a == pytest.approx(0, abs=0.02)


def test_a_gain_that_is_off_is_put_right_against_the_meter():
    count = 2049 - 150
    read_a = current_a(IMAGE, count)
    proposal = propose_gain(IMAGE, reading(read_a, closed=True), read_a * 1.03)
    assert proposal.field == "i_gain"
    assert current_a(with_raw(IMAGE, "i_gain", proposal.after_raw), count) == pytest.approx(read_a * 1.03, rel=1e-4)
    assert proposal.after_a == pytest.approx(read_a * 1.03, rel=1e-4)


def test_no_zero_is_taken_with_relays_closed_or_an_unsteady_reading():
    with pytest.raises(NotNow, match="contactors"):
        propose_zero(IMAGE, reading(0.5, closed=True))
    with pytest.raises(NotNow, match="steady"):
        propose_zero(IMAGE, reading(0.5, sigma_a=5.0))


def test_an_unplugged_sensor_is_not_calibrated_away():
    with pytest.raises(ConfigError, match="unplugged"):
        propose_zero(IMAGE, reading(308.0))


@pytest.mark.parametrize(
    ("read_a", "meter_a"), [(30.0, -30.0), (30.0, 1.0), (0.0, 30.0), (30.0, 45.0), (30.0, float("nan"))]
)
def test_a_meter_that_cannot_be_right_is_named(read_a, meter_a):
    with pytest.raises(ConfigError) as caught:
        propose_gain(IMAGE, reading(read_a), meter_a)
    assert caught.value.field == "reference_a"
