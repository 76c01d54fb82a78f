"""Hours of everything at once leave memory, descriptors, threads and latency as they were.

Thirty readers, some of whom come and go; imports, exports, reports and resets of the master, again and again.
`VOLTWALL_SOAK_S` sets its length in seconds; minutes in `make campaign`, two hours in its
long form, none in `make test` and the short one.
"""

import contextlib
import csv
import io
import json
import os
import threading
import time
from collections.abc import Callable
from pathlib import Path

import httpx
import numpy as np
import pytest
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

from app.live.history import CELLS_EVERY_NS, CELLS_LENGTH, PER_CELL
from tests.campaign import of_size, report_figure
from tests.service_process import N_CELLS

LENGTH_S = int(os.environ.get("VOLTWALL_SOAK_S") or of_size(0, 0, 240, 7200))
READERS = 30
COMING_AND_GOING = 5  # readers at a time, each staying STAY_S
STAY_S = 10.0
LOOK_S = 5.0
PAUSES_S = {  # at least ten times each
    name: min(pause_s, LENGTH_S / 12)
    for name, pause_s in {"import": 60.0, "export": 45.0, "report": 45.0, "reset": 120.0, "page": 5.0}.items()
}
MOST_GROWTH_MB = 5.0
WARM_S = 1800.0  # before, memory grows by what is used for the first time
LOWEST_PRIORITY_S = 300.0  # for an answer of the worker processes, where others want the machine as well
CELLS_HISTORY_MB = CELLS_LENGTH * N_CELLS * 2 * len(PER_CELL) / 1e6  # taken as it fills
CELLS_HISTORY_S = CELLS_LENGTH * CELLS_EVERY_NS / 2e9
IMPORTED_S = 600  # length of the imported recording
MAPPING = {"profile": {"time": "t", "current": "I", "voltages": "Cell {n}"}}


def recording() -> bytes:
    """A log of 96 cells, one row a second."""
    rng, text = np.random.default_rng(1), io.StringIO()
    rows = csv.writer(text)
    rows.writerow(["t", "I", *(f"Cell {i + 1}" for i in range(96))])
    rows.writerows([k, 12, *np.round(rng.normal(3.7, 0.01, 96), 4)] for k in range(IMPORTED_S))
    return text.getvalue().encode()


class Soak:
    """A service, what asks it, and what is measured of it."""

    def __init__(self, service) -> None:
        self.service = service
        self.pid = service.process.pid
        self.is_over = threading.Event()
        self.done = dict.fromkeys(PAUSES_S, 0)
        self.wrong: list[str] = []
        self.late_s: list[tuple[float, float]] = []  # when, how late
        self.began_s = time.monotonic()

    def at_s(self) -> float:
        """Seconds since the start."""
        return time.monotonic() - self.began_s

    def read(self, stay_s: float) -> None:
        """Hold a live stream, and again."""
        url = self.service.base_url.replace("http", "ws") + "/api/v1/live?rate=10"
        while not self.is_over.is_set():
            until = time.monotonic() + stay_s
            try:
                with connect(url, max_size=1 << 22, open_timeout=60) as live:
                    while time.monotonic() < until and not self.is_over.is_set():
                        text = live.recv(timeout=60)
                        if stay_s == float("inf"):
                            self.late_s.append((self.at_s(), time.time() - json.loads(text)["time"]))
            except (WebSocketException, OSError) as error:
                self.wrong.append(f"{self.at_s():.0f} s: a reader: {error!r}")

    def again(self, name: str, act: Callable[[httpx.Client], None]) -> None:
        """Do something for ever, each time after a pause."""
        with self.service.client() as client:
            while not self.is_over.wait(PAUSES_S[name]):
                try:
                    act(client)
                    self.done[name] += 1
                except (httpx.HTTPError, KeyError, IndexError) as error:
                    self.wrong.append(f"{self.at_s():.0f} s: {name}: {error!r}")

    def bring_in(self, client: httpx.Client) -> None:
        """Import a recording, wait for its end and delete the session."""
        made = client.post("/imports", params={"filename": "run.csv"}, content=recording()).raise_for_status().json()
        client.post(f"/imports/{made['id']}", json=MAPPING).raise_for_status()
        while (state := client.get("/imports").json()["last"])["is_running"] and not self.is_over.wait(0.5):
            pass
        if state["session_id"] is not None:
            client.delete(f"/sessions/{state['session_id']}").raise_for_status()

    def newest(self, client: httpx.Client) -> str:
        """The session that is recorded."""
        return str(client.get("/recorder").raise_for_status().json()["session_id"])

    def export(self, client: httpx.Client) -> None:
        """Half a minute of the newest session as a file."""
        part = {"format": "csv", "signal": "v[0]", "t_from": 0, "t_to": 30}
        path = f"/sessions/{self.newest(client)}/export"
        client.get(path, params=part, timeout=LOWEST_PRIORITY_S).raise_for_status()

    def report(self, client: httpx.Client) -> None:
        """A report of a session so far; a long one takes longer than a proxy waits, and is refused then."""
        answer = client.get(f"/sessions/{self.newest(client)}/report", timeout=LOWEST_PRIORITY_S)
        assert answer.status_code in (200, 413, 503), answer.text

    def reset(self, client: httpx.Client) -> None:
        """The master starts anew."""
        client.post("/simulator/faults", json={"fault": "master-watchdog-reset"}).raise_for_status()

    def page(self, client: httpx.Client) -> None:
        """What an open page asks for."""
        for path in ("/health", "/system", "/events", "/history?seconds=60", "/signed-log"):
            client.get(path).raise_for_status()

    def look(self) -> tuple[float, float, int, int]:
        """Return seconds, resident MB, descriptors, threads."""
        process = Path(f"/proc/{self.pid}")
        resident = int((process / "statm").read_text().split()[1]) * 4096 / 1e6
        return self.at_s(), resident, len([*(process / "fd").iterdir()]), len([*(process / "task").iterdir()])


