"""Slow values of each cell."""

from dataclasses import replace

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.estimators import make_estimator
from app.live.pipeline import Pipeline
from app.live.trend import EVERY_S, LENGTH, Trend
from app.sources.master.source import MasterSource

CELL = load_cell("samsung-25r-10p")


@pytest.fixture
def snapshot(master):
    chain = Pipeline(
        MasterSource("serial"), lambda: make_estimator("coulomb", CELL, 96), filter_name="c", cell_name="c"
    )
    return chain.feed(master.frame()).snapshot


def at(snapshot, t_s: float, *, resistance_ohm: float = 0.002, bleeds: bool = False):
    cells = replace(
        snapshot.cells,
        resistance_ohm=np.full(96, resistance_ohm),
        joint_excess_ohm=np.full(96, np.nan),
        balancing=np.full(96, bleeds),
    )
    moved_ns = round(t_s * 1e9)
    return replace(
        snapshot, cells=cells, t_mono_ns=snapshot.t_mono_ns + moved_ns, t_wall_ns=snapshot.t_wall_ns + moved_ns
    )


def test_rows_are_means_and_what_was_never_known_stays_missing(snapshot):
    trend = Trend(96)
    for i in range(int(EVERY_S) + 1):
        trend.add(at(snapshot, i, resistance_ohm=0.001 if i % 2 else 0.003))
    body = trend.read(40)
    assert len(body["time"]) == 1
    assert body["series"]["resistance_ohm"][0] == pytest.approx(0.002, rel=0.1)
    assert np.isnan(body["series"]["joint_excess_ohm"]).all()


def test_balancing_time_is_counted_while_snapshots_come(snapshot):
    trend = Trend(96)
    for t_s, bleeds in ((0, False), (1, True), (2, True), (600, True), (601, True), (602, False)):
        trend.add(at(snapshot, t_s, bleeds=bleeds))
    assert trend.read(7)["balanced_s"] == pytest.approx(3)


def test_a_snapshot_that_only_aged_adds_nothing(snapshot):
    trend = Trend(96)
    trend.add(at(snapshot, 0))
    trend.add(replace(at(snapshot, 1, bleeds=True), is_fresh=False))
    assert trend.read(0)["balanced_s"] == 0


def test_no_more_rows_than_six_hours_and_in_order(snapshot):
    trend = Trend(96)
    for i in range(LENGTH + 3):
        trend.add(at(snapshot, i * EVERY_S))
    time_s = trend.read(0)["time"]
    assert len(time_s) == LENGTH
    assert (np.diff(time_s) > 0).all()
