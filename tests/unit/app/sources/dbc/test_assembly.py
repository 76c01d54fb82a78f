import numpy as np
import pytest

from app.battery.battery import Battery, SignalName
from app.battery.source import CellSignals, Reading, SpeaksDbc
from app.sources.dbc.assembly import LEAST_AGE_S, PERIODS_BRIDGED, UNKNOWN_AGE_S, Assembler
from app.sources.dbc.battery_decoder import Values

S = 1_000_000_000
CURRENT = Reading(SignalName("", "I"))


def values(*rows):
    """Values of (time in seconds, channel, value)."""
    times, index, value = zip(*rows, strict=True)
    return Values(np.array([round(t * S) for t in times]), np.array(index, np.intp), np.array(value, float))


def assembler(max_age_s=None, n_cells=2, period_s=0.1):
    entry = CellSignals("V{cell}", max_age_s=max_age_s)
    return Assembler(
        Battery("x", (n_cells,)),
        SpeaksDbc(("x.dbc",), {"voltage": (entry,)}, current=CURRENT, period_s=period_s),
    )


def test_a_measurement_takes_the_newest_value_up_to_its_time_and_no_later_one():
    found = assembler().feed({"voltage": values((0.05, 0, 3.0), (0.08, 0, 3.1), (0.25, 0, 3.2), (0.30, 1, 3.9))})
    assert [m.t_ns for m in found] == [S // 10, 2 * S // 10, 3 * S // 10]
    assert [m.voltage_v[0] for m in found] == [3.1, 3.1, 3.2]
    assert [int(m.voltage_t_ns[0]) for m in found] == [round(0.08 * S)] * 2 + [round(0.25 * S)]
    assert np.isnan(found[1].voltage_v[1])


def test_a_sample_is_a_new_voltage_with_a_new_current():
    found = assembler().feed(
        {
            "voltage": values((0.05, 0, 3.0), (0.15, 0, 3.0), (0.35, 0, 3.0)),
            "current": values((0.06, 0, 5.0), (0.25, 0, 6.0), (0.36, 0, 7.0), (0.45, 0, 7.0)),
        }
    )
    assert [m.is_sample for m in found] == [True, False, False, True]


def test_a_value_is_missing_after_the_longest_age_that_the_profile_names():
    hear = assembler(max_age_s=1.0)
    hear.feed({"voltage": values((0.05, 0, 3.0))})
    ages = [(m.t_ns - 0.05 * S) / S for m in hear.feed({}, 3 * S) if np.isfinite(m.voltage_v[0])]
    assert max(ages) == pytest.approx(1.0, abs=0.1)
    assert max(ages) <= 1.0


@pytest.mark.parametrize("period_s", [0.02, 0.5, 5.0])
def test_where_the_profile_names_none_a_value_lives_for_three_of_its_own_periods(period_s):
    hear = assembler()
    times = [k * period_s + 0.01 for k in range(8)]
    hear.feed({"voltage": values(*((t, 0, 3.0) for t in times))})
    later = hear.feed({}, round((times[-1] + 5 * period_s + 2.0) * S))
    lived = [m.t_ns / S - times[-1] for m in later if np.isfinite(m.voltage_v[0])]
    most = max(LEAST_AGE_S, PERIODS_BRIDGED * period_s)
    assert max(lived) == pytest.approx(most, abs=0.11)


def test_a_channel_that_was_heard_once_is_kept_for_a_minute():
    hear = assembler(period_s=1.0)
    hear.feed({"voltage": values((0.5, 0, 3.0))})
    later = hear.feed({}, 100 * S)
    assert sum(np.isfinite(m.voltage_v[0]) for m in later) == pytest.approx(UNKNOWN_AGE_S, abs=1)


def test_values_in_parts_make_the_measurements_of_values_in_one():
    rows = [(0.013 * k, k % 2, 3.0 + 0.01 * k) for k in range(60)]
    whole = assembler().feed({"voltage": values(*rows)})
    parts = assembler()
    pieces = [m for k in range(0, 60, 7) for m in parts.feed({"voltage": values(*rows[k : k + 7])})]
    assert len(pieces) == len(whole)
    for one, other in zip(pieces, whole, strict=True):
        np.testing.assert_array_equal(one.voltage_v, other.voltage_v)
        assert (one.t_ns, one.is_sample) == (other.t_ns, other.is_sample)


def test_nothing_heard_makes_no_measurement():
    assert assembler().feed({}) == []
