"""What the pages are told of the future, from frames of a made-up master."""

from dataclasses import replace

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.cell_model.circuit import CellLimits
from app.estimation.filters.estimators import make_estimator
from app.estimation.health.capacity import REST_S, CapacityBetweenRests, CapacityTracker
from app.live.learned_state import LearnedState, load_learned_state, save_learned_state
from app.live.pipeline import Pipeline
from app.live.prediction import Predictor
from app.live.remembered_charge import RememberedCharge
from app.sources.master.source import MasterSource

CELL = load_cell("samsung-25r-10p")


def pipeline_of(cell, master):
    chain = Pipeline(
        MasterSource("serial"),
        lambda: make_estimator("fused", cell, 96),
        filter_name="fused",
        cell_name="c",
        predictor=Predictor(cell, (12,) * 8),
    )
    chain.feed(master.config())
    return chain


@pytest.fixture
def pipeline(master):
    return pipeline_of(CELL, master)


def drive(pipeline, master, frames, current_raw=5000):
    master.set("i_fs", [current_raw])
    snapshot = None
    for _ in range(frames):
        snapshot = pipeline.feed(master.frame()).snapshot
        pipeline.predict()
    return snapshot


def test_power_time_and_energy_are_told_with_cell_and_reason(pipeline, master):
    prediction = drive(pipeline, master, 25).prediction
    discharge = prediction.power.discharge
    assert [limit.horizon_s for limit in discharge] == [1.0, 10.0, 30.0]
    assert discharge[0].power_w >= discharge[2].power_w > 0
    assert discharge[0].current_a <= 200, "the configuration's limit"
    assert {trip.limit for trip in prediction.to_trip} == {"v_min", "soc_min", "temperature_max"}
    full = {trip.limit: trip.seconds for trip in prediction.to_trip_full}
    present = {trip.limit: trip.seconds for trip in prediction.to_trip}
    assert np.isfinite(full["soc_min"])
    assert full["soc_min"] < present["soc_min"]
    assert 500 < prediction.energy_left_wh < 9000
    assert prediction.laps is None, "no lap was driven yet"
    assert prediction.laps_condition.code == "laps-few"
    assert prediction.coverage == 0.9
    assert prediction.energy_left_low_wh < prediction.energy_left_wh < prediction.energy_left_high_wh
    for limit in (*discharge, *prediction.power.charge):
        assert limit.low_w <= limit.power_w <= limit.high_w
    for trip in (*prediction.to_trip, *prediction.to_trip_full):
        assert trip.low_s <= trip.seconds <= trip.high_s


def test_a_prediction_tells_its_age_and_its_conditions(pipeline, master):
    drive(pipeline, master, 25)
    prediction = pipeline.tick(master.t_ns + 3_000_000_000, 1).snapshot.prediction
    assert 3.0 <= prediction.age_s < 4.5
    assert prediction.to_trip_condition.code == "to-trip-at-load"
    assert prediction.energy_condition.code == "energy-at-load"
    assert prediction.power_condition.code == "power-held"
    assert prediction.measured_current_max_a == CELL.fit_current_max_a


@pytest.mark.parametrize(("flags", "why"), [([0b1], "relays-open"), ([0], "fault")])
def test_with_open_relays_or_a_fault_no_power_can_flow_and_there_are_no_laps(pipeline, master, flags, why):
    drive(pipeline, master, 25)
    for _ in range(3):
        pipeline.mark_lap()
        drive(pipeline, master, 60, current_raw=9000)
    drive(pipeline, master, 30, current_raw=9000)
    before = drive(pipeline, master, 5).prediction
    assert before.laps.laps > 0
    master.set("status.flags", flags)
    prediction = drive(pipeline, master, 1, current_raw=0).prediction
    assert prediction.laps is None
    assert prediction.laps_condition.code == f"laps-none-{why}"
    assert prediction.power_condition.code == f"power-none-{why}"
    for limit in (*prediction.power.discharge, *prediction.power.charge):
        assert (limit.power_w, limit.high_w, limit.reason) == (0.0, 0.0, "relays")
    assert prediction.nearest is None
    assert prediction.to_trip == ()
    if why == "fault":
        assert prediction.energy_left_wh is None
        assert prediction.energy_condition.code == "energy-none-fault"
    else:
        assert prediction.energy_left_wh == pytest.approx(before.energy_left_wh, rel=0.01), "it is still in the cells"


def test_the_next_limit_is_of_the_load_not_of_one_touch_of_the_brake(pipeline, master):
    drive(pipeline, master, 150, current_raw=12000)
    for _ in range(3):
        braking = drive(pipeline, master, 11, current_raw=-2000).prediction
        assert {trip.limit for trip in braking.to_trip} == {"v_min", "soc_min", "temperature_max"}
        drive(pipeline, master, 30, current_raw=12000)
    charging = drive(pipeline, master, 600, current_raw=-2000).prediction
    assert {trip.limit for trip in charging.to_trip} == {"v_max", "soc_max", "temperature_max"}


def test_at_rest_no_limit_comes_nearer(pipeline, master):
    master.set("v", [41950] * 96)
    prediction = drive(pipeline, master, 60, current_raw=-40).prediction
    assert prediction.nearest is None
    assert all(trip.seconds == np.inf for trip in prediction.to_trip)


def test_nothing_is_foretold_without_voltages(pipeline, master):
    master.set("v", [0] * 96)
    assert drive(pipeline, master, 25).prediction is None


