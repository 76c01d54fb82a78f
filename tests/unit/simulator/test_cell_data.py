from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simulator.cell_data import SAMSUNG_25R_10P, Table, warburg_ladder
from simulator.errors import ParameterError


def test_a_table_goes_through_its_points_and_is_flat_outside():
    table = Table((0.0, 0.3, 1.0), (3.0, 3.5, 4.0))
    np.testing.assert_allclose(table.at(np.array([-1.0, 0.0, 0.3, 1.0, 2.0])), [3.0, 3.0, 3.5, 4.0, 4.0])


@given(st.lists(st.floats(0.01, 1.0), min_size=2, max_size=8))
def test_rising_points_make_a_rising_curve(rises):
    """Between the knots of a monotone table there is no bump: an OCV that dips would have two SOCs for one voltage."""
    table = Table(tuple(np.linspace(0.0, 1.0, len(rises))), tuple(np.cumsum(rises)))
    assert np.all(np.diff(table.at(np.linspace(0.0, 1.0, 500))) >= -1e-12)


@pytest.mark.parametrize(
    ("soc", "value"), [((0.0,), (1.0,)), ((0.0, 1.0), (1.0,)), ((0.0, 0.0), (1.0, 2.0)), ((1.0, 0.0), (1.0, 2.0))]
)
def test_tables_that_are_none_are_refused(soc, value):
    with pytest.raises(ParameterError):
        Table(soc, value)


@pytest.mark.parametrize("pairs", [1, 2, 4, 9])
def test_a_ladder_has_the_whole_resistance(pairs):
    total = Table((0.0, 1.0), (3e-3, 1e-3))
    parts, farads = warburg_ladder(total, 50.0, pairs)
    assert len(parts) == len(farads) == pairs
    assert sum(part.value[0] for part in parts) == pytest.approx(3e-3)
    assert sum(part.value[1] for part in parts) == pytest.approx(1e-3)


@pytest.mark.parametrize(
    "wrong",
    [
        {"capacity_ah": 0.0},
        {"heat_capacity_j_per_k": -1.0},
        {"rc_f": ()},
        {"rc_f": (0.0,) * 4},
        {"rc_ohm": (Table((0.0, 1.0), (0.0, 0.0)),) * 4},
    ],
)
def test_cells_that_cannot_be_are_refused(wrong):
    with pytest.raises(ParameterError):
        replace(SAMSUNG_25R_10P, **wrong)
