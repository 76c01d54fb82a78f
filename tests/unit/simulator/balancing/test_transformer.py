import numpy as np
import pytest

from simulator.balancing.transformer import MultiWindingTransformer, TransformerParameters
from simulator.errors import ParameterError

VOLTS = np.array([3.8, 3.7, 3.7, 3.7, 3.7, 3.7])


def test_the_fullest_cell_is_chosen_only_beyond_the_threshold():
    transformer = MultiWindingTransformer(TransformerParameters(soc_difference=0.01), 3)
    assert transformer.choose(np.array([0.5, 0.52, 0.51])) == 1
    assert transformer.choose(np.array([0.5, 0.509, 0.505])) is None


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


def test_a_core_that_cannot_reset_is_refused():
    with pytest.raises(ParameterError):
        TransformerParameters(duty=0.6)
