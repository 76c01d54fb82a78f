"""A day of the whole service in a fraction of it: `python -m tests.recorded.hurried_day [HOURS] [--data FOLDER]`.

The simulated car is computed as fast as the service takes what it says, and the service's clock is the car's. So files
go round, old sessions go to the trash, the master restarts, the cable comes off, alarms come and go as often as in so
many hours, while real readers, exports, reports and page requests ask over HTTP. One line of JSON for each LOOK_S of
the car's time says what the process holds.
"""

import argparse
import asyncio
import contextlib
import json
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import httpx
import uvicorn
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from app.api.application import create_app
from app.api.web.connection import server_config
from app.api.web.connection_limits import ClientConnections
from app.service.host import release_freed_memory
from app.service.settings import Settings
from app.sources.items import LinkChange, SerialItem
from firmware_protocol.framing import FrameDecoder
from simulator.library import find_scenario
from simulator.scenario_player import ScenarioPlayer
from tests.fake_clock import FunctionClock

EPOCH_NS = 1_790_000_000 * 10**9
BEGAN_NS = 10**12  # start of the monotonic clock: zero is a time, too
STEP_S = 0.05  # step of the car's physics
TURN_S = 0.2  # car's time between two commits and checks of what is due: more would shed load
LOOK_S = 60.0
PATIENCE_S = 600.0  # for an answer, on a machine that does other things
READERS = 3
UNPLUGGED_S = 30.0
SPLIT_MB, KEPT_GB, KEPT_DAYS = 8, 0.2, 1 / 24  # a file is full within half an hour
EVERY_S = {  # periods in the car's time
    "page": 60.0,
    "retention": 600.0,
    "export": 1200.0,
    "alarm": 1500.0,
    "report": 1800.0,
    "reset": 1500.0,
    "unplug": 2700.0,
    "come and go": 300.0,
}
RESTARTS_S = 1600.0  # the first one: it ends what the alarm before tripped


