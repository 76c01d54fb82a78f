from types import SimpleNamespace

import pytest
from prometheus_client import CollectorRegistry
from prometheus_client.openmetrics.exposition import generate_latest
from prometheus_client.openmetrics.parser import text_string_to_metric_families

from app import __version__
from app.api.live.metrics import _CELLS, _ENERGY, _TOTALS, SnapshotCollector
from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.estimators import make_estimator
from app.live.pipeline import Pipeline
from app.sources.master.source import MasterSource
from app.telemetry import Accumulator, Cells
from app.telemetry.fields import units
from tests.fake_clock import FunctionClock


def test_every_metric_is_of_a_field_of_the_snapshot():
    assert {*_TOTALS, *_ENERGY} <= {name for name, _ in units(Accumulator)}
    assert _CELLS.keys() <= {name for name, _ in units(Cells)}


def collector_of(snapshot, now_ns):
    status = SimpleNamespace(
        session=None, queued_items=0, lost_items=0, error=None, disk_free_bytes=None, commit_delay_s=None
    )
    clock = FunctionClock(lambda: now_ns, lambda: now_ns)
    return SnapshotCollector(SimpleNamespace(snapshot=snapshot), SimpleNamespace(status=status), clock, 0)


def snapshot_of(master):
    cell = load_cell("samsung-25r-10p")
    pipeline = Pipeline(
        MasterSource("serial"), lambda: make_estimator("coulomb", cell, 96), filter_name="coulomb", cell_name="c"
    )
    return pipeline.feed(master.frame()).snapshot


def test_all_of_it_is_open_metrics_and_tells_the_version(master):
    snapshot = snapshot_of(master)
    registry = CollectorRegistry(auto_describe=False)
    registry.register(collector_of(snapshot, snapshot.t_mono_ns))
    families = {family.name: family for family in text_string_to_metric_families(generate_latest(registry).decode())}
    assert families["voltwall_build_info"].samples[0].labels["version"] == __version__
    assert len(families["voltwall_cell_volts"].samples) == 96


@pytest.mark.parametrize(("waited_s", "stale", "shown"), [(0.2, 0, True), (3.0, 1, True), (20.0, 1, False)])
def test_old_values_are_marked_and_then_left_out(master, waited_s, stale, shown):
    snapshot = snapshot_of(master)
    collector = collector_of(snapshot, snapshot.t_mono_ns + round(waited_s * 1e9))
    found = {family.name: family for family in collector.collect()}
    of_voltage = {
        name: next(each.value for each in found[name].samples if each.labels["part"] == "voltage")
        for name in ("voltwall_age_seconds", "voltwall_stale")
    }
    assert of_voltage["voltwall_age_seconds"] == pytest.approx(waited_s, abs=0.05)
    assert of_voltage["voltwall_stale"] == stale
    assert ("voltwall_accumulator_volts" in found) is shown
    assert bool(found["voltwall_cell_volts"].samples if "voltwall_cell_volts" in found else ()) is shown


def test_a_sum_over_missing_cells_is_no_total(master):
    master.set("v", [0xFFFF if i in range(36, 48) else 37000 for i in range(96)])
    master.set("v_tot", [31080])
    snapshot = snapshot_of(master)
    found = {family.name: family for family in collector_of(snapshot, snapshot.t_mono_ns).collect()}
    assert found.keys().isdisjoint({"voltwall_accumulator_volts", "voltwall_accumulator_watts"})
    assert found["voltwall_accumulator_at_least_volts"].samples[0].value == pytest.approx(310.8)
    assert found["voltwall_cells_loaded"].samples[0].value == 84
