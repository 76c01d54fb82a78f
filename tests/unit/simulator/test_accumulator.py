from dataclasses import replace

import numpy as np
import pytest

from simulator.accumulator import Accumulator, AccumulatorParameters
from simulator.cell_data import EMPTY_SOC, SAMSUNG_25R_10P, Table
from simulator.errors import ParameterError

EVEN = AccumulatorParameters(
    capacity_spread=0.0,
    resistance_spread=0.0,
    start_soc_spread=0.0,
    self_discharge_spread=0.0,
    joint_spread=0.0,
    start_soc=0.8,
)


def make(parameters: AccumulatorParameters = EVEN, seed: int = 1) -> Accumulator:
    return Accumulator(parameters, np.random.default_rng(seed))


def run(accumulator: Accumulator, seconds: float, current_a: float, dt_s: float = 0.5, **inputs) -> None:
    for _ in range(round(seconds / dt_s)):
        accumulator.step(dt_s, current_a, **inputs)


def test_a_seed_repeats_the_run_and_another_does_not():
    first, again, other = make(AccumulatorParameters()), make(AccumulatorParameters()), make(AccumulatorParameters(), 2)
    for accumulator in (first, again, other):
        run(accumulator, 30.0, 80.0)
    np.testing.assert_array_equal(first.terminal_voltage_v, again.terminal_voltage_v)
    assert not np.array_equal(first.terminal_voltage_v, other.terminal_voltage_v)


def test_spreads_are_those_asked_for():
    accumulator = make(AccumulatorParameters(n_cells=960, capacity_spread=0.02, start_soc_spread=0.01))
    assert accumulator.capacity_ah.std() / accumulator.capacity_ah.mean() == pytest.approx(0.02, rel=0.1)
    assert accumulator.soc.std() == pytest.approx(0.01, rel=0.1)


def test_start_soc_may_differ_from_cell_to_cell():
    soc = np.linspace(0.3, 0.6, 96)
    np.testing.assert_allclose(make(replace(EVEN, start_soc=soc)).soc, soc)


@pytest.mark.parametrize(
    "wrong", [{"n_cells": 0}, {"start_soc": [0.5, 0.6]}, {"bleed_ohm": 0.0}, {"capacity_ageing": -1.0}]
)
def test_parameters_that_mean_nothing_are_refused(wrong):
    with pytest.raises(ParameterError):
        replace(EVEN, **wrong)


@pytest.mark.parametrize("dt_s", [-0.1, float("nan"), float("inf")])
def test_a_step_back_or_without_end_is_refused(dt_s):
    with pytest.raises(ParameterError):
        make().step(dt_s, 0.0)


def test_views_cannot_be_written():
    accumulator = make()
    for array in (accumulator.soc, accumulator.terminal_voltage_v, accumulator.temperature_degc, accumulator.ocv_v):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_one_amp_hour_is_one_amp_hour_in_every_cell():
    accumulator = make(AccumulatorParameters(start_soc=0.8))
    before = accumulator.soc.copy()
    run(accumulator, 360.0, 10.0)
    drawn_ah = (before - accumulator.soc) * accumulator.capacity_ah
    np.testing.assert_allclose(drawn_ah, 1.0, rtol=5e-4)  # and self-discharge


def test_voltages_add_up_and_the_path_drops_the_rest():
    accumulator = make()
    run(accumulator, 5.0, 100.0)
    assert accumulator.voltage_v == pytest.approx(float(accumulator.terminal_voltage_v.sum()))
    drop_v = accumulator.voltage_v - accumulator.outlet_voltage_v
    assert drop_v == pytest.approx(100.0 * EVEN.path_resistance_ohm)


def test_whole_pack_resistance_is_that_of_real_cars():
    accumulator = make(replace(EVEN, start_soc=0.6))
    run(accumulator, 1.0, 0.0)
    rest_v = accumulator.outlet_voltage_v
    run(accumulator, 10.0, 100.0)
    assert 0.22 < (rest_v - accumulator.outlet_voltage_v) / 100.0 < 0.35


def test_loose_joint_shows_in_its_own_cell_by_its_ohms_times_the_current():
    sound, loose = make(), make()
    loose.extra_joint_ohm[7] = 0.8e-3
    for accumulator in (sound, loose):
        run(accumulator, 3.0, 150.0)
    difference_v = sound.terminal_voltage_v - loose.terminal_voltage_v
    assert difference_v[7] == pytest.approx(0.12, rel=0.01)
    assert np.abs(np.delete(difference_v, 7)).max() < 1e-4


def test_loose_joint_heats_its_cell():
    accumulator = make()
    accumulator.extra_joint_ohm[7] = 0.8e-3
    run(accumulator, 120.0, 100.0)
    assert accumulator.temperature_degc.argmax() == 7


def test_weak_cell_falls_first():
    accumulator = make()
    accumulator.capacity_factor[20] = 0.8
    run(accumulator, 600.0, 60.0)
    assert accumulator.soc.argmin() == 20
    assert accumulator.terminal_voltage_v.argmin() == 20


