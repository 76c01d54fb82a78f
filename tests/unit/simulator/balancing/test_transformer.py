import numpy as np
import pytest

from simulator.balancing.transformer import MultiWindingTransformer, TransformerParameters
from simulator.errors import ParameterError

VOLTS = np.array([3.8, 3.7, 3.7, 3.7, 3.7, 3.7])


def test_power_balances_and_some_is_lost():
    moved = MultiWindingTransformer(TransformerParameters(), 6).transfer(0, VOLTS)
    net_w = float(VOLTS @ moved.cell_current_a)
    assert net_w == pytest.approx(moved.loss_w)
    assert 0.5 < moved.efficiency < 0.95
    assert moved.cell_current_a[0] > 0.0
    assert np.all(moved.cell_current_a[1:] < 0.0)


def test_the_circuit_equation_holds():
    """With no magnetising current, m (V - R I_p) = V_stack + V_d + R_s I_s."""
    p = TransformerParameters(magnetising_h=1e6)
    moved = MultiWindingTransformer(p, 6).transfer(0, VOLTS)
    secondary_a = -moved.cell_current_a[1] / p.duty
    ratio = p.turns_per_cell * 6
    left = ratio * (VOLTS[0] - (p.switch_ohm + p.primary_ohm) * ratio * secondary_a)
    assert left == pytest.approx(VOLTS.sum() + p.diode_v + p.secondary_ohm * secondary_a)


def test_too_few_turns_move_nothing_but_the_magnetising_energy():
    p = TransformerParameters(turns_per_cell=0.95, magnetising_h=1e6)
    moved = MultiWindingTransformer(p, 6).transfer(0, VOLTS)
    assert np.abs(moved.cell_current_a).max() < 1e-6


def test_the_core_is_reset_before_the_next_period_at_any_voltage_it_is_meant_for():
    p = TransformerParameters()
    for over_mean in (1.0, 1.1, p.highest_over_mean):
        others_v = 3.5
        cell_v = 5 * others_v * over_mean / (6 - over_mean)
        moved = MultiWindingTransformer(p, 6).transfer(0, np.array([cell_v, *[others_v] * 5]))
        assert p.duty + moved.reset_share <= 1.0


def test_volt_seconds_of_the_reset_are_those_of_the_on_time():
    p = TransformerParameters(reset_turns_per_cell=0.8)
    moved = MultiWindingTransformer(p, 6).transfer(0, VOLTS)
    reset_v = (VOLTS.sum() + p.diode_v) / (0.8 * 6)
    assert moved.reset_share * reset_v == pytest.approx(p.duty * VOLTS[0])


@pytest.mark.parametrize(
    "changes", [{"duty": 0.6}, {"duty": 0.0}, {"reset_turns_per_cell": 1.35}, {"reset_turns_per_cell": 0.0}]
)
def test_a_core_that_cannot_reset_is_refused(changes):
    with pytest.raises(ParameterError):
        TransformerParameters(**changes)
