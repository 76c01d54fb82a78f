"""One interface over all filters: counting, cells of their own, records, refusals."""

from dataclasses import replace

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.cell_model.circuit import Evidence
from app.estimation.errors import EstimatorError, ShapeError
from app.estimation.filters.estimators import FILTERS, make_estimator
from tests.open_loop import simulate

CELL = load_cell("samsung-25r-10p")
OWN_AH = np.array([0.8, 1.0, 1.1]) * CELL.capacity_ah
GROWN = np.array([1.0, 1.6, 0.8])
VOLTS = CELL.ocv.voltage(np.full(3, 0.8))
DEGC = np.full(3, 25.0)
STEPS, N = 150, 3


def counter(soc, **words):
    estimator = make_estimator("coulomb", CELL, 1)
    estimator.start([3.8], [25.0], 0.0, soc=soc, **words)
    return estimator


def test_an_hour_at_1c_empties_a_full_cell_and_charging_counts_the_efficiency():
    estimator = counter(1.0)
    for _ in range(36):
        estimates = estimator.step(100.0, CELL.capacity_ah, [3.7], [25.0])
    assert estimates.soc[0] == pytest.approx(0.0, abs=1e-9)
    estimates = counter(0.2).step(1800.0, -CELL.capacity_ah, [3.7], [25.0])
    assert estimates.soc[0] == pytest.approx(0.2 + 0.5 * CELL.coulombic_efficiency)


def test_no_voltage_ever_moves_a_count():
    high, low = counter(0.5), counter(0.5)
    for _ in range(100):
        a, b = high.step(1.0, 5.0, [4.2], [25.0]), low.step(1.0, 5.0, [3.0], [25.0])
    assert a.soc[0] == b.soc[0]
    assert not a.accepted.any()
    assert high.voltage_soc() is None


def test_the_sigma_of_a_count_begins_as_given_and_never_shrinks():
    estimator = counter(0.5, soc_sigma=0.02)
    sigmas = [estimator.step(10.0, i, [3.7], [25.0]).soc_sigma[0] for i in (0.0, 50.0, -50.0, 0.0, 20.0)]
    assert sigmas[0] == pytest.approx(0.02, rel=1e-3)
    assert sigmas[1] > sigmas[0]
    assert sigmas[-1] > sigmas[0]
    assert np.sqrt(estimator.state_cov[0, 0, 0]) == pytest.approx(sigmas[-1])


def test_a_model_that_does_not_fit_shows_in_the_innovation_of_a_count_and_is_called_invalid():
    estimator = counter(0.9)
    for _ in range(600):
        estimates = estimator.step(1.0, 0.0, [3.4], [25.0])
    assert estimates.innovation_v[0] == pytest.approx(3.4 - CELL.ocv.voltage(np.array([0.9]))[0], abs=0.01)
    assert not estimates.model_valid[0]


def test_voltages_alone_say_a_soc_until_one_was_given():
    estimator = make_estimator("cdkf", CELL, 3)
    estimator.start(VOLTS, DEGC, 0.0)
    soc, sigma = estimator.voltage_soc()
    assert soc == pytest.approx(np.full(3, 0.8), abs=0.02)
    assert (sigma > 0.0).all()
    estimator.start(VOLTS, DEGC, 0.0, soc=0.8)
    assert estimator.voltage_soc() is None


def counted(estimator, steps=120):
    estimator.start(VOLTS, DEGC, 0.0, 0.8, 0.001)
    for k in range(steps):
        found = estimator.step(5.0, 40.0 if k % 3 else -20.0, np.full(3, np.nan), DEGC)
    return found.soc


@pytest.mark.parametrize("name", ["coulomb", "cdkf", "fused"])
def test_charge_is_counted_over_the_cells_own_capacity(name):
    mixed = make_estimator(name, CELL, 3)
    mixed.use_capacity(OWN_AH)
    alone = [counted(make_estimator(name, replace(CELL, capacity_ah=float(own)), 3))[k] for k, own in enumerate(OWN_AH)]
    np.testing.assert_allclose(counted(mixed), alone, atol=2e-3)


def grown(factor):
    return replace(
        CELL,
        r0_ohm=factor * CELL.r0_ohm,
        r_ohm=factor * CELL.r_ohm,
        overpotential_v=None if CELL.overpotential_v is None else factor * CELL.overpotential_v,
    )


