"""Prometheus: the newest snapshot and the counters, read at the moment of the scrape."""

from collections.abc import Iterator

from fastapi import APIRouter, Response
from fastapi.responses import PlainTextResponse
from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric

from app.api.deps import RuntimeDep
from app.runtime import Runtime
from app.telemetry import Snapshot

router = APIRouter(tags=["metrics"])
_TOTALS = {
    "voltage_v": "voltwall_accumulator_volts",
    "current_a": "voltwall_accumulator_amperes",
    "power_w": "voltwall_accumulator_watts",
    "soc": "voltwall_accumulator_soc_ratio",
    "voltage_min_v": "voltwall_cell_voltage_min_volts",
    "voltage_max_v": "voltwall_cell_voltage_max_volts",
    "temperature_max_degc": "voltwall_cell_temperature_max_celsius",
    "temperature_min_degc": "voltwall_cell_temperature_min_celsius",
    "loaded_cells": "voltwall_cells_loaded",
}
_COUNTERS = ("frames", "lost", "crc_errors", "resyncs", "bytes", "reconnects")


class SnapshotCollector:
    """A value that is missing is left out, never 0."""

    def __init__(self, runtime: Runtime) -> None:
        self._runtime = runtime

    def collect(self) -> Iterator[Metric]:
        """Yield every family."""
        snapshot = self._runtime.pipeline_snapshot  # of the car, also while a replay is shown
        if snapshot is not None:
            yield from _totals(snapshot)
            yield from _links(snapshot)
            yield from _cells(snapshot)
        recording = int(self._runtime.recorder.session is not None)
        yield GaugeMetricFamily("voltwall_recording", "1 while a session is recorded", recording)
        yield GaugeMetricFamily("voltwall_live_readers", "websocket readers", self._runtime.hub.readers)


def _totals(snapshot: Snapshot) -> Iterator[Metric]:
    for name, metric in _TOTALS.items():
        value = snapshot.accumulator[name]
        if value is not None:
            yield GaugeMetricFamily(metric, name.replace("_", " "), value)
    yield GaugeMetricFamily("voltwall_alarms_active", "alarms that hold", sum(a.active for a in snapshot.alarms))
    if snapshot.master["fit"] is not None:
        yield GaugeMetricFamily("voltwall_master_fit", "1 while the master allows driving", int(snapshot.master["fit"]))


def _links(snapshot: Snapshot) -> Iterator[Metric]:
    for counter in _COUNTERS:
        family = CounterMetricFamily(f"voltwall_link_{counter}", f"{counter} since start", labels=["link"])
        for name, status in snapshot.links.items():
            family.add_metric([name], getattr(status, counter))
        yield family
    live = GaugeMetricFamily("voltwall_link_live", "1 while the link delivers", labels=["link"])
    for name, status in snapshot.links.items():
        live.add_metric([name], int(status.state == "live"))
    yield live


def _cells(snapshot: Snapshot) -> Iterator[Metric]:
    for attribute, metric in (("voltage_v", "voltwall_cell_volts"), ("soc", "voltwall_cell_soc_ratio")):
        family = GaugeMetricFamily(metric, f"{attribute} of each cell", labels=["pack", "cell"])
        for index, value in enumerate(getattr(snapshot.cells, attribute).tolist()):
            if value == value:
                family.add_metric([str(index // 12 + 1), str(index % 12 + 1)], value)
        yield family


@router.get("/metrics", response_class=PlainTextResponse)
def metrics(runtime: RuntimeDep) -> Response:
    """Prometheus text."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(SnapshotCollector(runtime))
    return Response(generate_latest(registry), media_type=CONTENT_TYPE_LATEST)
