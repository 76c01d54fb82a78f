"""A sum over missing cells is no sum: of a slave that was lost, and of one wire that broke."""

from dataclasses import replace

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.live.accumulator import total_voltage
from app.live.alarm_rules import conditions
from app.telemetry.measurement import Reported

CELL = load_cell("samsung-25r-10p")
V = 37_000  # counts of every cell


@pytest.fixture
def pipeline(make_pipeline):
    return make_pipeline()


def lose(master, cells):
    """The firmware sums and averages the cells that it has."""
    counts = [0xFFFF if cell in cells else V for cell in range(96)]
    master.set("v", counts)
    master.set("v_tot", [round(V * (96 - len(cells)) / 100)])


@pytest.mark.parametrize("cells", [range(36, 48), [40]], ids=["slave lost", "wire broken"])
def test_what_is_over_all_cells_is_missing_where_one_is(pipeline, master, cells):
    lose(master, ())
    pipeline.feed(master.frame())
    lose(master, cells)
    total = pipeline.feed(master.frame()).snapshot.accumulator
    assert (total.voltage_v, total.power_w, total.voltage_mean_v, total.voltage_delta_v) == (None,) * 4
    assert total.loaded_cells == 96 - len(cells)
    assert total.voltage_at_least_v == pytest.approx(3.7 * (96 - len(cells)))
    assert (total.voltage_min_v, total.voltage_max_v) == (pytest.approx(3.7), pytest.approx(3.7))


def test_with_all_cells_the_sum_is_the_sum(pipeline, master):
    lose(master, ())
    total = pipeline.feed(master.frame()).snapshot.accumulator
    assert total.voltage_v == pytest.approx(355.2)
    assert (total.voltage_at_least_v, total.energy_gap_s) == (None, None)


def test_a_total_that_another_source_measured_stays(pipeline, master):
    lose(master, range(36, 48))
    master.set("v_tot", [35_400])
    total = pipeline.feed(master.frame()).snapshot.accumulator
    assert (total.voltage_v, total.power_w) == (pytest.approx(354.0), pytest.approx(3540.0))
    assert total.voltage_at_least_v is None


@pytest.mark.parametrize(("total_v", "is_whole"), [(355.3, True), (351.5, False), (310.8, False)])
def test_a_total_that_came_without_cells_holds_as_many_as_there_are_or_is_none(total_v, is_whole):
    missing = np.full(96, np.nan)
    reported = Reported(total_v, (3.7, 4), (3.71, 5), (25.0, 0), (26.0, 1), None)
    assert total_voltage(missing, reported) == (total_v if is_whole else None)
    assert total_voltage(missing, replace(reported, voltage_min_v=(None, None))) == total_v  # a sensor of its own


def test_energy_without_all_cells_is_marked_as_too_low(pipeline, master):
    lose(master, range(36, 48))
    pipeline.feed(master.frame())
    before = pipeline.feed(master.frame()).snapshot.accumulator
    master.uptime_ms += 3_600
    after = pipeline.feed(master.frame(0)).snapshot.accumulator
    assert after.energy_gap_s - before.energy_gap_s == pytest.approx(3.6)
    assert after.energy_out_wh - before.energy_out_wh == pytest.approx(84 * 3.7 * 10.0 * 3.6 / 3600)


def test_the_soc_of_a_lost_slave_is_counted_on(pipeline, master):
    lose(master, ())
    pipeline.feed(master.frame())
    lose(master, range(36, 48))
    total = pipeline.feed(master.frame()).snapshot.accumulator
    assert (total.soc_source, total.soc) == ("filter", pytest.approx(0.484, abs=0.01))


def test_cells_that_were_never_measured_have_no_soc_and_their_pack_the_masters(pipeline, master):
    lose(master, range(36, 48))
    snapshot = pipeline.feed(master.frame()).snapshot
    total = snapshot.accumulator
    assert np.isnan(snapshot.cells.soc[36:48]).all()
    assert np.isnan(snapshot.cells.soc_sigma[36:48]).all()
    assert np.isfinite(snapshot.cells.soc).sum() == 84
    assert (total.soc, total.soc_source, total.driver_soc_percent) == (0.8, "master", 80)
    assert (total.soc_sigma, total.soc_spread) == (None, None)
    assert total.soc_min is not None


def drive(pipeline, master, frames=25):
    for _ in range(frames):
        snapshot = pipeline.feed(master.frame()).snapshot
        pipeline.predict()
    return snapshot


def test_without_the_soc_of_all_cells_neither_power_nor_energy_is_predicted(pipeline, master):
    lose(master, range(36, 48))
    prediction = drive(pipeline, master).prediction
    assert (prediction.power, prediction.energy_left_wh, prediction.laps) == (None, None, None)
    conditions = prediction.power_condition, prediction.energy_condition, prediction.laps_condition
    assert {(each.code, each.args["n"]) for each in conditions} == {("soc-of-cells-unknown", 12)}


def test_what_is_left_holds_the_cells_of_a_lost_slave(pipeline, master):
    lose(master, ())
    whole = drive(pipeline, master).prediction
    lose(master, range(36, 48))
    prediction = drive(pipeline, master).prediction
    assert prediction.energy_left_wh == pytest.approx(whole.energy_left_wh, rel=0.02)
    assert prediction.power.discharge[0].power_w == pytest.approx(whole.power.discharge[0].power_w, rel=0.05)


def test_the_sum_of_the_measured_cells_trips_where_it_alone_is_too_high(pipeline, master):
    pipeline.feed(master.config())
    lose(master, [40])
    snapshot = pipeline.feed(master.frame()).snapshot
    for limit, found in ((300.0, ["accumulator-voltage-high"]), (360.0, [])):
        limits = replace(snapshot.limits, accumulator_voltage_max_v=limit)
        codes = [each.message.code for each in conditions(replace(snapshot, limits=limits))]
        assert [code for code in codes if code == "accumulator-voltage-high"] == found