@pytest.mark.parametrize("name", ["coulomb", "ekf", "cdkf", "fused"])
def test_voltages_are_predicted_with_the_cells_own_resistance(name):
    def predicted(cell, factors):
        estimator = make_estimator(name, cell, 3)
        estimator.use_resistance(factors)
        estimator.start(VOLTS, DEGC, 30.0, 0.8, 0.001)
        for k in range(100):
            found = estimator.step(1.0, 60.0 if k % 3 else -20.0, np.full(3, np.nan), DEGC)
        return found.voltage_v, found.soc

    mixed = predicted(CELL, GROWN)
    for k, factor in enumerate(GROWN):
        alone = predicted(grown(factor), 1.0)
        np.testing.assert_allclose(mixed[0][k], alone[0][k], atol=4e-3)
        np.testing.assert_allclose(mixed[1][k], alone[1][k], atol=5e-3)
    assert np.ptp(mixed[0]) > 0.003


def test_a_capacity_or_a_resistance_that_cannot_be_is_refused():
    estimator = make_estimator("fused", CELL, 3)
    with pytest.raises(ShapeError):
        estimator.use_capacity([25.0, 25.0])
    with pytest.raises(EstimatorError, match="capacity"):
        estimator.use_capacity([25.0, 0.0, 25.0])
    with pytest.raises(EstimatorError, match="capacity"):
        estimator.use_capacity(float("nan"))
    with pytest.raises(EstimatorError, match="factor"):
        estimator.use_resistance(-1.0)


def samples():
    rng = np.random.default_rng(9)
    volts = 3.8 + 0.02 * rng.normal(size=(STEPS, N))
    volts[50:60, 1] = np.nan
    current = np.where(rng.random(STEPS) < 0.1, np.nan, 60.0 * rng.random(STEPS))
    degc = np.broadcast_to(25.0 + 0.01 * np.arange(STEPS)[:, None], (STEPS, N)).copy()
    return rng.choice([0.0, 0.1, 5.0], STEPS), current, volts, degc


@pytest.mark.parametrize("name", FILTERS)
def test_a_record_is_its_samples_one_by_one(name):
    dt, current, volts, degc = samples()
    whole, single = (make_estimator(name, CELL, N) for _ in range(2))
    for estimator in (whole, single):
        estimator.start(volts[0], degc[0], 0.0, soc=0.7)
    found = whole.run(dt, current, volts, degc)
    steps = [single.step(float(dt[k]), float(current[k]), volts[k], degc[k]).numbers for k in range(STEPS)]
    assert found.soc.shape == (STEPS, N)
    np.testing.assert_array_equal(found.numbers, np.stack(steps, axis=1))
    np.testing.assert_array_equal(whole.state_cov, single.state_cov)


def test_a_record_of_soc_alone_is_that_of_the_whole_one():
    dt, current, volts, degc = samples()
    whole, alone = (make_estimator("fused", CELL, N) for _ in range(2))
    for estimator in (whole, alone):
        estimator.start(volts[0], degc[0], 0.0)
    every, few = whole.run(dt, current, volts, degc), alone.run(dt, current, volts, degc, soc_only=True)
    np.testing.assert_array_equal(few.soc, every.soc)
    np.testing.assert_array_equal(few.soc_sigma, every.soc_sigma)
    np.testing.assert_array_equal(alone.state_mean, whole.state_mean)
    with pytest.raises(IndexError):
        _ = few.model_valid


@pytest.mark.parametrize("wrong", ["dt_s", "current_a", "voltage_v", "temperature_degc"])
def test_an_array_of_another_shape_is_named(wrong):
    arrays = dict(zip(("dt_s", "current_a", "voltage_v", "temperature_degc"), samples(), strict=True))
    arrays[wrong] = arrays[wrong][:, None] if arrays[wrong].ndim == 1 else arrays[wrong][:, :1]
    estimator = make_estimator("fused", CELL, N)
    estimator.start(VOLTS, DEGC, 0.0)
    with pytest.raises(ShapeError, match=wrong):
        estimator.run(**arrays)


@pytest.mark.parametrize("step", [-1.0, float("nan"), float("inf")])
def test_a_step_that_is_none_is_refused(step):
    dt, current, volts, degc = samples()
    estimator = make_estimator("fused", CELL, N)
    with pytest.raises(EstimatorError, match="started"):
        estimator.run(dt, current, volts, degc)
    estimator.start(VOLTS, DEGC, 0.0)
    dt[7] = step
    with pytest.raises(EstimatorError, match="step"):
        estimator.run(dt, current, volts, degc)
    with pytest.raises(EstimatorError, match="step"):
        estimator.step(step, 0.0, VOLTS, DEGC)