def test_health_is_not_told_before_a_capacity_was_learned(pipeline, master):
    cells = drive(pipeline, master, 60).cells
    assert np.isnan(cells.soh_capacity).all()
    assert (cells.capacity_ah == CELL.capacity_ah).all(), "what is counted with is the cell file's"


def test_old_predictions_are_not_shown(pipeline, master):
    drive(pipeline, master, 25)
    assert pipeline.tick(master.t_ns + 11_000_000_000, 1).snapshot.prediction is None


def test_capacity_comes_from_the_charge_between_two_rests():
    capacities = CapacityBetweenRests(CELL, CapacityTracker(CELL.capacity_ah, 3))
    true_ah = np.array([25.0, 22.0, 25.0])
    high, drawn_ah = 0.9, 12.0

    def rest(soc):
        told = [capacities.step(1.0, 0.0, CELL.ocv.voltage(soc)) for _ in range(int(REST_S) + 1)]
        return True in told

    before = capacities.tracker.capacity_ah()
    assert not rest(np.full(3, high)), "one rest tells nothing"
    for _ in range(6):
        rest(np.full(3, high))
        for _ in range(1200):
            capacities.step(1.0, drawn_ah * 3600 / 1200, np.full(3, 3.6))
        assert rest(high - drawn_ah / true_ah)
        for _ in range(1200):
            capacities.step(1.0, -drawn_ah * 3600 / 1200, np.full(3, 3.6))
    after = capacities.tracker.capacity_ah()
    assert abs(after[1] - 22.0) < 0.5
    assert abs(after[1] - 22.0) < abs(before[1] - 22.0)


def test_the_past_is_kept_over_a_restart_and_believed_where_the_voltage_agrees(tmp_path, master):
    first = Pipeline(MasterSource("serial"), lambda: make_estimator("fused", CELL, 96), filter_name="f", cell_name="c")
    master.set("i_fs", [0])
    estimate = first.feed(master.frame()).estimates
    remembered = estimate.soc + 0.02
    remembered[5] += 0.4
    path = tmp_path / "cells.npz"
    charge = RememberedCharge(10, remembered, np.full(96, 0.001))
    save_learned_state(path, LearnedState(charge, Predictor(CELL, (12,) * 8).learned_cells))
    second = Pipeline(
        MasterSource("serial"),
        lambda: make_estimator("fused", CELL, 96),
        filter_name="f",
        cell_name="c",
        remembered=load_learned_state(path, 96).charge,
    )
    soc = second.feed(master.frame()).estimates.soc
    closer = np.abs(soc - remembered) < np.abs(estimate.soc - remembered)
    assert closer[np.arange(96) != 5].all()
    assert abs(soc[5] - estimate.soc[5]) < 0.05, "a cell whose voltage contradicts is started from its voltage"


@pytest.mark.parametrize("content", [b"", b"not a zip", b"PK\x03\x04garbage"])
def test_a_damaged_past_is_ignored(tmp_path, content):
    path = tmp_path / "cells.npz"
    path.write_bytes(content)
    assert load_learned_state(path, 96) is None
    assert load_learned_state(tmp_path / "missing", 96) is None


def test_the_offset_of_the_current_sensor_is_found_with_open_relays_and_not_counted(pipeline, master):
    master.set("status.flags", [0b1])  # fit, relays open
    master.set("i_fs", [200])

    def wait(seconds):
        for _ in range(seconds // 5):
            snapshot = pipeline.feed(master.frame(ms=5000)).snapshot
            pipeline.predict()
        return snapshot

    before = wait(50).estimator
    assert before.current_offset_a is None, "not observable yet"
    assert before.current_offset_sigma_a == pytest.approx(0.01 * CELL.capacity_ah)
    after = wait(20)
    assert after.estimator.current_offset_a == pytest.approx(2.0, abs=3 * after.estimator.current_offset_sigma_a)
    assert after.accumulator.current_a == pytest.approx(2.0), "what the master says is shown as it says it"
    counted = pipeline._estimator.counted_soc
    wait(150)
    drawn = counted - pipeline._estimator.counted_soc
    assert np.abs(drawn).max() < 0.1 * 2.0 * 150 / 3600 / CELL.capacity_ah


def test_the_offset_is_not_taken_off_where_it_is_not_observable(pipeline, master):
    master.set("i_fs", [200])
    for _ in range(24):
        snapshot = pipeline.feed(master.frame(ms=5000)).snapshot
        pipeline.predict()
    assert snapshot.estimator.current_offset_a is None
    assert pipeline._predictor.offset_a == 0.0


@pytest.mark.parametrize(
    ("cell", "codes"),
    [
        (CELL, ("power-held", "to-trip-at-load", "energy-at-load")),
        (
            replace(CELL, fit_current_max_a=20.0, limits=CellLimits()),
            ("power-held-beyond", "to-trip-at-load-beyond", "energy-at-load-beyond"),
        ),
        (replace(CELL, fit_temperature_degc=np.array([-20.0])), ("beyond-temperatures",) * 3),
    ],
)
def test_what_was_never_measured_is_marked_with_the_reason(master, cell, codes):
    prediction = drive(pipeline_of(cell, master), master, 60).prediction
    conditions = prediction.power_condition, prediction.to_trip_condition, prediction.energy_condition
    assert tuple(each.code for each in conditions) == codes
    is_beyond = "beyond" in codes[0]
    assert {limit.beyond_measured for limit in prediction.power.discharge} == {is_beyond}
    assert any(trip.beyond_measured for trip in prediction.to_trip) == is_beyond
    assert prediction.energy_left_beyond_measured == is_beyond
