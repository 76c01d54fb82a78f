from dataclasses import replace

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.estimators import make_estimator
from app.live.history import CELLS_LENGTH, LENGTH_S, History
from app.live.pipeline import Pipeline
from app.sources.master.source import MasterSource

CELL = load_cell("samsung-25r-10p")


@pytest.fixture
def snapshot(master):
    chain = Pipeline(
        MasterSource("serial"), lambda: make_estimator("coulomb", CELL, 96), filter_name="c", cell_name="c"
    )
    return chain.feed(master.frame()).snapshot


def later(snapshot, s: float, *, wall_s: float | None = None, **accumulator):
    wall_s = s if wall_s is None else wall_s
    return replace(
        snapshot,
        t_mono_ns=snapshot.t_mono_ns + round(s * 1e9),
        t_wall_ns=snapshot.t_wall_ns + round(wall_s * 1e9),
        accumulator=replace(snapshot.accumulator, **accumulator),
    )


def test_nothing_is_an_empty_series():
    body = History(96).read(900, None)
    assert len(body["time"]) == 0
    assert len(body["series"]["voltage_v"]) == 0
    assert len(History(96).read(900, 95)["series"]["soc"]) == 0


def test_what_only_aged_is_not_kept(snapshot):
    history = History(96)
    history.add(replace(snapshot, is_fresh=False))
    assert len(history.read(900, None)["time"]) == 0


def test_a_part_that_is_old_is_a_gap_while_another_goes_on(snapshot):
    history = History(96)
    old = replace(later(snapshot, 1, current_a=7.0), age_s=replace(snapshot.age_s, voltage=1.5, temperature=1.5))
    for each in (snapshot, old):
        history.add(each)
    totals, cell = history.read(900, None)["series"], history.read(900, 40)["series"]
    assert totals["current_a"][-1] == 7.0
    for name in ("voltage_v", "soc", "voltage_min_v", "temperature_max_degc"):
        assert not np.isnan(totals[name][0])
        assert np.isnan(totals[name][1]), name
    for name in ("voltage_v", "temperature_degc"):
        assert not np.isnan(cell[name][0])
        assert np.isnan(cell[name][1]), name


def test_only_the_last_seconds_are_returned(snapshot):
    history = History(96)
    for i in range(100):
        history.add(later(snapshot, i / 10, current_a=float(i)))
    body = history.read(2, None)
    assert body["series"]["current_a"].tolist() == [float(i) for i in range(79, 100)]
    assert body["time"][-1] - body["time"][0] == pytest.approx(2.0)


def test_a_missing_value_is_a_gap(snapshot):
    history = History(96)
    history.add(later(snapshot, 0, voltage_v=None))
    assert np.isnan(history.read(900, None)["series"]["voltage_v"][0])


def test_thinning_keeps_a_dip_of_one_sample(snapshot):
    history = History(96)
    for i in range(5000):
        history.add(later(snapshot, i / 28, voltage_min_v=2.5 if i == 3210 else 3.7))
    body = history.read(900, None)
    assert len(body["time"]) <= 2000
    assert (np.diff(body["time"]) >= 0).all()
    assert body["series"]["voltage_min_v"].min() == 2.5
    assert body["time"][0] == pytest.approx(body["time"][-1] - 4999 / 28, abs=0.1)


@pytest.mark.parametrize("jump_s", [-7200, 7200])
def test_a_wall_clock_that_is_set_neither_folds_nor_empties_the_axis(snapshot, jump_s):
    history = History(96)
    for i in range(20):
        history.add(later(snapshot, i / 10, wall_s=i / 10 + (jump_s if i >= 10 else 0)))
    time_s = history.read(900, None)["time"]
    assert len(time_s) == 20
    assert np.diff(time_s) == pytest.approx(0.1, abs=1e-3)
    assert time_s[-1] == pytest.approx((snapshot.t_wall_ns + (1.9 + jump_s) * 1e9) / 1e9)


def test_one_cell(snapshot):
    history = History(96)
    history.add(snapshot)
    assert history.read(900, 36)["series"]["voltage_v"][0] == pytest.approx(snapshot.cells.voltage_v[36], abs=1e-5)


def test_a_cells_values_come_back_as_fine_as_they_are_measured(snapshot):
    history = History(96)
    voltage_v = np.linspace(0.0, 6.2, 96).round(4)
    soc = np.linspace(-0.1, 1.1, 96)
    missing = np.full(96, np.nan)
    cells = replace(snapshot.cells, voltage_v=voltage_v, soc=soc, residual_v=missing)
    history.add(replace(later(snapshot, 0), cells=cells))
    for cell in (0, 40, 95):
        series = history.read(900, cell)["series"]
        assert series["voltage_v"][0] == pytest.approx(voltage_v[cell], abs=1e-9)
        assert series["soc"][0] == pytest.approx(soc[cell], abs=2.1e-5)
        assert np.isnan(series["residual_v"][0])


def test_a_value_beyond_its_range_is_held_at_the_end(snapshot):
    history = History(96)
    cells = replace(snapshot.cells, residual_v=np.full(96, 40.0), temperature_degc=np.full(96, -500.0))
    history.add(replace(later(snapshot, 0), cells=cells))
    series = history.read(900, 5)["series"]
    assert (series["residual_v"][0], series["temperature_degc"][0]) == (3.2767, -327.67)


def with_voltage(snapshot, cell: int, value: float):
    voltage_v = snapshot.cells.voltage_v.copy()
    voltage_v[cell] = value
    return replace(snapshot, cells=replace(snapshot.cells, voltage_v=voltage_v))


def test_a_cells_single_sample_dip_at_the_highest_rate_is_kept(snapshot):
    history = History(96)
    for i in range(28 * 60):
        history.add(with_voltage(later(snapshot, i / 28), 36, 2.5 if i == 777 else 3.7))
    body = history.read(900, 36)
    assert np.nanmin(body["series"]["voltage_v"]) == pytest.approx(2.5)
    assert body["time"][int(np.nanargmin(body["series"]["voltage_v"]))] == pytest.approx(
        snapshot.t_wall_ns / 1e9 + 777 / 28, abs=0.2
    )
    assert (np.diff(body["time"]) >= 0).all()


def test_cells_at_the_highest_rate_take_no_more_rows_than_a_quarter_of_an_hour_has_room_for(snapshot):
    history, seconds = History(96), 60
    for i in range(28 * seconds):
        history.add(later(snapshot, i / 28))
    rows = len(history.read(900, 0, points=100_000)["time"])
    assert rows * LENGTH_S / seconds <= CELLS_LENGTH


def test_a_sample_that_is_missing_among_others_is_not_taken_for_the_lowest(snapshot):
    history = History(96)
    for i in range(12):
        history.add(with_voltage(later(snapshot, i / 28), 36, np.nan if i % 2 else 3.7))
    values = history.read(900, 36)["series"]["voltage_v"]
    assert np.nanmin(values) == pytest.approx(3.7)
