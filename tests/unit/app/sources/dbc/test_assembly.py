import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.battery.battery import Battery, SignalName
from app.battery.source import CellSignals, DbcMapping, ScalarSignal
from app.sources.dbc.assembly import LEAST_AGE_S, PERIODS_BRIDGED, UNKNOWN_AGE_S, Assembler
from app.sources.dbc.battery_decoder import ChannelValues

S = 1_000_000_000
CURRENT = ScalarSignal(SignalName("", "I"))


def values(*rows):
    """Values of (time in seconds, channel, value)."""
    times, index, value = zip(*rows, strict=True)
    return ChannelValues(np.array([round(t * S) for t in times]), np.array(index, np.intp), np.array(value, float))


def assembler(max_age_s=None, n_cells=2, period_s=0.1):
    entry = CellSignals("V{cell}", max_age_s=max_age_s)
    return Assembler(
        Battery("x", (n_cells,)),
        DbcMapping(("x.dbc",), {"voltage": (entry,)}, current=CURRENT, period_s=period_s),
    )


def test_a_sample_is_a_new_current_while_voltages_are_known():
    found = assembler().feed(
        {
            "voltage": values((0.05, 0, 3.0), (0.15, 0, 3.0), (0.35, 0, 3.0)),
            "current": values((0.06, 0, 5.0), (0.25, 0, 6.0), (0.36, 0, 7.0), (0.45, 0, 7.0)),
        }
    )
    assert [m.is_sample for m in found] == [True, False, True, True]


def test_a_channel_that_was_heard_once_is_kept_for_a_minute():
    hear = assembler(period_s=1.0)
    hear.feed({"voltage": values((0.5, 0, 3.0))})
    later = hear.feed({}, 100 * S)
    assert sum(np.isfinite(m.voltage_v[0]) for m in later) == pytest.approx(UNKNOWN_AGE_S, abs=1)


@given(
    st.lists(st.tuples(st.integers(1, 2_000), st.integers(0, 2), st.floats(2.5, 4.3)), min_size=1, max_size=60),
    st.sampled_from([0.02, 0.1, 0.5]),
)
def test_a_measurement_never_holds_what_came_later_nor_an_older_one_than_the_newest(rows, period_s):
    rows = sorted(rows, key=lambda row: row[0])
    rows = [(t / 1000, cell, volt) for t, cell, volt in rows]
    for measured in assembler(max_age_s=100.0, n_cells=3, period_s=period_s).feed({"voltage": values(*rows)}):
        for cell in range(3):
            before = [volt for t, i, volt in rows if i == cell and round(t * S) <= measured.t_ns]
            if before:
                assert measured.voltage_v[cell] == before[-1]
            else:
                assert np.isnan(measured.voltage_v[cell])


@given(st.lists(st.integers(1, 900), min_size=2, max_size=30), st.integers(1, 29))
def test_wherever_batches_are_cut_measurements_are_the_same(gaps_ms, cut):
    times = np.cumsum(gaps_ms) / 1000
    rows = [(t, k % 2, 3.0 + 0.01 * k) for k, t in enumerate(times)]
    amps = [(t, 0, float(k)) for k, t in enumerate(times)]
    whole = assembler().feed({"voltage": values(*rows), "current": values(*amps)})
    parts, found = assembler(), []
    for some in (slice(0, cut), slice(cut, None)):
        if rows[some]:
            found += parts.feed({"voltage": values(*rows[some]), "current": values(*amps[some])})
    assert [(m.t_ns, m.is_sample) for m in found] == [(m.t_ns, m.is_sample) for m in whole]
    for one, other in zip(found, whole, strict=True):
        np.testing.assert_array_equal(one.voltage_v, other.voltage_v)
        np.testing.assert_equal(one.current_a, other.current_a)


def test_a_silence_of_hours_makes_no_measurements_of_its_own():
    hear = assembler()
    rows = {"voltage": values((0.05, 0, 3.0), (0.15, 0, 3.1), (80_000.05, 0, 3.2), (80_000.15, 0, 3.3))}
    found = hear.feed(rows)
    assert len(found) < 10
    assert [m.voltage_v[0] for m in found if np.isfinite(m.voltage_v[0])][-1] == 3.2
    assert found[-1].t_ns == 80_000 * S + S // 10
    assert len(hear.feed({}, 200_000 * S)) < 10


def test_a_value_that_is_invalid_replaces_the_one_before():
    found = assembler().feed({"voltage": values((0.05, 0, 3.7), (0.15, 0, np.nan))})
    assert found[0].voltage_v[0] == 3.7
    assert len(found) == 1
    hear = assembler()
    hear.feed({"voltage": values((0.05, 0, 3.7), (0.15, 0, np.nan))})
    assert np.isnan(hear.feed({}, S // 2)[-1].voltage_v).all()


@pytest.mark.parametrize("slow_s", [0.4, 0.5, 2.0, 5.0])
def test_each_cell_lives_for_three_of_its_own_periods_where_the_profile_names_no_age(slow_s):
    hear = assembler()
    fast = [(0.02 * k + 0.01, 0, 3.0) for k in range(2000)]
    slow = [(slow_s * k + 0.015, 1, 3.1) for k in range(int(40 / slow_s))]
    hear.feed({"voltage": values(*sorted(fast + slow))})
    later = hear.feed({}, 70 * S)
    for cell, period_s, last_s in ((0, 0.02, fast[-1][0]), (1, slow_s, slow[-1][0])):
        lived = [m.t_ns / S - last_s for m in later if np.isfinite(m.voltage_v[cell])]
        assert max(lived) == pytest.approx(max(LEAST_AGE_S, PERIODS_BRIDGED * period_s), abs=0.11)


@pytest.mark.parametrize("given", [{}, {"humidity": values((0.01, 0, 1.0))}])
def test_nothing_heard_of_the_battery_makes_no_measurement(given):
    assert assembler().feed(given) == []


@pytest.mark.parametrize("ages_s", [(1.0,), (1.0, 4.0)])
def test_a_value_is_missing_after_the_longest_age_that_the_profile_names(ages_s):
    entries = tuple(CellSignals(f"V{k}_{{cell}}", max_age_s=age_s) for k, age_s in enumerate(ages_s))
    hear = Assembler(Battery("x", (2,)), DbcMapping(("x.dbc",), {"voltage": entries}))
    hear.feed({"voltage": values((0.05, 0, 3.0))})
    lived = [m.t_ns / S - 0.05 for m in hear.feed({}, 8 * S) if np.isfinite(m.voltage_v[0])]
    assert max(lived) == pytest.approx(ages_s[-1], abs=0.1)
    assert max(lived) <= ages_s[-1]
