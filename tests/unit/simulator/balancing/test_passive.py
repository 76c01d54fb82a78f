import numpy as np
import pytest

from simulator.balancing.passive import Ltc6804Discharge, ThresholdBleeding


def test_only_cells_above_the_threshold_bleed():
    rule = ThresholdBleeding(difference_v=1e-3, stop_v=4.17)
    np.testing.assert_array_equal(rule.bleeding(np.array([3.7, 3.7009, 3.7011, 3.71])), [False, False, True, True])


def test_the_gate_needs_its_threshold():
    rule = ThresholdBleeding(difference_v=1e-3, gate_threshold_v=2.0)
    assert not rule.bleeding(np.array([3.7, 3.7019])).any()
    assert rule.bleeding(np.array([3.7, 3.7021])).any()


def test_nothing_bleeds_near_the_top():
    assert not ThresholdBleeding(stop_v=4.17).bleeding(np.array([4.0, 4.17])).any()


def test_measuring_interrupts_bleeding_for_as_long_as_it_lasts():
    chip = Ltc6804Discharge(12)
    chip.write(np.ones(12, bool))
    chip.measure(0.002335)
    outputs, part = chip.step(0.01)
    assert outputs.all()
    assert part == pytest.approx(1 - 0.2335)
    assert chip.step(0.01)[1] == 1.0


def test_a_long_conversion_reaches_into_the_next_step():
    chip = Ltc6804Discharge(12)
    chip.write(np.ones(12, bool))
    chip.measure(0.201)
    assert chip.step(0.1)[1] == 0.0
    assert chip.step(0.1)[1] == 0.0
    assert chip.step(0.1)[1] == pytest.approx(0.99)


def test_watchdog_ends_bleeding_two_seconds_after_the_last_command():
    chip = Ltc6804Discharge(12)
    chip.write(np.ones(12, bool))
    for _ in range(10):
        chip.measure(0.0)
        assert chip.step(1.9)[0].all()
    assert not chip.step(0.2)[0].any()


def test_discharge_timer_outlives_the_master_and_then_ends():
    chip = Ltc6804Discharge(12, timeout_code=1)  # 30 s
    chip.write(np.ones(12, bool))
    for _ in range(29):
        assert chip.step(1.0)[0].all()
    assert not chip.step(1.0)[0].any()
    chip.write(np.ones(12, bool))
    assert chip.step(1.0)[0].all()
