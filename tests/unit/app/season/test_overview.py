"""What a season shows: the cells that limit first, with reasons; curves; nothing where nothing was measured."""

import numpy as np
import pytest

from app.season.overview import curve_of, overview_of
from tests.unit.app.season.season_of import history

PACKS = [4, 4, 4]


def measured(n=30, n_cells=12):
    rng = np.random.default_rng(4)
    values = 1.0 + 0.005 * rng.standard_normal((n, n_cells))
    capacity = 0.98 + 0.003 * rng.standard_normal((n, n_cells))
    return values, capacity


def test_a_cell_that_grows_comes_first_with_its_pace_and_band():
    values, capacity = measured()
    values[:, 7] += np.linspace(0.0, 0.12, 30)
    found = overview_of(history(values, np.full(values.shape, 0.005), capacity=capacity), PACKS)
    first = found.cells[0]
    assert first.cell == 7
    month = 0.12 / (29 * 7.0) * 30.44
    assert first.resistance_trend.low <= month <= first.resistance_trend.high
    assert {reason.code for reason in first.reasons} >= {"season-resists", "season-resistance-grows"}
    assert found.groups[0].resistance.sessions == 30


def grown_within(days):
    """Five sessions of a team, in which cell 7 grows."""
    values = 1.0 + 0.002 * np.random.default_rng(4).standard_normal((5, 12))
    values[:, 7] += np.linspace(0.0, 0.12, 5)
    return history(values, np.full(values.shape, 0.002), days=np.linspace(0.0, days, 5))


def test_sessions_of_one_day_tell_where_a_cell_is_and_no_month():
    for days, tells in ((60.0, True), (0.3, False)):
        first = overview_of(grown_within(days), PACKS).cells[0]
        assert first.cell == 7
        assert first.resistance_trend.is_sure
        assert first.resistance_trend.is_reportable is tells
        codes = {reason.code for reason in first.reasons}
        assert "season-resists" in codes
        assert ("season-resistance-grows" in codes) is tells


def test_a_cell_that_leaks_more_each_week_is_told_with_its_pace_and_band():
    values, capacity = measured()
    lost = 1e-4 + 2e-5 * np.random.default_rng(5).standard_normal((30, 12))
    lost[:, 5] += np.linspace(0.0, 0.003, 30)
    found = overview_of(history(values, np.full(values.shape, 0.005), capacity=capacity, lost=lost), PACKS)
    first = next(each for each in found.cells if each.cell == 5)
    month = 0.003 / (29 * 7.0) * 30.44
    assert first.self_discharge_trend.low <= month <= first.self_discharge_trend.high
    assert "season-leak-grows" in {reason.code for reason in first.reasons}


def test_sound_cells_give_no_reasons():
    values, capacity = measured()
    found = overview_of(history(values, np.full(values.shape, 0.005), capacity=capacity), PACKS)
    assert [each.reasons for each in found.cells if each.reasons] == []


def test_a_curve_has_what_was_measured_and_its_line_up_to_the_last_session():
    values, _ = measured()
    values[:, 3] += np.linspace(0.0, 0.12, 30)
    values[:4, 3] = np.nan
    made = history(values, np.full(values.shape, 0.005))
    curve = curve_of(made, 3, "resistance")
    assert curve.measured[:4] == [None] * 4
    assert curve.measured[4:] == pytest.approx(values[4:, 3], abs=1e-6)
    assert (curve.line_time_s[0], curve.line_time_s[-1]) == pytest.approx((curve.time_s[4], curve.time_s[-1]))
    assert curve.line[-1] == pytest.approx(1.12, abs=0.01)
    assert (np.array(curve.low) < curve.line).all()
    assert (np.array(curve.line) < curve.high).all()
    widths = np.array(curve.high) - np.array(curve.low)
    assert widths.argmin() not in (0, len(widths) - 1)  # surest in the middle
    assert curve_of(made, 3, "capacity").line == []


def test_a_season_without_a_session_is_empty():
    empty = overview_of(history(np.empty((0, 4)), np.empty((0, 4))), [4])
    assert (empty.sessions, len(empty.groups), empty.groups[0].resistance) == (0, 1, None)
    assert [each.reasons for each in empty.cells] == [[], [], [], []]
    assert curve_of(history(np.empty((0, 4)), np.empty((0, 4))), 0, "resistance").line == []
