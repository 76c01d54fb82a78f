from dataclasses import replace

import numpy as np
import pytest

from simulator.balancing.study import (
    CIRCUITS,
    LIMITS,
    THESIS,
    Study,
    difference_within_packs,
    run_study,
    thesis_figures,
)
from simulator.balancing.thesis_tables import THESIS_PASSIVE
from simulator.errors import ParameterError

SMALL = Study(n_packs=2, per_pack=3, rate_c=None, soc=0.5, spread=0.04, hours=0.5)


@pytest.mark.parametrize("circuit", CIRCUITS)
def test_a_rest_loses_no_charge_but_in_resistors_and_only_a_circuit_narrows_the_difference(circuit):
    done = run_study(SMALL, circuit)
    started, ended = np.ptp(done.soc[0]), np.ptp(done.soc[-1])
    assert started == pytest.approx(0.04)
    assert done.soc_difference == ended
    assert (ended < started - 1e-3) == (circuit != "none")
    assert done.lost_soc >= -4e-4, "charge that moves between unequal capacities moves the mean a little"
    assert done.charger_wh == 0.0
    assert (done.stopped_by == "time") == (ended > SMALL.until)
    assert difference_within_packs(SMALL, done) <= ended


def test_a_charge_ends_at_the_current_that_counts_as_full_within_the_voltage():
    study = Study(n_packs=1, per_pack=4, rate_c=0.5, soc=0.9, spread=0.0)
    done = run_study(study, "none")
    assert done.stopped_by is None
    assert done.current_a[0] == pytest.approx(0.5 * study.rated_ah)
    assert done.current_a[-1] < 0.02 * study.rated_ah
    assert done.highest_v < 4.195
    assert done.charger_wh == pytest.approx(-done.lost_soc * study.rated_ah * 4 * 4.1, rel=0.05)


def test_a_seed_says_which_cell_is_high():
    one, other = replace(SMALL, seed=1).start_soc, replace(SMALL, seed=2).start_soc
    np.testing.assert_allclose(sorted(one), np.linspace(0.48, 0.52, 6))
    np.testing.assert_allclose(sorted(one), sorted(other))
    assert one.tolist() != other.tolist()
    assert replace(SMALL, n_packs=1, per_pack=1).start_soc.tolist() == [0.5]


def test_the_thesis_is_beside_a_run_only_where_it_made_that_run():
    assert thesis_figures(replace(THESIS, rate_c=1.0), "passive") == THESIS_PASSIVE[1.0][40]
    assert thesis_figures(replace(THESIS, rate_c=2.0), "transformer") is not None
    assert thesis_figures(THESIS, "switched-capacitor") is None
    for other in (replace(THESIS, spread=0.02), replace(THESIS, rate_c=None), replace(THESIS, rate_c=0.3), Study()):
        assert thesis_figures(other, "passive") is None
    assert THESIS.start_soc.tolist() == [0.21, 0.209, 0.202, 0.204, 0.2, 0.207]
    assert THESIS.accumulator().temperature_degc.tolist() == [20.0] * 6


@pytest.mark.parametrize(
    ("name", "value"),
    [*((name, limits[1] * 1.01 + 1e-6) for name, limits in LIMITS.items()), ("n_packs", 51), ("per_pack", 0)],
)
def test_a_number_outside_the_model_is_refused_by_name(name, value):
    with pytest.raises(ParameterError, match=name):
        replace(Study(), **{name: value})


def test_a_spread_that_reaches_beyond_empty_or_full_is_refused():
    with pytest.raises(ParameterError, match="spread"):
        Study(soc=0.05, spread=0.2)


def test_a_circuit_that_does_not_exist_is_refused():
    with pytest.raises(ParameterError, match="circuit"):
        run_study(SMALL, "magic")


def test_cells_that_are_even_already_need_no_time():
    study = replace(SMALL, spread=0.0)
    done = run_study(study, "passive")
    assert (done.hours, done.stopped_by, len(done.time_h)) == (0.0, None, 1)