@pytest.mark.skipif(not LENGTH_S, reason="make campaign soaks")
@pytest.mark.timeout(LENGTH_S + 600)
def test_hours_of_everything_leave_the_service_as_it_was(make_module_service):
    soak = Soak(make_module_service("--seed", "4"))
    stays = [STAY_S] * COMING_AND_GOING + [float("inf")] * (READERS - COMING_AND_GOING)
    jobs = {"import": soak.bring_in, "export": soak.export, "report": soak.report, "reset": soak.reset}
    threads = [threading.Thread(target=soak.read, args=(stay_s,)) for stay_s in stays]
    threads += [threading.Thread(target=soak.again, args=job) for job in (jobs | {"page": soak.page}).items()]
    looks = []
    try:
        for thread in threads:
            thread.start()
        while soak.at_s() < LENGTH_S:
            time.sleep(LOOK_S)
            looks.append(soak.look())
    finally:
        soak.is_over.set()
        for thread in threads:
            thread.join(120)
    with contextlib.suppress(OSError), Path(os.environ.get("VOLTWALL_SOAK_LOOKS") or os.devnull).open("w") as file:
        csv.writer(file).writerows(looks)
    _judge(soak, np.array(looks))


def history_mb(seconds: float) -> float:
    """What the history of all cells takes after so long: it fills in a quarter of an hour, then stays."""
    return CELLS_HISTORY_MB * min(1.0, seconds / CELLS_HISTORY_S)


def _judge(soak: Soak, looks: np.ndarray) -> None:
    """Compare the last quarter with the second: the first one warms up."""
    seconds, quarters = looks[:, 0], LENGTH_S / 4
    second, last = ((seconds >= k * quarters) & (seconds < (k + 1) * quarters) for k in (1, 3))
    memory, descriptors, threads = (
        [float(np.median(looks[part, column])) for part in (second, last)] for column in (1, 2, 3)
    )
    filling = history_mb(3.5 * quarters) - history_mb(1.5 * quarters)
    when_s, late_s = np.array(soak.late_s).T
    p50_s = [float(np.median(late_s[(when_s >= k * quarters) & (when_s < (k + 1) * quarters)])) for k in (1, 3)]
    p99_s = [float(np.quantile(late_s[(when_s >= k * quarters) & (when_s < (k + 1) * quarters)], 0.99)) for k in (1, 3)]
    report_figure(
        f"soak of {LENGTH_S / 3600:.2f} h with {READERS} readers, {soak.done}: memory {memory[0]:.1f} to "
        f"{memory[1]:.1f} MB, of which {filling:.1f} are the history that fills, "
        f"descriptors {descriptors[0]:.0f} to {descriptors[1]:.0f}, threads {threads[0]:.0f} to {threads[1]:.0f}, "
        f"latency {1e3 * p50_s[0]:.0f} to {1e3 * p50_s[1]:.0f} ms "
        f"(99 %: {1e3 * p99_s[0]:.0f} to {1e3 * p99_s[1]:.0f} ms)"
    )
    assert soak.wrong == []
    assert all(soak.done.values()), soak.done
    assert memory[1] - memory[0] - filling < MOST_GROWTH_MB or LENGTH_S / 4 < WARM_S
    assert abs(descriptors[1] - descriptors[0]) <= 3  # connections that come and go
    assert abs(threads[1] - threads[0]) <= 2
    assert p50_s[1] < 2 * p50_s[0]
