import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.estimation.prediction.heat import READY_S, HeatBalance
from tests.campaign import examples


def warm(balance, loss_w, cooling_w, seconds, start_degc=30.0, dt_s=0.5):
    degc = start_degc
    for _ in range(round(seconds / dt_s)):
        degc += (loss_w - cooling_w) / 430.0 * dt_s
        balance.step(dt_s, np.full(4, loss_w), np.rint(degc + np.array([-0.4, -0.1, 0.2, 0.45])))
    return degc


@pytest.mark.parametrize("cooling_w", [0.0, 5.0, 12.0])
def test_the_cooling_is_what_does_not_become_warmth(cooling_w):
    balance = HeatBalance(430.0)
    warm(balance, 12.0, cooling_w, 900)
    assert balance.cooling_w == pytest.approx(cooling_w, abs=0.7)


def test_nothing_is_told_before_minutes_and_after_a_hole():
    balance = HeatBalance(430.0)
    warm(balance, 12.0, 6.0, READY_S - 10)
    assert balance.cooling_w == 0.0
    warm(balance, 12.0, 6.0, 300)
    assert balance.cooling_w > 0.0
    balance.step(60.0, np.full(4, 12.0), np.full(4, 30.0))
    assert balance.cooling_w == 0.0


def test_a_missing_cell_is_left_out_and_without_any_there_is_no_balance():
    balance = HeatBalance(430.0)
    for _ in range(900):
        balance.step(1.0, np.array([12.0, np.nan, 12.0]), np.array([30.0, 30.0, np.nan]))
    assert balance.cooling_w == pytest.approx(12.0, rel=0.05)
    balance.step(1.0, np.full(3, np.nan), np.full(3, 30.0))
    assert balance.cooling_w == 0.0


@settings(max_examples=examples(15), deadline=None)
@given(st.integers(1, 216), st.floats(0.0, 10.0), st.floats(-20.0, 50.0))
def test_the_cooling_is_found_for_any_number_of_cells_at_any_temperature(n_cells, cooling_w, start_degc):
    balance, own_k = HeatBalance(430.0), np.linspace(-1.0, 1.0, n_cells)
    for k in range(900):
        degc = start_degc + (12.0 - cooling_w) / 430.0 * k + own_k
        balance.step(1.0, np.full(n_cells, 12.0), degc)
    assert balance.cooling_w == pytest.approx(cooling_w, abs=0.2)


def test_cells_that_are_warmed_from_outside_are_not_cooled():
    balance = HeatBalance(430.0)
    warm(balance, 0.0, -5.0, 900)
    assert balance.cooling_w == 0.0