def test_resistive_cell_sags_most_and_recovers():
    accumulator = make()
    accumulator.resistance_factor[20] = 2.0
    run(accumulator, 5.0, 100.0)
    assert accumulator.terminal_voltage_v.argmin() == 20
    run(accumulator, 2000.0, 0.0, dt_s=5.0)
    assert abs(accumulator.terminal_voltage_v[20] - accumulator.terminal_voltage_v[21]) < 2e-3


def test_internal_short_drains_and_heats_one_cell():
    accumulator = make()
    accumulator.short_s[50] = 1.4
    at_start_v = float(accumulator.terminal_voltage_v[50])
    run(accumulator, 720.0, 0.0)
    drained_ah = (accumulator.soc[51] - accumulator.soc[50]) * 25.5
    lowest_ah, highest_ah = 1.4 * np.array([accumulator.terminal_voltage_v[50], at_start_v]) * 719.0 / 3600.0
    assert lowest_ah < drained_ah < highest_ah
    assert accumulator.temperature_degc.argmax() == 50


@pytest.mark.parametrize("dt_s", [2.0, 20.0, 3600.0])
def test_a_short_ends_when_it_has_emptied_its_cell(dt_s):
    accumulator = make(replace(EVEN, start_soc=0.1, n_cells=12))
    accumulator.step(1.0, 0.0)
    accumulator.short_s[5] = 50.0 / 3.6
    before_j, loss_j = accumulator.chemical_energy_j(), accumulator.loss_energy_j
    run(accumulator, 7200.0, 0.0, dt_s=dt_s)
    assert accumulator.soc[5] == pytest.approx(EMPTY_SOC, abs=0.01)
    assert abs(accumulator.terminal_voltage_v[5]) < 0.1
    if dt_s < 10.0:
        assert accumulator.loss_energy_j - loss_j == pytest.approx(before_j - accumulator.chemical_energy_j(), rel=2e-3)


def test_an_empty_cell_gives_no_energy_however_far_it_is_driven():
    accumulator = make(replace(EVEN, start_soc=0.0, n_cells=12))
    run(accumulator, 600.0, 25.0)
    assert accumulator.soc.max() < EMPTY_SOC
    held_j = accumulator.stored_energy_j()
    before_j, work_j = accumulator.chemical_energy_j(), 0.0
    assert before_j == 0.0
    for _ in range(100):
        accumulator.step(1.0, 25.0)
        work_j += accumulator.voltage_v * 25.0
    assert accumulator.chemical_energy_j() == 0.0
    assert work_j <= held_j - accumulator.stored_energy_j()


def test_an_overfull_cell_rises_steeply():
    accumulator = make(replace(EVEN, start_soc=1.0, n_cells=12))
    run(accumulator, 0.14 * 25.5 * 3600 / 25.0, -25.0, dt_s=2.0)
    run(accumulator, 1800.0, 0.0, dt_s=5.0)
    assert accumulator.soc.min() > 1.13
    assert accumulator.terminal_voltage_v.min() > 4.7


def test_what_a_cell_wastes_in_charging_follows_its_own_current():
    wasteful = replace(SAMSUNG_25R_10P, coulombic_efficiency=0.9, self_discharge_a=0.0)
    even = replace(EVEN, cell=wasteful, n_cells=12)
    accumulator = make(replace(even, start_soc=0.6))
    moved = np.zeros(12)
    moved[3], moved[4] = 3.0, -1.0
    start = accumulator.soc.copy()
    for _ in range(360):
        accumulator.step(1.0, -2.0, cell_current_a=moved)
    gained_ah = (accumulator.soc - start) * accumulator.capacity_ah
    np.testing.assert_allclose(gained_ah[[0, 3, 4]], [0.18, -0.1, 0.27], rtol=1e-9)


def test_heat_from_outside_and_ambient_arrive():
    accumulator = make()
    accumulator.heat_w[3] = 30.0
    run(accumulator, 300.0, 0.0)
    assert accumulator.temperature_degc.argmax() == 3
    accumulator.heat_w[3] = 0.0
    accumulator.ambient_degc = 40.0
    run(accumulator, 40000.0, 0.0, dt_s=100.0, fan_duty=0.5)
    np.testing.assert_allclose(accumulator.temperature_degc, 40.0, atol=0.2)


def test_sun_warms_the_whole_container():
    accumulator = make()
    accumulator.sun_w = 300.0
    run(accumulator, 1800.0, 0.0, dt_s=5.0)
    assert accumulator.temperature_degc.min() > 27.0


def test_blocked_fan_is_as_no_fan():
    blocked, still = make(), make()
    blocked.fan_blocked = 1.0
    for accumulator, duty in ((blocked, 0.8), (still, 0.0)):
        run(accumulator, 120.0, 80.0, fan_duty=duty)
    np.testing.assert_allclose(blocked.temperature_degc, still.temperature_degc)


