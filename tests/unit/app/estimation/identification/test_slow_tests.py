"""Slow tests on the SOC axis: by the column, by the ends, never by a counter that contradicts the rest."""

import numpy as np
import pytest

from app.estimation.errors import ModelError
from app.estimation.identification.slow_tests import read_slow
from app.estimation.recording.cell_recording import clean

CAPACITY_AH = 3.0
STEP_S = 60.0
RATE_C = 1 / 20
HALF_GAP_V = 0.02


def ocv(soc):
    return 3.0 + 1.2 * soc - 0.2 * np.exp(-soc / 0.05)


def slow(parts, soc=1.0, count_scale=1.0, with_soc=False, name="slow", gap_per_c=None, known=None, step_s=STEP_S):
    """A test of (current in C, SOC to move or hours of rest) parts; voltages lie a half gap, or R I, off the OCV."""
    rows = []
    for rate, amount in parts:
        steps = round(abs(amount / rate) * 3600 / step_s) if rate else round(amount * 3600 / step_s)
        for _ in range(steps):
            soc -= rate * step_s / 3600
            drop_v = HALF_GAP_V * np.sign(rate) if gap_per_c is None else gap_per_c * rate
            rows.append((rate * CAPACITY_AH, ocv(soc) - drop_v, soc))
    current, volts, exact = np.array(rows).T
    volts[known:-1] = volts[known:-1] if known is None else np.nan
    scale = np.where(current < 0.0, count_scale, 1.0)
    columns = {"time_s": step_s * np.arange(len(rows)), "current_a": current * scale, "voltage_v": volts}
    return clean(name, columns | ({"soc": exact} if with_soc else {}))


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


def test_a_charge_alone_stands_for_the_discharge_and_says_so():
    found = read_slow([slow([(-RATE_C, 1.0)], soc=0.0, name="up")])
    inside = (found.soc > 0.05) & (found.soc < 0.95)
    np.testing.assert_allclose(found.discharge_v[inside], ocv(found.soc[inside]) + HALF_GAP_V, atol=0.004)
    assert not found.has_charge
    assert any("up: no slow discharge" in note for note in found.notes)


def test_too_few_rows_and_no_current_are_refused():
    with pytest.raises(ModelError, match="fewer than ten"):
        read_slow([slow([(RATE_C, 1.0)], name="x", known=8)])
    with pytest.raises(ModelError, match="no current flows"):
        read_slow([slow([(0.0, 1.0)])])


def test_rests_between_steps_do_not_part_a_slow_discharge_and_raise_it_to_the_ocv():
    found = read_slow([slow([(RATE_C, 0.1), (0.0, 0.5)] * 10)])
    inside = (found.soc > 0.05) & (found.soc < 0.95)
    np.testing.assert_allclose(found.rested_v[inside], ocv(found.soc[inside]), atol=0.004)
    assert any("raised to 10 rests, by 20 mV" in note for note in found.notes)
    assert found.counted_ah == pytest.approx(CAPACITY_AH, rel=0.01)


def test_rests_of_a_stepwise_discharge_are_the_curve_where_nothing_was_slow():
    step = [(1.0, 0.05), (0.0, 0.5), (-0.5, 0.003), (0.0, 0.1)]
    found = read_slow([slow([(0.0, 0.5), *step * 20], gap_per_c=0.4, name="steps", step_s=20.0)])
    left = 1.0 - found.counted_ah / CAPACITY_AH
    assert left == pytest.approx(1.0 - 20 * (0.05 - 0.5 / 180), abs=0.005)
    inside = (found.soc > 0.06) & (found.soc < 0.98)
    np.testing.assert_allclose(found.rested_v[inside], ocv(left + (1.0 - left) * found.soc[inside]), atol=0.005)
    assert any("rests of a stepwise discharge" in note for note in found.notes)


def test_discharges_at_two_currents_are_extrapolated_to_none():
    pair = [slow([(rate, 0.99)], gap_per_c=0.1, name=f"{rate}C", step_s=2.0) for rate in (1.0, 3.0)]
    found = read_slow(pair)
    inside = (found.soc > 0.1) & (found.soc < 0.95)
    np.testing.assert_allclose(found.discharge_v[inside], ocv(0.01 + 0.99 * found.soc[inside]), atol=0.01)
    assert any("1.0C at 3 A and 3.0C at 9 A" in note for note in found.notes)


def test_one_fast_discharge_and_a_piece_of_a_drive_are_refused():
    with pytest.raises(ModelError, match="fast: nothing measured the OCV: it ran at 1 C"):
        read_slow([slow([(1.0, 1.0)], gap_per_c=0.1, name="fast")])
    with pytest.raises(ModelError, match="drive: its longest run"):
        read_slow([slow([(4.0, 0.3), (-1.0, 0.02)] * 3, gap_per_c=0.02, name="drive")])


def test_the_slowest_of_those_that_went_as_far_is_taken():
    fast, slow_one = slow([(1.0, 1.0)], gap_per_c=0.2), slow([(RATE_C, 0.97)])
    assert read_slow([fast, slow_one]).current_a == pytest.approx(RATE_C * CAPACITY_AH)


def test_a_discharge_that_ends_early_is_warned_of():
    assert read_slow([slow([(RATE_C, 1.0)])]).warnings == ()
    (warning,) = read_slow([slow([(RATE_C, 0.6)], name="short")]).warnings
    assert "short ends at 3.46 V" in warning


def test_the_wrong_sign_names_the_file_and_the_option():
    turned = slow(DOWN_AND_UP, name="turned")
    turned.current_a[:] = -turned.current_a
    with pytest.raises(ModelError, match=r"turned: .*--charge-positive"):
        read_slow([turned])


def test_a_few_rests_leave_a_slow_discharge_as_it_was_measured():
    found = read_slow([slow([(RATE_C, 0.5), (0.0, 0.5), (RATE_C, 0.5)])])
    inside = (found.soc > 0.05) & (found.soc < 0.95)
    np.testing.assert_allclose(found.discharge_v[inside], ocv(found.soc[inside]) - HALF_GAP_V, atol=0.004)
