"""Trends of the accumulator and of its packs: found where they are, with their band."""

import numpy as np
import pytest

from app.season.trends import groups_of
from tests.unit.app.season.season_of import history

N, PACKS = 30, [4, 4, 4]
WEEKS = np.arange(N)[:, None]
MONTH_WEEKS = 365.25 / 12 / 7
SIGMA = 0.004


def noise(seed=4):
    return SIGMA * np.random.default_rng(seed).standard_normal((N, 12))


def groups(resistance=None, **more):
    values = 1.0 + noise() if resistance is None else resistance
    return groups_of(history(values, np.full(values.shape, SIGMA), **more), PACKS)


def test_a_pack_that_grows_is_told_with_its_band_and_the_others_are_not():
    values = 1.0 + noise()
    values[:, 4:8] += 0.004 * WEEKS
    accumulator, *packs = groups(values)
    assert [each.pack for each in (accumulator, *packs)] == [None, 0, 1, 2]
    grown = packs[1].resistance
    assert grown.low <= 0.004 * MONTH_WEEKS <= grown.high
    assert grown.is_sure
    assert abs(packs[0].resistance.per_month) < 0.1 * grown.per_month
    assert accumulator.spread.is_sure  # one pack moves away: cells lie farther apart


def test_the_soc_spread_is_that_of_the_rests():
    soc = np.full((N, 12), 0.8) + 0.0002 * np.random.default_rng(1).standard_normal((N, 12))
    soc[:, 5] -= 0.001 * WEEKS[:, 0]
    accumulator, *packs = groups(rest_soc=soc)
    for each in (accumulator, packs[1]):
        assert each.soc_spread.now == pytest.approx(0.029, abs=0.002)
        assert each.soc_spread.is_sure
    assert packs[0].soc_spread.now < 0.002


def test_self_discharge_of_a_pack_is_beyond_that_of_the_accumulator():
    lost = 0.001 + 0.0001 * np.random.default_rng(2).standard_normal((N, 12))
    lost[:, :4] += 0.0001 * WEEKS
    lost[0] = np.nan  # before the first session there is none
    accumulator, *packs = groups(lost=lost)
    assert accumulator.self_discharge.now == pytest.approx(0.001, abs=0.0002)
    trend = packs[0].self_discharge
    assert trend.low <= 0.0001 * MONTH_WEEKS <= trend.high
    assert trend.sessions == N - 1


def test_what_was_not_measured_has_no_trend():
    for each in groups():
        assert each.capacity is each.soc_spread is each.self_discharge is None


def test_an_accumulator_of_one_pack_is_told_once():
    values = 1.0 + noise()
    assert len(groups_of(history(values, np.full(values.shape, SIGMA)), [12])) == 1
