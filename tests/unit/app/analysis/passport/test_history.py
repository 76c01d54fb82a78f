"""A made-up season: sessions of known cells, one of which ages, one leaks, one is swapped."""

import numpy as np
import pytest

from app.analysis.passport.history import SessionRecord, Stretch, Swap, passports

N = 96
DAY_S = 86_400.0
NOMINAL_AH = 25.0
OLD, LEAK, SWAPPED = 30, 50, 70


def soc_at(volts):
    return (volts - 3.0) / 1.2


def volts_at(soc):
    return 3.0 + 1.2 * soc


def season(weeks=8, *, growth=0.0, fade=0.0, leak=0.0, seed=1):
    """One session a week; `growth` of OLD's resistance and `fade` of its capacity a week, `leak` of LEAK a day."""
    rng = np.random.default_rng(seed)
    resistance = 0.0018 * (1 + rng.normal(0, 0.03, N))
    resistance[OLD] = 0.0018
    capacity = NOMINAL_AH * (1 + rng.normal(0, 0.01, N))
    records = []
    end_soc = None
    for week in range(weeks):
        start_s = week * 7 * DAY_S
        warm = 1 + rng.normal(0, 0.1)  # all cells alike
        ohm = resistance * warm * (1 + rng.normal(0, 0.004, N))
        ohm[OLD] *= 1 + growth * week
        ah = capacity.copy()
        ah[OLD] *= 1 - fade * week
        first = np.full(N, 0.9) if end_soc is None else end_soc.copy()
        first[LEAK] -= leak * 7 if end_soc is not None else 0.0
        moved = 12.0 / ah + rng.normal(0, 0.005, N)
        end_soc = np.full(N, 0.4)
        records.append(
            SessionRecord(
                f"s{week:02}",
                start_s,
                start_s + 1800,
                ohm,
                np.where(np.arange(N) == 5, 3600.0, 0.0),
                start_s,
                volts_at(first),
                start_s + 1800,
                volts_at(end_soc),
                (Stretch(moved, 0.01, 12.0, 0.05),),
            )
        )
    return records


def judged(records, swaps=()):
    return passports(records, swaps, NOMINAL_AH, soc_at, N)


def test_a_sound_season_names_no_cell():
    made = judged(season())
    assert made.drifts == ()
    assert sorted(made.rank) == list(range(1, N + 1))
    assert made.balancing_h[-1, [4, 5]].tolist() == [0, 8]
    np.testing.assert_allclose(made.now("self_discharge_per_day"), 0.0, atol=1e-9)


def test_a_cell_that_ages_is_named_weeks_before_its_limit():
    made = judged(season(growth=0.015))
    (drift,) = made.drifts
    assert (drift.cell, drift.what) == (OLD, "resistance")
    assert drift.per_week == pytest.approx(0.015, rel=0.2)
    assert 4 <= drift.weeks <= 9  # at 10.5 % now, 20 % is 6 weeks ahead
    assert "20 % in about" in drift.text
    assert made.rank[OLD] >= N - 3


def test_capacity_that_fades_is_seen_in_spite_of_noise():
    made = judged(season(12, fade=0.01))
    assert (OLD, "capacity") in [(drift.cell, drift.what) for drift in made.drifts]
    assert {drift.cell for drift in made.drifts} == {OLD}
    assert made.capacity_ah[-1, OLD] < 0.95 * np.median(made.capacity_ah[-1])


def test_a_leak_shows_between_sessions():
    made = judged(season(leak=0.004))
    assert made.now("self_discharge_per_day")[LEAK] == pytest.approx(0.004, rel=0.05)
    assert [(drift.cell, drift.what) for drift in made.drifts] == [(LEAK, "self-discharge")]


def test_a_pause_in_which_the_pack_was_charged_or_that_was_short_tells_nothing():
    records = season(2)
    charged = [records[0], SessionRecord(**vars(records[1]) | {"first_rest_v": volts_at(np.full(N, 0.95))})]
    assert np.isnan(judged(charged).self_discharge_per_day).all()
    short = [records[0], SessionRecord(**vars(records[1]) | {"first_rest_s": records[0].last_rest_s + 3600.0})]
    assert np.isnan(judged(short).self_discharge_per_day).all()


def test_a_swapped_module_begins_a_new_line_and_inherits_nothing():
    records = season(8, growth=0.03)
    swap = Swap(records[6].start_s - 3600, (OLD, SWAPPED), "new modules")
    for k in (6, 7):
        records[k].resistance_ohm[OLD] = np.median(records[k].resistance_ohm)
    made = judged(records, [swap])
    assert made.line[:, OLD].tolist() == [0] * 6 + [1, 1]
    assert made.line[:, 0].tolist() == [0] * 8
    assert made.drifts == ()
    alone = judged(records[6:])
    assert made.capacity_ah[-1, OLD] == pytest.approx(alone.capacity_ah[-1, OLD])
    assert OLD in [drift.cell for drift in judged(season(8, growth=0.03)).drifts]


def test_what_was_not_known_stays_unknown():
    nothing = SessionRecord(
        "s", 0.0, 1.0, np.full(N, np.nan), np.zeros(N), None, np.full(N, np.nan), None, np.full(N, np.nan), ()
    )
    made = judged([nothing])
    assert np.isnan(made.capacity_ah).all()
    assert np.isnan(made.resistance_relative).all()
    assert made.drifts == ()
    assert np.isnan(made.rank).all()
    assert judged([]).drifts == ()
    assert np.isnan(judged([]).rank).all()


def test_a_module_that_was_just_put_in_has_no_figures_of_the_one_before():
    records = season(8, growth=0.03)
    made = judged(records, [Swap(records[-1].end_s + 60.0, (OLD,), "new")])
    assert np.isnan(made.now("capacity_ah")[OLD])
    assert np.isnan(made.rank[OLD])
    assert np.isfinite(made.now("capacity_ah")[0])
    assert sorted(made.rank[np.isfinite(made.rank)]) == list(range(1, N))
    assert made.drifts == ()
