import numpy as np
import pytest

from app.analysis.report.over_time import POINTS, over_time
from app.analysis.totals import Totals


def totals(time_s, **changes):
    n = len(time_s)
    values = {
        "current_a": np.full(n, 10.0),
        "voltage_v": np.full(n, 350.0),
        "v_min_v": np.full(n, 3.6),
        "v_min_cell": np.zeros(n),
        "v_max_v": np.full(n, 3.7),
        "t_max_degc": np.full(n, 31.0),
        "t_max_cell": np.zeros(n),
        "t_mean_degc": np.full(n, 30.0),
        "soc": np.linspace(0.9, 0.4, n),
    }
    return Totals(time_s=np.asarray(time_s, dtype=float), **values | changes)


def test_an_extreme_of_one_sample_is_kept_in_few_points():
    volts = np.full(50_000, 3.6)
    volts[31_234] = 2.4
    made = over_time(totals(np.arange(50_000) * 0.1, v_min_v=volts))
    assert len(made.time_s) == len(made.voltage_min_v) == POINTS
    assert min(made.voltage_min_v) == 2.4
    assert made.time_s[made.voltage_min_v.index(2.4)] == pytest.approx(3123.4, abs=10.0)
    assert made.soc[0] == pytest.approx(0.9, abs=0.001)


@pytest.mark.parametrize("n", [30, 5000])
def test_a_gap_is_a_point_without_values(n):
    time_s = np.concatenate((np.arange(n) * 0.1, 1000.0 + np.arange(n) * 0.1))
    made = over_time(totals(time_s))
    gaps = [k for k, value in enumerate(made.power_mean_w) if value is None]
    assert len(gaps) == 1
    assert n * 0.1 < made.time_s[gaps[0]] < 1000.0
    assert made.time_s == sorted(made.time_s)


def test_power_has_its_mean_between_its_extremes_and_what_is_missing_is_none():
    amps = np.tile([0.0, 100.0], 2000)
    made = over_time(totals(np.arange(4000) * 0.1, current_a=amps, soc=np.full(4000, np.nan)))
    assert (made.power_min_w[3], made.power_mean_w[3], made.power_max_w[3]) == (0, pytest.approx(17500, rel=0.2), 35000)
    assert set(made.soc) == {None}


def test_of_an_empty_recording_nothing_is_drawn():
    made = over_time(totals([]))
    assert (made.time_s, made.power_mean_w) == ([], [])
