"""Values that come one by one as rows: against the same said with loops, and the assembler that works live."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.battery.battery import Battery
from app.battery.source import CellSignals, DbcMapping
from app.sessions.storage.battery_columns import Holder, grid_of
from app.sources.dbc.assembly import Assembler
from app.sources.dbc.battery_decoder import ChannelValues
from tests.campaign import examples

S = 1_000_000
TIMES = st.lists(st.integers(0, 5 * S), min_size=1, max_size=30, unique=True).map(sorted)


def held(times_us, values, grid_us, max_age_s=1.0):
    """The newest value at each time, written out."""
    found = []
    for at in grid_us:
        before = [(t, v) for t, v in zip(times_us, values, strict=True) if t <= at]
        found.append(before[-1][1] if before and at - before[-1][0] <= max_age_s * S else np.nan)
    return found


@given(TIMES, st.integers(1, 4 * S))
def test_each_row_has_the_newest_value_that_is_not_too_old_however_it_came(times_us, cut_us):
    times, values = np.array(times_us), np.arange(len(times_us), dtype=float)
    grid_us = grid_of(0, 5 * S, S // 10)
    assert list(Holder(1, 1.0).rows([(np.array([0]), times, values[:, None])], grid_us)[:, 0]) == pytest.approx(
        held(times_us, values, grid_us), nan_ok=True
    )
    holder, parts = Holder(1, 1.0), []
    for of_part, grid in ((times <= cut_us, grid_us <= cut_us), (times > cut_us, grid_us > cut_us)):
        samples = [(np.array([0]), times[of_part], values[of_part][:, None])] if of_part.any() else []
        parts.append(holder.rows(samples, grid_us[grid])[:, 0])
    assert list(np.concatenate(parts)) == pytest.approx(held(times_us, values, grid_us), nan_ok=True)


@settings(max_examples=examples(30))
@given(TIMES)
def test_rows_are_what_the_assembler_makes_live(times_us):
    values = np.arange(len(times_us), dtype=float)
    entry = CellSignals("V{cell}", max_age_s=0.7)
    assembler = Assembler(Battery("x", (1,)), DbcMapping(("x.dbc",), {"voltage": (entry,)}, period_s=0.1))
    told = ChannelValues(np.array(times_us) * 1000, np.zeros(len(times_us), np.intp), values)
    live = {m.t_ns // 1000: m.voltage_v[0] for m in assembler.feed({"voltage": told}, 6 * S * 1000)}
    grid_us = np.array(sorted(live))
    rows = Holder(1, 0.7).rows([(np.array([0]), np.array(times_us), values[:, None])], grid_us)
    assert list(rows[:, 0]) == pytest.approx([live[at] for at in grid_us.tolist()], nan_ok=True)


def test_without_an_age_a_value_lives_for_three_of_its_own_periods():
    times = np.arange(10) * 2 * S
    rows = Holder(1).rows([(np.array([0]), times, np.ones((10, 1)))], np.array([18 * S, 23 * S, 25 * S]))
    assert np.isfinite(rows[:, 0]).tolist() == [True, True, False]


def test_of_two_messages_that_tell_a_cell_the_later_one_counts():
    one = (np.array([0, 1]), np.array([0, 2 * S]), np.array([[1.0, 1.0], [3.0, 3.0]]))
    other = (np.array([0]), np.array([S]), np.array([[2.0]]))
    rows = Holder(2, 10.0).rows([one, other], np.array([0, S, 2 * S]))
    assert rows.tolist() == [[1.0, 1.0], [2.0, 1.0], [3.0, 3.0]]


@pytest.mark.parametrize(("first", "last", "expected"), [(0, 2, [0, 1, 2]), (1, 29, [10, 20]), (11, 19, [])])
def test_a_grid_is_of_whole_periods(first, last, expected):
    period = 10 if last > 2 else 1
    assert grid_of(first, last, period).tolist() == expected
