from dataclasses import replace

import numpy as np
import pytest

from simulator.accumulator import AccumulatorParameters
from simulator.cell_data import SAMSUNG_25R_10P
from simulator.errors import ParameterError
from simulator.strings import ParallelStrings

SIX = AccumulatorParameters(
    n_cells=6, cells_per_pack=6, start_soc_spread=0.0, capacity_spread=0.0, resistance_spread=0.0, joint_spread=0.0
)


def test_equal_strings_share_equally():
    strings = ParallelStrings(SIX, 6, np.random.default_rng(1))
    for _ in range(50):
        strings.step(0.1, 120.0)
    np.testing.assert_allclose(strings.string_current_a, 20.0, rtol=1e-6)


def test_shares_add_up_and_voltages_agree():
    spread = AccumulatorParameters(n_cells=6, cells_per_pack=6, start_soc_spread=0.02)
    strings = ParallelStrings(spread, 6, np.random.default_rng(2))
    rng = np.random.default_rng(3)
    for current_a in rng.uniform(-100.0, 400.0, 100):
        strings.step(0.5, current_a)
        assert strings.string_current_a.sum() == pytest.approx(current_a, abs=1e-9)
        rails = [string.outlet_voltage_v for string in strings.strings]
        assert max(rails) - min(rails) < 1e-6


@pytest.mark.parametrize(
    ("dt_s", "current_a"), [(3600.0, 100.0), (1e5, 0.0), (3600.0, -200.0), (1e4, 40.0), (600.0, 300.0), (1e6, 1.0)]
)
def test_rails_come_together_whatever_the_step(dt_s, current_a):
    spread = AccumulatorParameters(n_cells=6, cells_per_pack=6, start_soc_spread=0.05, start_soc=0.5)
    strings = ParallelStrings(spread, 6, np.random.default_rng(2))
    for _ in range(6):
        strings.step(dt_s, current_a)
        assert strings.string_current_a.sum() == pytest.approx(current_a, abs=1e-6)
        rails = [string.outlet_voltage_v for string in strings.strings]
        assert max(rails) - min(rails) < 1e-6


def test_a_full_string_does_not_take_the_charge_of_the_others():
    strings = ParallelStrings(SIX, 2, np.random.default_rng(1))
    first, second = strings.strings
    for _ in range(3):
        first.step(600.0, -4.0)
        second.step(600.0, 4.0)
    while strings.soc.max() < 1.12:
        strings.step(60.0, -20.0)
    assert strings.soc.min() > 1.05


def test_a_string_of_twice_the_resistance_takes_half_as_much_at_first():
    strings = ParallelStrings(SIX, 2, np.random.default_rng(1))
    weak = strings.strings[1]
    weak.resistance_factor[:] = 2.0
    weak.extra_joint_ohm[:] = SIX.joint_resistance_ohm
    weak.extra_joint_ohm[0] += SIX.path_resistance_ohm
    strings.step(1.0, 0.0)  # the change counts from the next slow step
    strings.step(0.0, 60.0)
    assert strings.string_current_a[0] / strings.string_current_a[1] == pytest.approx(2.0, rel=0.03)


@pytest.mark.parametrize("dt_s", [20.0, 300.0, 3600.0])
def test_unequal_strings_come_together_and_never_pass_each_other(dt_s):
    cell = replace(SAMSUNG_25R_10P, hysteresis_v=0.0, self_discharge_a=0.0, coulombic_efficiency=1.0)
    smooth = replace(SIX, cell=cell)
    strings = ParallelStrings(smooth, 2, np.random.default_rng(1))
    strings.step(0.0, 0.0)
    first, second = strings.strings
    for _ in range(round(360.0)):
        first.step(10.0, 2.5)  # a tenth of the first string's charge
    before = first.soc[0] - second.soc[0]
    total = (first.soc * first.capacity_ah + second.soc * second.capacity_ah).sum()
    assert before < -0.05
    for _ in range(max(4, round(7200.0 / dt_s))):
        strings.step(dt_s, 0.0)
        assert first.soc[0] - second.soc[0] <= 1e-9
    assert first.soc[0] - second.soc[0] > before / 20
    after = (first.soc * first.capacity_ah + second.soc * second.capacity_ah).sum()
    assert after == pytest.approx(total, rel=1e-9)


def test_hysteresis_keeps_strings_apart_by_no_more_than_its_gap():
    strings = ParallelStrings(SIX, 2, np.random.default_rng(1))
    first, second = strings.strings
    for _ in range(360):
        first.step(10.0, 2.5)
    for _ in range(200):
        strings.step(60.0, 0.0)
    gap_v = 2 * SAMSUNG_25R_10P.hysteresis_v
    assert 0.3 * gap_v < second.ocv_v[0] - first.ocv_v[0] < 1.05 * gap_v


def test_no_strings_is_refused():
    with pytest.raises(ParameterError):
        ParallelStrings(SIX, 0, np.random.default_rng(1))
