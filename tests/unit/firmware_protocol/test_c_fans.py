import pytest

from firmware_protocol.config_image import default_image
from tests.c_master import CFans
from tests.master_memory import Config

CONFIG = Config.from_image(default_image())


@pytest.fixture
def fans() -> CFans:
    return CFans()


@pytest.mark.parametrize(("degc", "duty"), [(-20, 32), (20, 32), (21, 38), (35, 128), (49, 218), (50, 224), (90, 224)])
def test_fan_ramp_is_linear_between_its_ends(fans, degc, duty):
    assert fans.duty(CONFIG, degc, 0.0) == duty


def test_an_override_holds_until_it_is_given_back(fans):
    fans.command(0, 0.0)
    assert fans.duty(CONFIG, 60, 1e6) == 0
    fans.command(-1, 0.0)
    assert fans.duty(CONFIG, 60, 1e6) == 224


def test_an_override_for_a_time_ends_by_itself(fans):
    fans.command(100 | 30 << 8, 1000.0)
    assert [fans.duty(CONFIG, 60, now_s) for now_s in (1000.0, 1029.9, 1030.0, 1031.0)] == [100, 100, 224, 224]
