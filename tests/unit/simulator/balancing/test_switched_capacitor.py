import math

import numpy as np
import pytest

from simulator.balancing.switched_capacitor import SwitchedCapacitorEqualiser, SwitchedCapacitorParameters
from simulator.errors import ParameterError

FAST = SwitchedCapacitorParameters(capacitance_f=1e-3, switch_ohm=0.003, frequency_hz=1e5)


def test_equal_cells_exchange_nothing_once_charged():
    equaliser = SwitchedCapacitorEqualiser(FAST, np.full(6, 3.7))
    equaliser.step(1.0, np.full(6, 3.7))
    np.testing.assert_allclose(equaliser.step(1.0, np.full(6, 3.7)), 0.0, atol=1e-9)


def test_charge_flows_from_high_to_low_and_adds_up():
    volts = np.array([3.72, 3.70, 3.71, 3.69, 3.70, 3.70])
    equaliser = SwitchedCapacitorEqualiser(FAST, volts)
    equaliser.step(1.0, volts)
    current_a = equaliser.step(1.0, volts)
    assert current_a[0] > 0.0 > current_a[3]
    assert current_a.sum() == pytest.approx(0.0, abs=1e-9)


def test_what_the_cells_give_is_lost_or_held():
    p = SwitchedCapacitorParameters(capacitance_f=0.5, switch_ohm=0.05, frequency_hz=50.0, series_ohm=0.01)
    volts = np.array([3.9, 3.7, 3.5])
    equaliser = SwitchedCapacitorEqualiser(p, volts)
    given_j = lost_j = 0.0
    for _ in range(20):
        current_a = equaliser.step(0.1, volts)
        given_j += float(volts @ current_a) * 0.1
        lost_j += equaliser.loss_w * 0.1
        assert equaliser.loss_w >= 0.0
    held_j = 0.5 * p.capacitance_f * float((equaliser.capacitor_v**2).sum())
    assert given_j == pytest.approx(lost_j + held_j)


@pytest.mark.parametrize("frequency_hz", [10.0, 1e3, 1e5, 1e7])
def test_between_two_cells_it_is_the_resistor_of_the_textbook(frequency_hz):
    """Two exponential phases of x = duty T / RC: R = (1/fC) (1 + e^-x) / (1 - e^-x), which is coth(x/2) / fC."""
    p = SwitchedCapacitorParameters(capacitance_f=1e-4, switch_ohm=0.01, frequency_hz=frequency_hz)
    loop_ohm = 2 * p.switch_ohm
    x = p.duty / (frequency_hz * loop_ohm * p.capacitance_f)
    expected_ohm = 1.0 / (frequency_hz * p.capacitance_f * math.tanh(x / 2.0))
    assert SwitchedCapacitorEqualiser(p, np.zeros(6)).transfer_ohm() == pytest.approx(expected_ohm, rel=1e-6)


def test_settled_currents_are_those_of_the_conductance():
    volts = np.array([3.8, 3.7, 3.6, 3.75])
    equaliser = SwitchedCapacitorEqualiser(FAST, volts)
    equaliser.step(1.0, volts)
    np.testing.assert_allclose(equaliser.step(1.0, volts), equaliser.conductance_s() @ volts, atol=1e-9)


def test_slow_switching_is_a_chain_of_resistors():
    """1 / fC between neighbours: the slowest pattern has 2 - 2 cos(pi / n) of that conductance."""
    p = SwitchedCapacitorParameters(capacitance_f=1e-4, switch_ohm=0.001, frequency_hz=100.0)
    equaliser = SwitchedCapacitorEqualiser(p, np.zeros(6))
    expected_ohm = 1.0 / (100.0 * 1e-4 * (2 - 2 * math.cos(math.pi / 6)))
    assert equaliser.slowest_pattern_ohm() == pytest.approx(expected_ohm, rel=1e-6)


def test_many_periods_at_once_equal_many_steps():
    volts = np.array([3.8, 3.7, 3.6, 3.75])
    p = SwitchedCapacitorParameters(capacitance_f=0.2, switch_ohm=0.02, frequency_hz=100.0)
    once, often = SwitchedCapacitorEqualiser(p, volts), SwitchedCapacitorEqualiser(p, volts)
    total = sum(often.step(0.01, volts) * 0.01 for _ in range(200))
    np.testing.assert_allclose(once.step(2.0, volts) * 2.0, total, rtol=1e-9)
    np.testing.assert_allclose(once.capacitor_v, often.capacitor_v, rtol=1e-9)


def test_empty_capacitors_take_most_from_inner_cells():
    """Why large empty capacitors unbalance: an end cell feeds one of them, an inner cell two, half of each."""
    p = SwitchedCapacitorParameters(capacitance_f=550.0, switch_ohm=10.0, frequency_hz=10.0)
    current_a = SwitchedCapacitorEqualiser(p, np.full(6, 3.7)).step(1.0, np.full(6, 3.7))
    assert np.all(current_a > 0.0)
    assert current_a[1:-1].min() > 1.9 * current_a[[0, -1]].max()
    assert np.argmax(current_a) in (2, 3)


@pytest.mark.parametrize(
    "wrong",
    [{"capacitance_f": 0.0}, {"duty": 0.6}, {"switch_ohm": 0.0}, {"frequency_hz": -1.0}],
)
def test_values_that_make_no_circuit_are_refused(wrong):
    with pytest.raises(ParameterError):
        SwitchedCapacitorParameters(**({"capacitance_f": 1.0, "switch_ohm": 0.1, "frequency_hz": 1.0} | wrong))


def test_one_cell_has_no_neighbour():
    with pytest.raises(ParameterError):
        SwitchedCapacitorEqualiser(FAST, np.array([3.7]))