def test_bleeding_draws_what_the_resistors_take():
    accumulator = make(replace(EVEN, start_soc=1.0))
    bleeding = np.zeros(96, bool)
    bleeding[5] = True
    run(accumulator, 2.0, 0.0, bleeding=bleeding)
    assert accumulator.bleed_current_a[5] == pytest.approx(accumulator.terminal_voltage_v[5] / 23.5, rel=1e-3)
    assert accumulator.bleed_current_a.sum() == accumulator.bleed_current_a[5]
    run(accumulator, 1.0, 0.0)
    assert accumulator.bleed_current_a[5] == 0.0


def test_bleeding_heats_its_own_board():
    accumulator = make()
    bleeding = np.zeros(96, bool)
    bleeding[12:24] = True
    run(accumulator, 600.0, 0.0, bleeding=bleeding)
    assert accumulator.board_temperature_degc.argmax() == 1
    assert accumulator.board_temperature_degc[1] > 35.0


def test_balancer_current_moves_charge_between_cells():
    accumulator = make()
    moved = np.zeros(96)
    moved[0], moved[1] = 2.0, -2.0
    run(accumulator, 900.0, 0.0, cell_current_a=moved)
    assert accumulator.soc[1] - accumulator.soc[0] == pytest.approx(1.0 / 25.5, rel=1e-3)


def test_ageing_takes_capacity_and_adds_resistance():
    aged = make(replace(EVEN, capacity_ageing=0.85, resistance_ageing=1.5))
    np.testing.assert_allclose(aged.capacity_ah, 0.85 * 25.5)
    joints = EVEN.joint_resistance_ohm
    np.testing.assert_allclose(aged.resistance_ohm - joints, 1.5 * (make().resistance_ohm - joints))


def test_step_length_hardly_matters():
    fine, coarse = make(), make()
    for current_a in (80.0, -30.0, 120.0, 0.0):
        run(fine, 20.0, current_a, dt_s=0.01)
        run(coarse, 20.0, current_a, dt_s=1.0)
    np.testing.assert_allclose(fine.terminal_voltage_v, coarse.terminal_voltage_v, atol=5e-4)
    np.testing.assert_allclose(fine.temperature_degc, coarse.temperature_degc, atol=0.01)


def test_energy_balances_over_joints_bleeding_leak_and_loss():
    """What the cells give = work at the rails + all heat + what pairs and hysteresis hold, to 1e-6 of what moved."""
    athermal = replace(SAMSUNG_25R_10P, entropy_v_per_k=Table((0.0, 1.0), (0.0, 0.0)), self_discharge_a=0.0)
    accumulator = make(replace(AccumulatorParameters(start_soc=0.8), cell=athermal, slow_period_s=0.0, n_cells=12))
    accumulator.short_s[3] = 0.5
    accumulator.extra_joint_ohm[4] = 1e-3
    accumulator.step(1e-9, 0.0)
    bleeding = np.arange(12) % 3 == 0
    chemical_j, stored_j = accumulator.chemical_energy_j(), accumulator.stored_energy_j()
    loss_j = accumulator.loss_energy_j
    work_j, moved_j, dt_s = 0.0, 0.0, 0.01
    for current_a, seconds in ((120.0, 10.0), (-60.0, 10.0), (0.0, 5.0)):
        accumulator.step(0.0, current_a, bleeding=bleeding)
        before_v = accumulator.voltage_v
        for _ in range(round(seconds / dt_s)):
            accumulator.step(dt_s, current_a, bleeding=bleeding)
            part_j = 0.5 * (before_v + accumulator.voltage_v) * current_a * dt_s
            work_j += part_j
            moved_j += abs(part_j)
            before_v = accumulator.voltage_v
    given_j = chemical_j - accumulator.chemical_energy_j()
    held_j = accumulator.stored_energy_j() - stored_j
    assert given_j == pytest.approx(work_j + accumulator.loss_energy_j - loss_j + held_j, abs=1e-6 * moved_j)


def test_reversible_heat_warms_on_discharge_and_cools_on_charge():
    lossless = replace(
        SAMSUNG_25R_10P,
        ohmic_ohm=Table((0.0, 1.0), (1e-9, 1e-9)),
        charge_transfer_ohm=Table((0.0, 1.0), (0.0, 0.0)),
        rc_ohm=(Table((0.0, 1.0), (1e-9, 1e-9)),),
        rc_f=(1e9,),
        entropy_v_per_k=Table((0.0, 1.0), (-1e-4, -1e-4)),
        hysteresis_v=0.0,
        self_discharge_a=0.0,
        coulombic_efficiency=1.0,
    )
    accumulator = make(replace(EVEN, cell=lossless, joint_resistance_ohm=0.0, start_soc=0.5))
    run(accumulator, 100.0, 50.0)
    assert accumulator.reversible_energy_j == pytest.approx(96 * 50.0 * 100.0 * 298.15 * 1e-4, rel=1e-3)
    warm = accumulator.temperature_degc.mean()
    run(accumulator, 100.0, -50.0)
    assert accumulator.temperature_degc.mean() < warm
    assert accumulator.reversible_energy_j == pytest.approx(0.0, abs=5.0)
