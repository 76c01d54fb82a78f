"""Prometheus: the newest snapshot and the counters, read at the moment of the scrape."""

import platform
from collections.abc import Iterator

from fastapi import APIRouter, Response
from fastapi.responses import PlainTextResponse
from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, ProcessCollector, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric

from app import __version__
from app.api.web.dependencies import ClockPart, FanOutPart, LivePart, RecorderPart
from app.clock import Clock
from app.service.pipeline_thread import PipelineThread
from app.sessions.recording.auto_recorder import AutoRecorder
from app.telemetry import Accumulator, Ages, Cells, Snapshot
from app.telemetry.encoding import aged, is_stale
from app.telemetry.fields import Part, history_fields, units
from app.telemetry.measurement import BLANK_S

router = APIRouter(tags=["metrics"])
_TOTALS = {
    "voltage_v": "voltwall_accumulator_volts",
    "voltage_at_least_v": "voltwall_accumulator_at_least_volts",
    "current_a": "voltwall_accumulator_amperes",
    "power_w": "voltwall_accumulator_watts",
    "soc": "voltwall_accumulator_soc_ratio",
    "soc_sigma": "voltwall_accumulator_soc_sigma_ratio",
    "soc_min": "voltwall_cell_soc_min_ratio",
    "voltage_min_v": "voltwall_cell_voltage_min_volts",
    "voltage_max_v": "voltwall_cell_voltage_max_volts",
    "temperature_max_degc": "voltwall_cell_temperature_max_celsius",
    "temperature_min_degc": "voltwall_cell_temperature_min_celsius",
    "loaded_cells": "voltwall_cells_loaded",
    "energy_gap_s": "voltwall_energy_gap_seconds",
    "fan_duty": "voltwall_fan_duty_ratio",
}
_ENERGY = {"energy_out_wh": "voltwall_energy_out_joules", "energy_in_wh": "voltwall_energy_in_joules"}
_COUNTERS = ("frames", "lost", "crc_errors", "resyncs", "bytes", "reconnects")
_CELLS = {
    "voltage_v": "voltwall_cell_volts",
    "temperature_degc": "voltwall_cell_celsius",
    "soc": "voltwall_cell_soc_ratio",
    "soc_sigma": "voltwall_cell_soc_sigma_ratio",
    "resistance_ohm": "voltwall_cell_resistance_ohms",
}
_PARTS = {name: part for owner in (Accumulator, Cells) for name, _, part in history_fields(owner)}
_SEVERITIES = ("watch", "warning", "trip")
_JOULES_PER_WH = 3600.0


class SnapshotCollector:
    """A value that is missing is left out, never 0."""

    def __init__(self, live: PipelineThread, recorder: AutoRecorder, clock: Clock, n_readers: int) -> None:
        self._live = live
        self._recorder = recorder
        self._clock = clock
        self._n_readers = n_readers

    def collect(self) -> Iterator[Metric]:
        """Yield every family."""
        built = GaugeMetricFamily("voltwall_build_info", "1; what runs is in its labels", labels=["version", "python"])
        built.add_metric([__version__, platform.python_version()], 1)
        yield built
        snapshot = self._live.snapshot  # the car's snapshot, also during a replay
        if snapshot is not None:
            snapshot = aged(snapshot, self._clock.monotonic_ns())  # a service that stands has old values
            yield from _ages(snapshot)
            yield from _totals(snapshot)
            yield from _links(snapshot)
            yield from _cells(snapshot)
        yield from _recorder(self._recorder)
        yield GaugeMetricFamily("voltwall_live_readers", "websocket readers", self._n_readers)


def _ages(snapshot: Snapshot) -> Iterator[Metric]:
    age = GaugeMetricFamily("voltwall_age_seconds", "since the master measured a part", labels=["part"])
    stale = GaugeMetricFamily("voltwall_stale", "1 while a part is too old to be live", labels=["part"])
    for name, _ in units(Ages):
        age_s = getattr(snapshot.age_s, name)
        if age_s is not None:
            age.add_metric([name], age_s)
        stale.add_metric([name], int(is_stale(snapshot, name)))
    yield age
    yield stale
    simulated = int(snapshot.source == "simulator")
    yield GaugeMetricFamily("voltwall_simulated", "1 while the car is a simulated one", simulated)


