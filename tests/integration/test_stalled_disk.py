"""A disk that takes nothing delays no value, alarm or command; what waited in memory is on the disk afterwards.

The disk hangs at every change, refuses every change as a full one, or another program holds the lock of the session:
on a running service, below SQLite (`faulty_disk.c`) and by a connection of SQLite. A second service on a sound disk
says meanwhile by how much the machine itself, which may do much else, delays values.
"""

import json
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import httpx
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from app.sessions.reading.reader import SessionFile
from tests.c_programs import build_faulty_disk
from tests.campaign import campaign, of_size, report_figure
from tests.forked import go_first
from tests.service_process import END_S, START_S, WAIT_S, until

PROJECT = Path(__file__).parents[2]
AGE_S = 0.5
ALARM_S = 1.0
ANSWER_S = 1.0
EVERY_S = 0.1  # a snapshot
BETWEEN_S = of_size(1, 3, 20, 20)  # two rounds of an alarm and commands
ALWAYS = ("commands/charge-stop", "commands/clear-faults", "commands/balance-stop", "identify")
SIGNED = {"charge-stop", "clear-faults", "balance-stop"}
IS = {"hangs": "hangs", "full": "is full", "locked": "another program locks"}
KINDS = {"hangs": of_size(8, 30, 600), "full": of_size(6, 20, 120), "locked": of_size(6, 20, 120)}


class Watch(threading.Thread):
    """Reads every snapshot: the oldest value, the longest pause, and when an alarm came."""

    def __init__(self, url):
        super().__init__(daemon=True)
        self.url = url.replace("http", "ws") + "/api/v1/live"
        self.oldest_s = self.pause_s = 0.0
        self.alarm = threading.Event()
        self.quiet = threading.Event()
        self.not_recording = None
        self.is_over = False
        self.start()

    def begin(self):
        self.oldest_s = self.pause_s = 0.0

    def run(self):
        last_s = time.monotonic()
        try:
            with connect(self.url, max_size=1 << 22) as socket:
                while not self.is_over:
                    snapshot, now_s = json.loads(socket.recv(timeout=WAIT_S)), time.monotonic()
                    ages = [snapshot["age"][part] for part in ("voltage", "current", "temperature", "status")]
                    self.oldest_s = max(self.oldest_s, *(WAIT_S if age is None else age for age in ages))
                    self.pause_s, last_s = max(self.pause_s, now_s - last_s), now_s
                    is_high = any(each["code"] == "cell-overvoltage" and each["active"] for each in snapshot["alarms"])
                    (self.alarm.set if is_high else self.alarm.clear)()
                    (self.quiet.clear if is_high else self.quiet.set)()
                    self.not_recording = snapshot.get("not_recording")
        except (ConnectionClosed, OSError):
            return


class Bench:
    """A service with its simulated car on a disk that can be made to stall."""

    def __init__(self, folder, kind):
        self.switch, self.data, self.kind = folder / "switch", folder / "data", kind
        environment = os.environ | {
            "LD_PRELOAD": str(build_faulty_disk()),
            "FAULT_FOLDER": str(self.data),
            "FAULT_SWITCH": str(self.switch),
            "VOLTWALL_SEASON": "0",
        }
        command = [sys.executable, "-m", "app.cli", "serve", "--port", "0", "--scenario", "in-the-pit"]
        with (folder / "log").open("w") as log:
            self.process = subprocess.Popen(
                [*command, "--data", str(self.data)], cwd=PROJECT, env=environment, text=True,
                stdout=subprocess.PIPE, stderr=log, preexec_fn=go_first,
            )  # fmt: skip
        line = self.process.stdout.readline()
        self.url = line.split()[-1]
        self.client = httpx.Client(base_url=self.url + "/api/v1", timeout=WAIT_S)
        until(lambda: self.recorder()["state"] == "recording", START_S)
        until(lambda: self.snapshot().get("master", {}).get("map_matches") and self.snapshot()["config_hash"], START_S)
        self.session = self.data / "sessions" / f"{self.recorder()['session_id']}.sqlite"

    def recorder(self):
        return self.client.get("/recorder").json()

    def snapshot(self):
        return self.client.get("/snapshot").json()

    def reasons(self):
        return [each["code"] for each in self.client.get("/health").json()["reasons"]]

    @contextmanager
    def stalled(self):
        if self.kind == "locked":
            other = sqlite3.connect(self.session, isolation_level=None)
            other.execute("BEGIN EXCLUSIVE")
            yield
            other.execute("ROLLBACK")
            other.close()
            return
        self.switch.write_text(self.kind[0])
        yield
        self.switch.unlink()

    def ask(self, method, path, **options):
        """(status, seconds)."""
        began_s = time.monotonic()
        answer = self.client.request(method, path, **options)
        return answer.status_code, time.monotonic() - began_s

    def close(self):
        self.switch.unlink(missing_ok=True)
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
            try:
                self.process.wait(END_S)
            except subprocess.TimeoutExpired:
                self.process.kill()
        self.process.stdout.close()
        self.client.close()