class HurriedDay:
    """A car, a service on its clock, and who asks it."""

    def __init__(self, folder: Path) -> None:
        self.player = ScenarioPlayer(find_scenario("race-day"), seed=4, step_s=STEP_S)
        self.car = self.player.simulation
        self.car.serial_out = self._deliver
        self.clock = FunctionClock(lambda: BEGAN_NS + self.now_ns, lambda: EPOCH_NS + self.now_ns)
        settings = Settings(data=folder, split_mb=SPLIT_MB, keep_gb=KEPT_GB, keep_days=KEPT_DAYS, season=False)
        app = create_app(settings, "serial", serial_url=None, can_url=None, clock=self.clock)
        self.service = app.state.parts.service
        self.events: Counter[str] = Counter()
        self.service.events.subscribe(lambda event: self.events.update([event.code]))
        self.server = uvicorn.Server(server_config(app, ClientConnections(), port=0))
        self.decoder = FrameDecoder()
        self.done: Counter[str] = Counter()
        self.wrong: list[str] = []
        self.heard_s = self.plugged_s = 0.0
        self.due_s = EVERY_S | {"reset": RESTARTS_S}
        self.is_over = threading.Event()
        self.threads = [threading.Thread(target=lambda: asyncio.run(self.server.serve()))]
        self.threads += [threading.Thread(target=self._read, args=(k,)) for k in range(READERS)]

    @property
    def now_ns(self) -> int:
        """The car's time."""
        return round(self.car.now_s * 1e9)

    def run(self, hours: float, tell: Callable[[dict[str, float]], None]) -> None:
        """Let so many hours of the car pass; `tell` gets each look."""
        self.threads[0].start()
        _until(lambda: self.server.started)
        host, port = self.server.servers[0].sockets[0].getsockname()[:2]
        self.url = f"{host}:{port}"
        for thread in self.threads[1:]:
            thread.start()
        self._link("open")
        look_s = LOOK_S
        try:
            with httpx.Client(base_url=f"http://{self.url}/api/v1", timeout=PATIENCE_S) as client:
                while self.car.now_s < 3600.0 * hours:
                    self._turn(client)
                    if self.car.now_s >= look_s:
                        look_s += LOOK_S
                        tell(self._look())
        finally:
            self.is_over.set()
            for thread in self.threads[1:]:
                thread.join(PATIENCE_S)
            self.server.should_exit = True
            self.threads[0].join(PATIENCE_S)

    def _turn(self, client: httpx.Client) -> None:
        self.player.run(TURN_S)
        if self.car.now_s - self.heard_s > 1.0 and not self.plugged_s:
            self.heard_s = self.car.now_s
            self.car.receive(b"x")  # as the link does after a second of silence
        if self.plugged_s and self.car.now_s >= self.plugged_s:
            self.plugged_s = 0.0
            self._link("open")
        inbox = self.service.live._inbox
        _until(lambda: inbox.oldest_ns is None)
        self.service.recorder.flush()  # its commits wait by the computer's clock
        for name, due_s in self.due_s.items():
            if self.car.now_s >= due_s:
                self.due_s[name] += EVERY_S[name]
                try:
                    self._act(name, client)
                    self.done[name] += 1
                except (httpx.HTTPError, ConnectionClosed, OSError) as error:
                    self.wrong.append(f"{self.car.now_s:.0f} s: {name}: {error!r}")

    def _act(self, name: str, client: httpx.Client) -> None:
        match name:
            case "page":
                for path in ("/health", "/system", "/events", "/history?seconds=60", "/signed-log", "/sessions"):
                    client.get(path)
            case "retention":
                self.service.retention.apply()
            case "export" | "report":
                session = client.get("/recorder").raise_for_status().json()["session_id"]
                part = {"format": "csv", "signal": "v[0]", "t_from": 0, "t_to": 30} if name == "export" else {}
                client.get(f"/sessions/{session}/{name}", params=part).raise_for_status()
            case "alarm":
                self.player.faults.inject("cell-voltage-stuck", 7, 4.4, 20.0)
            case "reset":
                self.player.faults.inject("master-watchdog-reset")
            case "unplug":
                self.plugged_s = self.car.now_s + UNPLUGGED_S
                self._link("lost")
            case "come and go":
                for _ in range(5):
                    with connect(f"ws://{self.url}/api/v1/live", max_size=1 << 22, open_timeout=PATIENCE_S) as live:
                        live.recv(timeout=PATIENCE_S)

    def _deliver(self, data: bytes) -> None:
        if self.plugged_s:
            return
        self.heard_s = self.car.now_s
        for frame in self.decoder.feed(data):
            self.done["frames"] += 1
            self.service.live._inbox.put(SerialItem(self.clock.monotonic_ns(), self.clock.wall_ns(), frame))

    def _link(self, state: str) -> None:
        item = LinkChange(self.clock.monotonic_ns(), self.clock.wall_ns(), "rs232", state)  # type: ignore[arg-type]
        self.service.live._inbox.put(item)

    def _read(self, k: int) -> None:
        while not self.is_over.is_set():
            try:
                with connect(f"ws://{self.url}/api/v1/live?rate={5 * (k + 1)}", max_size=1 << 22) as live:
                    while not self.is_over.is_set():
                        with contextlib.suppress(TimeoutError):
                            live.recv(timeout=1.0)
                            self.done["messages"] += 1
            except (ConnectionClosed, OSError, TimeoutError) as error:
                if not self.is_over.is_set():
                    self.wrong.append(f"{self.car.now_s:.0f} s: a reader: {error!r}")

    def _look(self) -> dict[str, float]:
        process = Path("/proc/self")
        return {
            "hours": round(self.car.now_s / 3600, 4),
            "mb": round(int((process / "statm").read_text().split()[1]) * 4096 / 1e6, 2),
            "descriptors": len([*(process / "fd").iterdir()]),
            "threads": len([*(process / "task").iterdir()]),
        }


def _until(condition: Callable[[], object]) -> None:
    began_s = time.monotonic()
    while not condition():
        if time.monotonic() - began_s > PATIENCE_S:
            raise TimeoutError("the service stands still")
        time.sleep(0.001)


def main() -> None:
    """Let the hours pass; print each look, then what was done and what went wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("hours", type=float, nargs="?", default=24.0)
    parser.add_argument("--data", type=Path)
    arguments = parser.parse_args()
    release_freed_memory()  # as `voltwall serve` does
    with tempfile.TemporaryDirectory(prefix="voltwall-day-") as folder:
        day = HurriedDay(arguments.data or Path(folder))
        day.run(arguments.hours, lambda look: print(json.dumps(look), flush=True))
        print(json.dumps({"done": day.done, "wrong": day.wrong, "events": day.events}), flush=True)


if __name__ == "__main__":
    main()
