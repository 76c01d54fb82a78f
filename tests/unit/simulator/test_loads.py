from types import SimpleNamespace

import numpy as np
import pytest

from simulator.errors import ParameterError
from simulator.loads import PATTERNS_C, ConstantCurrent, Idle, Pattern, Phase, PowerLimits, Recorded, Rest

FULL = SimpleNamespace(outlet_voltage_v=360.0)


def test_constant_current_ends():
    load = ConstantCurrent(25.0, duration_s=10.0)
    assert load.current_a(9.9, FULL) == 25.0
    assert load.current_a(10.0, FULL) == 0.0
    assert load.state(10.0).phase is Phase.FINISHED


def test_idle_draws_power_not_current():
    load = Idle(watts=360.0)
    assert load.current_a(0.0, FULL) == pytest.approx(1.0)
    assert load.current_a(0.0, SimpleNamespace(outlet_voltage_v=240.0)) == pytest.approx(1.5)
    assert load.current_a(0.0, SimpleNamespace(outlet_voltage_v=0.0)) == 0.0


def test_rest_wants_no_high_voltage():
    assert Rest().current_a(5.0, FULL) == 0.0
    assert not Rest().state(5.0).is_high_voltage_on


@pytest.mark.parametrize("name", PATTERNS_C)
def test_pattern_draws_the_depth_asked_for(name):
    load = Pattern(PATTERNS_C[name], 25.0, depth=0.7)
    times = np.arange(0.0, load.duration_s, load.slice_s / 100.0) + 1e-6
    drawn_ah = sum(load.current_a(float(t), FULL) for t in times) * load.slice_s / 100.0 / 3600.0
    assert drawn_ah == pytest.approx(0.7 * 25.0, rel=1e-6)
    assert load.current_a(load.duration_s, FULL) == 0.0


def test_hard_pattern_reaches_ten_c_both_ways():
    load = Pattern(PATTERNS_C["hard"], 25.0)
    assert load.amps.max() == 250.0
    assert load.amps.min() == -250.0


@pytest.mark.parametrize(("slices_c", "options"), [((1, -1), {}), ((1,), {"scale": -1.0}), ((1,), {"depth": 0.0})])
def test_patterns_that_are_none_are_refused(slices_c, options):
    with pytest.raises(ParameterError):
        Pattern(slices_c, 25.0, **options)


def test_limits_hold_power_and_current_both_ways():
    limits = PowerLimits(max_discharge_w=60e3, max_regeneration_w=10e3, max_discharge_a=180.0, max_regeneration_a=30.0)
    assert limits.current_a(90e3, 400.0) == pytest.approx(150.0)
    assert limits.current_a(60e3, 300.0) == pytest.approx(180.0)
    assert limits.current_a(-50e3, 350.0) == pytest.approx(-10e3 / 350.0)
    assert limits.current_a(-50e3, 300.0) == pytest.approx(-30.0)
    assert limits.current_a(50e3, 0.0) == 0.0


def test_regeneration_fades_out_before_the_battery_is_full():
    limits = PowerLimits(max_voltage_v=400.0, fade_v=10.0)
    currents = [limits.current_a(-10e3, volts) for volts in (380.0, 394.0, 398.0, 400.0, 402.0)]
    assert currents == sorted(currents)
    assert currents[-1] == currents[-2] == 0.0


def test_recorded_without_ambient_says_so():
    assert Recorded(np.array([0.0, 1.0]), np.array([1.0, 2.0])).ambient_at_degc(0.5) is None
