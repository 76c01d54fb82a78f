"""Faults in running services: `voltwall serve` with its simulated car, each in processes of their own, in real time."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.root_cause_runs import JOINT, LARGE_MOHM, Case, Drawn, draw
from benchmarks.root_cause_shown import Run, asked, keep_run, kept_run
from firmware_protocol.memory_map import N_CELLS, N_PACKS
from tests.recorded.service_car import CELL
from tests.service_process import Service

N_SERVICES: Final = 10
RACE: Final = "clean-endurance"
KINDS: Final = (  # faults that open the shutdown circuit while the car races
    *(JOINT, "sense-wire-open", "cell-voltage-stuck", "temperature-sensor-fault", "temperature-sensor-open"),
    *("slave-lost", "slave-adc-fault", "slave-multiplexer-fault", "isospi-noise", "current-sensor-open"),
)
BEFORE_S: Final = (40.0, 70.0)  # driving time before the fault
TRIPS_S: Final = 90.0  # after it, and explained
AFTER_S: Final = 5.0  # what is shown then is asked for
_one_at_a_time = threading.Lock()  # the command line prints where all print


def served(first: int, n: int) -> list[Drawn]:
    """Return the faults; what of them the service has is cell, size and when."""
    chosen = []
    for k in range(n):
        rng = np.random.default_rng((first, 1004, k))
        case, scenario = draw("services", KINDS[k % len(KINDS)], first + k, rng)
        at_s, value = float(rng.uniform(*BEFORE_S)), case.value
        if case.fault == JOINT:
            value = float(rng.uniform(*LARGE_MOHM))
        chosen.append((Case("services", case.fault, case.seed, at_s, case.cell, case.pack, value), scenario))
    return chosen


def play_services(drawn: Sequence[Drawn], folder: Path, n_at_a_time: int) -> list[Run]:
    """Run each in a service of its own, so many side by side."""
    with ThreadPoolExecutor(n_at_a_time) as threads:
        return list(threads.map(lambda case: _play(case[0], folder / case[0].name), drawn))


def _play(case: Case, data: Path) -> Run:
    if (kept := kept_run(data)) is not None:
        return kept
    service = Service(data, ["--seed", str(case.seed), "--scenario", RACE, "--cell", CELL]).start()
    try:
        with service.client() as client:

            def get(path: str) -> Any:
                return client.get(path).raise_for_status().json()

            uptime_s = service.wait_for(lambda shown: shown["uptime_s"])["uptime_s"]
            service.wait_for(lambda shown: (shown["uptime_s"] or 0.0) > uptime_s + case.at_s, 2 * case.at_s)
            client.post("/simulator/faults", json=_body(case)).raise_for_status()
            banners = _banners(service)
            session_id = get("/recorder")["session_id"]
            client.post(f"/sessions/{session_id}/stop").raise_for_status()
            with _one_at_a_time:
                run = asked(case, data, session_id, banners, get)
    finally:
        service.stop()
    keep_run(data, run)
    return run


def _banners(service: Service) -> list[dict[str, Any]]:
    """Return the first snapshot with a cause of the trip; none where none came in time."""
    try:
        return [service.wait_for(lambda shown: any(alarm["cause"] for alarm in shown["alarms"]), TRIPS_S)]
    except AssertionError:
        return []


def _body(case: Case) -> dict[str, Any]:
    """The fault as it is injected over REST; packs and cells count from 1 there."""
    body: dict[str, Any] = {"fault": case.fault} | ({} if case.value is None else {"value": case.value})
    if case.cell is not None:
        pack, cell = divmod(case.cell, N_CELLS // N_PACKS)
        return body | {"pack": pack + 1, "cell": cell + 1}
    return body if case.pack is None else body | {"pack": case.pack + 1}
