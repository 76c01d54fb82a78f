"""Conservation and limits of the physics for any course of currents, steps and faults."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from simulator.accumulator import Accumulator, AccumulatorParameters
from simulator.balancing.switched_capacitor import SwitchedCapacitorEqualiser, SwitchedCapacitorParameters
from simulator.balancing.transformer import MultiWindingTransformer, TransformerParameters
from simulator.cell_data import SAMSUNG_25R_10P
from simulator.charger_unit import ChargerUnit
from tests.campaign import examples

IDEAL = replace(SAMSUNG_25R_10P, self_discharge_a=0.0, coulombic_efficiency=1.0)
SMALL = AccumulatorParameters(n_cells=12, start_soc=0.6, cell=IDEAL)
courses = st.lists(st.tuples(st.floats(1e-3, 300.0), st.floats(-60.0, 200.0)), min_size=1, max_size=25)
voltages = st.lists(st.floats(2.5, 4.2), min_size=2, max_size=14).map(np.array)


@settings(deadline=None, max_examples=examples(60))
@given(courses, st.integers(0, 2**12 - 1))
def test_charge_is_what_current_and_resistors_took(course, mask):
    accumulator = Accumulator(SMALL, np.random.default_rng(1))
    bleeding = np.array([mask >> cell & 1 for cell in range(12)], bool)
    start_ah = accumulator.soc * accumulator.capacity_ah
    drawn_ah = np.zeros(12)
    for dt_s, current_a in course:
        accumulator.step(dt_s, current_a, bleeding=bleeding)
        drawn_ah += (current_a + accumulator.bleed_current_a) * dt_s / 3600.0
    np.testing.assert_allclose(start_ah - accumulator.soc * accumulator.capacity_ah, drawn_ah, atol=1e-9)
    assert not accumulator.bleed_current_a[~bleeding].any()


@settings(deadline=None, max_examples=examples(60))
@given(courses, st.floats(0.0, 1.0), st.floats(-10.0, 45.0))
def test_everything_stays_finite_and_losses_only_grow(course, fan_duty, ambient_degc):
    accumulator = Accumulator(replace(SMALL, ambient_degc=ambient_degc), np.random.default_rng(1))
    accumulator.resistance_factor[3] = 3.0
    accumulator.capacity_factor[5] = 0.5
    accumulator.extra_joint_ohm[7] = 1e-3
    accumulator.short_s[9] = 0.5
    lost_j = 0.0
    for dt_s, current_a in course:
        accumulator.step(dt_s, current_a, fan_duty=fan_duty)
        assert np.isfinite(accumulator.terminal_voltage_v).all()
        assert np.isfinite(accumulator.temperature_degc).all()
        assert accumulator.loss_energy_j >= lost_j - 1e-6
        lost_j = accumulator.loss_energy_j


@settings(deadline=None, max_examples=examples(60))
@given(voltages, st.floats(1e-5, 1.0), st.floats(1e-3, 10.0), st.floats(1.0, 1e5))
def test_an_equaliser_makes_no_energy_and_no_charge(volts, farad, ohm, hertz):
    equaliser = SwitchedCapacitorEqualiser(SwitchedCapacitorParameters(farad, ohm, hertz), volts)
    for _ in range(5):
        before_j = 0.5 * farad * float((equaliser.capacitor_v**2).sum())
        current_a = equaliser.step(1.0, volts)
        assert equaliser.loss_w >= -1e-9 * (1.0 + before_j)
    conductance = equaliser.conductance_s()
    largest = np.abs(conductance).max()
    np.testing.assert_allclose(conductance.sum(axis=0), 0.0, atol=1e-9 * largest)
    assert np.linalg.eigvals(conductance).real.min() > -1e-9 * largest
    assert np.isfinite(current_a).all()


@settings(deadline=None)
@given(voltages, st.integers(0, 13))
def test_a_transformer_gives_less_than_it_takes(volts, cell):
    moved = MultiWindingTransformer(TransformerParameters(), len(volts)).transfer(cell % len(volts), volts)
    assert moved.loss_w >= 0.0
    assert 0.0 <= moved.efficiency <= 1.0


@settings(deadline=None)
@given(st.lists(st.tuples(st.binary(max_size=9), st.floats(1e-3, 3.0), st.floats(-10.0, 500.0)), max_size=40))
def test_a_charger_never_leaves_its_limits_whatever_it_hears(course):
    unit = ChargerUnit()
    for data, dt_s, battery_v in course:
        unit.receive(data)
        unit.step(dt_s, battery_v)
        assert 0.0 <= unit.current_a <= unit.parameters.max_current_a
        assert np.isfinite(unit.temperature_degc)