def _is_known(snapshot: Snapshot, part: Part | None) -> bool:
    """A value that is too old to be shown is left out."""
    age_s = None if part is None else getattr(snapshot.age_s, part)
    return part is None or (age_s is not None and age_s < BLANK_S)


def _totals(snapshot: Snapshot) -> Iterator[Metric]:
    for name, unit in units(Accumulator):
        value = getattr(snapshot.accumulator, name)
        if name in _TOTALS and value is not None and _is_known(snapshot, _PARTS.get(name)):
            yield GaugeMetricFamily(_TOTALS[name], unit.meaning, value)
    for name, metric in _ENERGY.items():
        way = "out" if name == "energy_out_wh" else "in"
        yield CounterMetricFamily(
            metric, f"energy that flowed {way}", getattr(snapshot.accumulator, name) * _JOULES_PER_WH
        )
    active: list[str] = [alarm.severity for alarm in snapshot.alarms if alarm.active]
    yield GaugeMetricFamily("voltwall_alarms_active", "alarms that hold", len(active))
    by_severity = GaugeMetricFamily("voltwall_alarms", "alarms that hold, by severity", labels=["severity"])
    for severity in _SEVERITIES:
        by_severity.add_metric([severity], active.count(severity))
    yield by_severity
    if snapshot.master.fit is not None:
        yield GaugeMetricFamily("voltwall_master_fit", "1 while the master allows driving", int(snapshot.master.fit))


def _links(snapshot: Snapshot) -> Iterator[Metric]:
    for counter in _COUNTERS:
        family = CounterMetricFamily(f"voltwall_link_{counter}", f"{counter} since start", labels=["link"])
        for name, status in snapshot.links.items():
            family.add_metric([name], getattr(status, counter) or 0)
        yield family
    live = GaugeMetricFamily("voltwall_link_live", "1 while the link delivers", labels=["link"])
    age = GaugeMetricFamily("voltwall_link_age_seconds", "since the last good frame", labels=["link"])
    for name, status in snapshot.links.items():
        live.add_metric([name], int(status.state == "live"))
        if status.age_s is not None:
            age.add_metric([name], status.age_s)
    yield live
    yield age


def _cells(snapshot: Snapshot) -> Iterator[Metric]:
    places = [(str(pack), str(cell)) for pack, n in enumerate(snapshot.segments, 1) for cell in range(1, n + 1)]
    for name, unit in units(Cells):
        if name not in _CELLS or not _is_known(snapshot, _PARTS.get(name)):
            continue
        family = GaugeMetricFamily(_CELLS[name], unit.meaning, labels=["pack", "cell"])
        for index, value in enumerate(getattr(snapshot.cells, name).tolist()):
            if value == value:
                family.add_metric(places[index], value)
        yield family


def _recorder(recorder: AutoRecorder) -> Iterator[Metric]:
    status = recorder.status
    session = status.session
    yield GaugeMetricFamily("voltwall_recording", "1 while a session is recorded", int(session is not None))
    if session is not None:
        yield GaugeMetricFamily("voltwall_recording_bytes", "size of the session being recorded", session.size_bytes)
    yield GaugeMetricFamily("voltwall_recorder_queue_items", "received, not on the disk yet", status.queued_items)
    yield GaugeMetricFamily(
        "voltwall_recorder_lost_items", "of this session: what the disk did not take in time", status.lost_items
    )
    yield GaugeMetricFamily(
        "voltwall_recorder_stalled", "1 while the disk does not take the session", int(status.error is not None)
    )
    if status.commit_delay_s is not None:
        yield GaugeMetricFamily(
            "voltwall_recorder_commit_delay_seconds",
            "from a frame's arrival to its commit, the longest of the last minute",
            status.commit_delay_s,
        )
    if status.disk_free_bytes is not None:
        yield GaugeMetricFamily("voltwall_disk_free_bytes", "free where sessions are recorded", status.disk_free_bytes)


@router.get("/metrics", response_class=PlainTextResponse)
def metrics(live: LivePart, recorder: RecorderPart, clock: ClockPart, fan_out: FanOutPart) -> Response:
    """Prometheus text."""
    registry = CollectorRegistry(auto_describe=False)
    ProcessCollector(registry=registry)  # processor time, memory, open files; on Linux
    registry.register(SnapshotCollector(live, recorder, clock, len(fan_out.readers)))
    return Response(generate_latest(registry), media_type=CONTENT_TYPE_LATEST)