def test_charge_that_nobody_measured_widens_sigma():
    estimator = make_estimator("fused", CELL, N)
    estimator.start(VOLTS, DEGC, 0.0, soc=float(CELL.ocv.soc_at(VOLTS[0])))
    before = estimator.step(1.0, 0.0, VOLTS, DEGC).soc_sigma
    estimator.widen(0.05)
    assert (estimator.step(1.0, 0.0, VOLTS, DEGC).soc_sigma > before).all()
    assert (estimator.engine.get("start_v2")[0] >= 0.05**2).all()


def test_a_capacity_that_is_learned_elsewhere_is_not_counted_twice():
    estimator = make_estimator("fused", CELL, N)
    estimator.start(VOLTS, DEGC, 0.0)
    estimator.engine.set("gain", np.full(N, 0.25))
    estimator.engine.set("fused_gain", np.full(N, 0.25))
    assert estimator.capacity()[0] == pytest.approx(0.8 * CELL.capacity_ah)
    estimator.use_capacity(0.8 * CELL.capacity_ah)
    assert estimator.engine.get("gain") == pytest.approx(np.zeros(N), abs=1e-12)
    assert estimator.capacity()[0] == pytest.approx(0.8 * CELL.capacity_ah)


def raced(peak_a, shares):
    """Return an estimator and estimates of 15 minutes at `peak_a`, 150 A seen, cells with shares of the capacity."""
    seen = replace(CELL, fit_current_max_a=150.0)
    time_s = np.arange(0.0, 900.0, 0.1)
    current = np.where((time_s > 20.0) & (time_s % 8.0 < 400.0 / peak_a), peak_a, 0.0)
    degc = np.full((time_s.size, len(shares)), 25.0)
    cells = [replace(seen, capacity_ah=share * CELL.capacity_ah) for share in shares]
    volts = np.stack([simulate(cell, time_s, current, degc[:, 0], 0.95)[1] for cell in cells], axis=1)
    estimator = make_estimator("fused", seen, len(shares))
    estimator.start(volts[0], degc[0], 0.0, soc=0.95)
    return estimator, estimator.run(np.full(time_s.size, 0.1), current, volts, degc)


@pytest.mark.parametrize(("peak_a", "learns"), [(100.0, True), (200.0, False)])
def test_a_drive_beyond_the_currents_of_the_cell_file_says_nothing_of_capacity(peak_a, learns):
    estimator, found = raced(peak_a, [0.8])
    assert bool(found.model_valid[2970, 0]) == learns, "while the current flows"
    assert found.model_valid[2999, 0], "and none flows, or one that was seen"
    own_ah = estimator.capacity()[0][0]
    assert own_ah < 0.95 * CELL.capacity_ah if learns else own_ah == pytest.approx(CELL.capacity_ah)


def test_beyond_those_currents_cells_still_show_what_their_capacities_differ_by():
    estimator, _ = raced(200.0, [1.0, 1.2])
    own_ah = estimator.capacity()[0] / CELL.capacity_ah
    assert own_ah.mean() == pytest.approx(1.0, abs=0.01), "what all cells share is left to the cell file"
    assert own_ah[1] - own_ah[0] > 0.05


def test_below_the_lowest_soc_that_the_cell_file_has_seen_a_count_goes_before_the_voltage():
    found = []
    for evidence in (None, Evidence(lowest=((25.0, 0.2),))):
        estimator = make_estimator("fused", replace(CELL, evidence=evidence), 1)
        volts = CELL.ocv.voltage(np.array([0.23]))
        estimator.start(volts, DEGC[:1], 0.0, soc=0.23)
        for _ in range(200):
            estimator.step(0.1, 0.0, volts, DEGC[:1])
        for _ in range(600):  # half of what is left is drawn, and the voltage reads far less
            estimates = estimator.step(1.0, 0.13 * CELL.capacity_ah * 6.0, CELL.ocv.voltage(np.array([0.02])), DEGC[:1])
        found.append((estimates.soc[0], estimates.soc_sigma[0], estimates.model_valid[0]))
    (without, _, _), (seen, sigma, is_valid) = found
    assert abs(seen - 0.10) < abs(without - 0.10)
    assert seen == pytest.approx(0.10, abs=3.0 * sigma)
    assert not is_valid
