"""Slow tests on the SOC axis: by the column, by the ends, never by a counter that contradicts the rest."""

import numpy as np
import pytest

from app.estimation.errors import ModelError
from app.estimation.identify_slow import read_slow
from app.estimation.importer import clean

CAPACITY_AH = 3.0
STEP_S = 60.0
RATE_C = 1 / 20
HALF_GAP_V = 0.02


def ocv(soc):
    return 3.0 + 1.2 * soc - 0.2 * np.exp(-soc / 0.05)


def slow(parts, soc=1.0, count_scale=1.0, with_soc=False, name="slow"):
    """A test of (current in C, SOC to move or hours of rest) parts; voltages lie a half gap off the OCV."""
    rows = []
    for rate, amount in parts:
        steps = round(abs(amount / rate) * 3600 / STEP_S) if rate else round(amount * 3600 / STEP_S)
        for _ in range(steps):
            soc -= rate * STEP_S / 3600
            rows.append((rate * CAPACITY_AH, ocv(soc) - HALF_GAP_V * np.sign(rate), soc))
    current, volts, known = np.array(rows).T
    scale = np.where(current < 0.0, count_scale, 1.0)
    columns = {"time_s": STEP_S * np.arange(len(rows)), "current_a": current * scale, "voltage_v": volts}
    return clean(name, columns | ({"soc": known} if with_soc else {}))


DOWN_AND_UP = [(0.0, 0.5), (RATE_C, 1.0), (0.0, 1.0), (-RATE_C, 0.9), (0.0, 1.0)]


@pytest.mark.parametrize("with_soc", [False, True])
def test_both_branches_lie_where_the_cell_was(with_soc):
    found = read_slow([slow(DOWN_AND_UP, with_soc=with_soc)])
    inside = (found.soc > 0.05) & (found.soc < 0.85)
    np.testing.assert_allclose(found.discharge_v[inside], ocv(found.soc[inside]) - HALF_GAP_V, atol=0.004)
    np.testing.assert_allclose(found.charge_v[inside], ocv(found.soc[inside]) + HALF_GAP_V, atol=0.012)
    assert found.has_charge
    assert found.counted_ah == pytest.approx(CAPACITY_AH, rel=0.005)
    assert found.current_a == pytest.approx(RATE_C * CAPACITY_AH)


def test_branches_never_fall_and_the_charge_never_lies_below_the_discharge():
    found = read_slow([slow(DOWN_AND_UP)])
    assert (np.diff(found.discharge_v) >= 0.0).all()
    assert (found.charge_v >= found.discharge_v).all()
    assert ((found.rested_v >= found.discharge_v) & (found.rested_v <= found.charge_v)).all()


def test_a_discharge_alone_is_enough_and_says_that_it_was_alone():
    found = read_slow([slow([(RATE_C, 1.0)])])
    assert not found.has_charge
    np.testing.assert_array_equal(found.charge_v, found.discharge_v)


def test_discharge_and_charge_may_come_in_files_of_their_own():
    down, up = slow([(RATE_C, 1.0), (0.0, 1.0)]), slow([(0.0, 1.0), (-RATE_C, 0.9), (0.0, 1.0)], soc=0.0)
    apart = read_slow([up, down])
    assert apart.has_charge
    inside = (apart.soc > 0.05) & (apart.soc < 0.85)
    np.testing.assert_allclose(apart.charge_v[inside], ocv(apart.soc[inside]) + HALF_GAP_V, atol=0.012)


def test_a_charge_that_is_counted_wrong_is_laid_by_its_ends_and_said_so():
    wrong = read_slow([slow(DOWN_AND_UP, count_scale=0.85, name="c20.csv")])
    inside = (wrong.soc > 0.1) & (wrong.soc < 0.8)
    np.testing.assert_allclose(wrong.charge_v[inside], ocv(wrong.soc[inside]) + HALF_GAP_V, atol=0.03)
    assert any("c20.csv" in note and "laid on the SOC axis by its ends" in note for note in wrong.notes)
    assert read_slow([slow(DOWN_AND_UP)]).notes == ()


def test_a_charge_alone_and_too_few_rows_are_refused():
    with pytest.raises(ModelError, match="no slow discharge"):
        read_slow([slow([(-RATE_C, 0.9)], soc=0.05)])
    few = slow([(RATE_C, 1.0)])
    few.voltage_v[9:] = np.nan
    with pytest.raises(ModelError, match="fewer than ten"):
        read_slow([few])
