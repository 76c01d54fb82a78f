"""The weakest cell under load stays known when the car stands: in the snapshot, over MQTT, until the next drive."""

import json

import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.estimators import make_estimator
from app.live.accumulator import DRIVE_ENDS_NS
from app.live.pipeline import Pipeline
from app.service.mqtt.publisher import messages
from app.sources.items import LinkChange
from app.sources.master.source import MasterSource
from app.telemetry.encoding import plain

CELL = load_cell("samsung-25r-10p")
TRIPPED, HEALTHY = 63, 30
PAUSE_MS = DRIVE_ENDS_NS // 1_000_000


@pytest.fixture
def pipeline():
    chain = Pipeline(
        MasterSource("serial", "/dev/x", "off"),
        lambda: make_estimator("fused", CELL, 96),
        filter_name="fused",
        cell_name="samsung-25r-10p",
    )
    chain.feed(LinkChange(0, 0, "rs232", "open"))
    return chain


@pytest.fixture
def at(pipeline, master):
    """Measure an instant: a current [A], and one cell below the others."""

    def measure(current_a, low_cell, low_v, after_ms=100):
        master.set("i_fs", [round(100 * current_a)])
        master.set("v", [round(1e4 * low_v) if cell == low_cell else 40_000 for cell in range(96)])
        return pipeline.feed(master.frame(after_ms)).snapshot

    return measure


def test_a_tripped_car_at_rest_still_names_the_cell_that_was_lowest_under_load(at):
    at(120.0, TRIPPED, 2.9)
    worst = at(147.0, TRIPPED, 2.4812)
    at(60.0, TRIPPED, 3.1)
    later = at(0.0, HEALTHY, 3.969)
    assert later.accumulator.voltage_min_cell == HEALTHY
    lowest = later.accumulator.lowest_under_load
    assert (lowest.cell, lowest.voltage_v, lowest.current_a) == (TRIPPED, pytest.approx(2.4812), pytest.approx(147.0))
    assert lowest.t_wall_ns == worst.t_wall_ns
    shown = {"voltage_v": 2.4812, "cell": TRIPPED, "current_a": 147.0, "time": worst.t_wall_ns / 1e9}
    assert plain(later)["accumulator"]["lowest_under_load"] == pytest.approx(shown)
    sent = json.loads(dict(messages(later, None))["accumulator"])
    assert sent["lowest_under_load"] == pytest.approx(shown)


def test_before_any_drive_it_is_missing_and_charging_or_the_cars_own_supply_is_none(at):
    for current_a in (0.0, 2.0, -20.0):
        assert at(current_a, TRIPPED, 2.4).accumulator.lowest_under_load is None


def test_a_missing_voltage_is_not_the_lowest(at):
    assert at(100.0, TRIPPED, 0.0).accumulator.lowest_under_load.cell != TRIPPED


@pytest.mark.parametrize(("pause_ms", "cell"), [(PAUSE_MS - 1000, TRIPPED), (PAUSE_MS + 1000, HEALTHY)])
def test_a_change_of_drivers_ends_no_drive_a_long_pause_does_when_the_next_begins(at, pause_ms, cell):
    at(147.0, TRIPPED, 2.5)
    at(0.0, HEALTHY, 3.9, after_ms=pause_ms - 100)
    assert at(0.0, HEALTHY, 3.9).accumulator.lowest_under_load.cell == TRIPPED  # however long the car stands
    assert at(100.0, HEALTHY, 3.8, after_ms=1).accumulator.lowest_under_load.cell == cell