@pytest.fixture(params=KINDS)
def bench(request, tmp_path):
    (tmp_path / "stalled").mkdir()
    made = Bench(tmp_path / "stalled", request.param)
    yield made
    made.close()


@pytest.fixture
def sound(tmp_path):
    (tmp_path / "sound").mkdir()
    made = Bench(tmp_path / "sound", "sound")
    yield made
    made.close()


def round_of_alarm(bench, watch):
    """Seconds from a cell's voltage above its limit to the alarm on a page."""
    began_s = time.monotonic()
    bench.client.post("/simulator/faults", json={"fault": "cell-voltage-stuck", "pack": 2, "cell": 3, "value": 4.5})
    assert watch.alarm.wait(WAIT_S)
    took_s = time.monotonic() - began_s
    bench.client.delete("/simulator/faults")
    until(watch.quiet.is_set)  # only then the master clears its fault
    return took_s


@pytest.mark.skipif(sys.platform != "linux" or not shutil.which("gcc"), reason="needs Linux and gcc")
@campaign(180, 240, 900)
def test_a_stalled_disk_delays_no_value_alarm_or_command(bench, sound):
    watch, other = Watch(bench.url), Watch(sound.url)
    until(lambda: not bench.reasons())
    bench.client.post("/config/store").raise_for_status()  # something that could be loaded
    tag = bench.client.get("/config").headers["ETag"]
    change = {"json": {"raw": {"i_offset": 20540}, "reason": "a test"}, "headers": {"If-Match": tag}}
    asked = (("PUT", "/config", change), ("POST", "/config/store", {}), ("POST", "/config/load", {}))
    alarms_s, usual_alarms_s, answers, refusals, rounds = [], [], [], [], 0
    began_wall_s, shed = time.time(), set()
    with bench.stalled():
        watch.begin()
        other.begin()
        until_s = time.monotonic() + KINDS[bench.kind]
        while not rounds or time.monotonic() < until_s:
            alarms_s.append(round_of_alarm(bench, watch))
            usual_alarms_s.append(round_of_alarm(sound, other))
            answers += [bench.ask("POST", f"/{path}") for path in ALWAYS]
            answers += [bench.ask("GET", path) for path in ("/events", "/health", "/recorder", "/snapshot")]
            if bench.kind != "locked":
                refusals += [bench.ask(method, path, **options) for method, path, options in asked]
            shed |= {reason for reason in bench.reasons() if reason.startswith("shed")}
            rounds += 1
            time.sleep(BETWEEN_S)  # the stall lasts: nothing is waited for
        oldest_s, pause_s, shown = watch.oldest_s, watch.pause_s, watch.not_recording
        queued = bench.recorder()["queued_items"]
    watch.begin()
    until(lambda: bench.recorder()["state"] == "recording" and bench.recorder()["queued_items"] < 200)
    after_s, usual_s = watch.oldest_s, max(other.oldest_s, other.pause_s - EVERY_S)
    watch.is_over = other.is_over = True

    lost = bench.recorder()["lost_items"]
    etag = bench.client.get("/config").headers["ETag"]
    slowest_s, refused_s = max(took for _, took in answers), max((took for _, took in refusals), default=0.0)
    report_figure(
        f"a disk that {IS[bench.kind]} for {KINDS[bench.kind]} s: ages at most {oldest_s:.2f} s, {after_s:.2f} s when"
        f" it takes again ({usual_s:.2f} s on a sound disk meanwhile); snapshots at most {pause_s:.2f} s apart;"
        f" alarms after at most {max(alarms_s):.2f} s ({max(usual_alarms_s):.2f} s);"
        f" {len(answers)} answers within {slowest_s:.2f} s, {len(refusals)} refusals within {refused_s:.2f} s;"
        f" {queued} items waited, {lost} were lost"
    )
    assert max(oldest_s, after_s) < AGE_S + usual_s
    assert max(alarms_s) < max(ALARM_S, max(usual_alarms_s) + ALARM_S / 2)
    assert {status for status, _ in answers} == {200}, answers
    assert slowest_s < ANSWER_S + usual_s
    assert {status for status, _ in refusals} <= {507}
    assert refused_s < ANSWER_S + usual_s
    assert etag == tag
    assert not shed
    assert shown is not None, "every page says that nothing is recorded"
    assert abs(shown["since"] - began_wall_s) < 2.0
    assert lost == 0
    until(lambda: {each["what"] for each in signed(bench) if each["result"] == "done"} >= SIGNED)
    bench.close()
    with SessionFile(bench.session) as session:
        assert session.info.is_closed
        assert session.problems() == []
        times = [frame.t_mono_ns for frame in session.frames()]
    assert max(later - earlier for earlier, later in pairwise(times)) < 1e9


def signed(bench):
    return bench.client.get("/signed-log", params={"limit": 1000}).json()["records"]
