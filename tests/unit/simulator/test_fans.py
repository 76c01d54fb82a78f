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
    fans.command(0, 0.0)
    assert fans.duty(CONFIG, 60, 1e6) == 0
    fans.command(-1, 0.0)
    assert fans.duty(CONFIG, 60, 1e6) == 224


def test_an_override_for_a_time_ends_by_itself():
    fans = Fans()
    fans.command(100 | 30 << 8, 1000.0)
    assert [fans.duty(CONFIG, 60, now_s) for now_s in (1000.0, 1029.9, 1030.0, 1031.0)] == [100, 100, 224, 224]
