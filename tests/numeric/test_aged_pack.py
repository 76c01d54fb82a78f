"""An aged accumulator: what lies ahead is counted with what was learned of the cells, not with their cell file."""

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.estimators import make_estimator
from app.estimation.health.capacity import CapacityTracker
from app.estimation.health.joint_watch import JointWatch
from app.estimation.health.packs import Packs
from app.estimation.prediction.constant_current import Limits
from app.live.prediction import LearnedCells, Predictor
from simulator.accumulator import Accumulator, AccumulatorParameters
from simulator.race import endurance

CELL = load_cell("samsung-25r-10p")
STEP_S = 0.1
ASSESSED_STEPS = 50  # looking ahead is what takes long
SOC_MIN = 0.05


def learned_from_charges(true_ah):
    """What four sessions of a full charge show, rests good to 1.5 % and the count to 0.5 %."""
    tracker = CapacityTracker(CELL.capacity_ah, 96)
    rng = np.random.default_rng(5)
    for moved in (0.8, -0.8, 0.7, -0.7):
        drawn_ah = moved * CELL.capacity_ah * 0.8
        tracker.observe(drawn_ah / true_ah + 0.01 * rng.normal(size=96), 0.02, drawn_ah, 0.1)
    return LearnedCells(tracker.state, JointWatch(Packs((12,) * 8)).baseline_ohm)


def raced(seconds, learned_for=None, applies_learning=True, **aged):
    """Return the predictor after a race, the accumulator, voltages against predicted ones, and errors of the SOC.

    `applies_learning` says whether the filter gets to know what was learned, as in the service.
    """
    rng = np.random.default_rng(2)
    accumulator = Accumulator(AccumulatorParameters(start_soc=0.9, **aged), rng)
    event = endurance(rng, n_laps=10)
    predictor = Predictor(CELL, (12,) * 8, None if learned_for is None else learned_for(accumulator.capacity_ah))
    estimator = make_estimator("fused", CELL, 96)
    estimator.start(accumulator.terminal_voltage_v, accumulator.temperature_degc, 0.0)
    if applies_learning:
        predictor.apply_learned(estimator)
    late, errors = [], []
    for k in range(round(seconds / STEP_S)):
        current = event.current_a(k * STEP_S, accumulator)
        accumulator.step(STEP_S, current, fan_duty=0.5)
        volts = np.round(accumulator.terminal_voltage_v + 2e-4 * rng.normal(size=96), 4)
        said = estimator.step(STEP_S, current, volts, accumulator.temperature_degc)
        predictor.step(STEP_S, current, volts, float(volts.sum() * current), said, accumulator.temperature_degc)
        if k % ASSESSED_STEPS == 0:
            predictor.assess(estimator, said, accumulator.temperature_degc, current, Limits(soc_min=SOC_MIN))
        if applies_learning:
            predictor.apply_learned(estimator)
        if k * STEP_S > seconds - 30.0:
            late.append(volts - said.voltage_v)
            errors.append(said.soc - accumulator.soc)
    return predictor, accumulator, np.array(late), np.array(errors)


@pytest.fixture(scope="module")
def aged():
    return raced(150.0, learned_from_charges, capacity_ageing=0.8, resistance_ageing=1.6)


@pytest.fixture(scope="module")
def without_learning():
    return raced(150.0, learned_from_charges, applies_learning=False, capacity_ageing=0.8, resistance_ageing=1.6)


def charge_left_ah(accumulator):
    return float(((accumulator.soc - SOC_MIN) * accumulator.capacity_ah).min())


def test_charge_left_is_that_of_the_aged_cells(aged):
    predictor, accumulator, *_ = aged
    truth = charge_left_ah(accumulator)
    assert predictor.assessment.energy.charge_ah == pytest.approx(truth, rel=0.05)
    nominal = CELL.capacity_ah * (accumulator.soc.min() - SOC_MIN)
    assert nominal > 1.15 * truth, "the cell file alone would be far off"
    assert predictor.assessment.prediction.counted_with.capacity_cells == 96
    assert predictor.assessment.prediction.counted_with.capacity_factor == pytest.approx(
        accumulator.capacity_ah.mean() / CELL.capacity_ah, abs=0.02
    )


def test_voltages_under_load_are_foretold_better_with_the_learned_resistance(aged, without_learning):
    predictor, _, late, _ = aged
    by_file = without_learning[2]
    assert (late - late.mean(axis=0)).std() < 0.6 * (by_file - by_file.mean(axis=0)).std()
    assert predictor.assessment.prediction.counted_with.resistance_cells == 96


def test_the_charge_of_aged_cells_is_found_with_the_learned_resistance(aged, without_learning):
    worst, worst_by_file = (np.sqrt((errors**2).mean(axis=0)).max() for errors in (aged[3], without_learning[3]))
    assert worst < 0.018
    assert worst < 0.9 * worst_by_file, "the cell file alone reads low under load"


def test_aged_cells_give_less_power_and_less_energy_than_new_ones(aged):
    new, accumulator, *_ = raced(150.0)
    old = aged[0].assessment
    assert new.assessment.prediction.counted_with.capacity_cells == 0, "no rest has shown a capacity"
    assert new.assessment.energy.charge_ah == pytest.approx(charge_left_ah(accumulator), rel=0.05)
    ratio = old.learned.resistance_factor.mean() / new.assessment.learned.resistance_factor.mean()
    assert 1.3 < ratio < 1.7, "cells resist 1.6 times as much, joints as before"
    assert old.power.discharge[2].power_w < new.assessment.power.discharge[2].power_w
    assert old.energy.energy_wh < 0.85 * new.assessment.energy.energy_wh
    assert (old.health.resistance < new.assessment.health.resistance).all()
