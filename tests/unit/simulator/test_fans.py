import pytest

from firmware_protocol.config_image import default_image
from simulator.fans import Fans, ramp_duty
from simulator.memory import Config

CONFIG = Config.from_image(default_image())


@pytest.mark.parametrize(("degc", "duty"), [(-20, 32), (20, 32), (35, 128), (50, 224), (90, 224)])
def test_fan_ramp_is_linear_between_its_ends(degc, duty):
    assert ramp_duty(CONFIG, degc) == duty


def test_an_override_holds_until_it_is_given_back():
    fans = Fans()
    fans.override = 0
    assert fans.duty(CONFIG, 60) == 0
    fans.override = -1
    assert fans.duty(CONFIG, 60) == 224
