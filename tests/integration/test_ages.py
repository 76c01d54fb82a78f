"""Old is never live: the age that is shown counts from the measurement, whatever waited in between."""

import contextlib
import json
import os
import select
import signal
import threading
import time
import tty
from collections.abc import Iterator

import pytest
from websockets.sync.client import connect

from firmware_protocol.framing import encode_frame
from firmware_protocol.memory_map import FIELDS, MASTER_SIZE
from firmware_protocol.messages import Data, MessageType, Window

PERIOD_S = 0.1
WATCHED_S = 5.0
FEWEST = 6  # snapshots, however slow the machine
FIFTH_OF_A_CORE = (0.02, 0.08)  # runs, stands [s]
LONG_STANDS = (0.3, 1.5)


class Master:
    """Sends the fast windows on a pseudo-terminal; its uptime is the time since it was made."""

    def __init__(self) -> None:
        self.ours, theirs = os.openpty()
        tty.setraw(self.ours)
        os.set_blocking(self.ours, False)  # RS232 has no handshake: what nobody takes is lost, and stops no master
        self.path = os.ttyname(theirs)
        self._theirs = theirs
        self.frames_a_period = 1
        self._begun_s = time.monotonic() - 1.0
        self._ending = threading.Event()
        self._threads = [threading.Thread(target=run, daemon=True) for run in (self._write, self._discard)]
        image = bytearray(MASTER_SIZE)
        FIELDS["v"].pack_into(image, (37000,) * 96)
        FIELDS["t"].pack_into(image, (25,) * 96)
        places = ((420, 20), (1884, 204), (2280, 116), (2982, 2))
        self._body = Data(tuple(Window(o, bytes(image[o : o + n])) for o, n in places)).to_body()

    def uptime_s(self, now_s: float) -> float:
        """The master's clock at a moment of the machine's monotonic one."""
        return now_s - self._begun_s

    def start(self) -> None:
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        self._ending.set()
        os.close(self._theirs)
        os.close(self.ours)

    def _write(self) -> None:
        sequence = 0
        with contextlib.suppress(OSError):
            while not self._ending.wait(PERIOD_S):
                for _ in range(self.frames_a_period):
                    uptime_ms = round(self.uptime_s(time.monotonic()) * 1000)
                    with contextlib.suppress(BlockingIOError):
                        os.write(self.ours, encode_frame(MessageType.DATA, sequence, uptime_ms, self._body))
                    sequence += 1

    def _discard(self) -> None:
        with contextlib.suppress(OSError):
            while select.select([self.ours], [], []):
                os.read(self.ours, 4096)


@pytest.fixture
def master() -> Iterator[Master]:
    made = Master()
    made.start()
    yield made
    made.close()


@contextlib.contextmanager
def held(pid: int, runs_s: float, stands_s: float) -> Iterator[None]:
    """Let a process run and stand in turn."""
    ending = threading.Event()

    def hold() -> None:
        while not ending.wait(runs_s):
            os.kill(pid, signal.SIGSTOP)
            ending.wait(stands_s)
            os.kill(pid, signal.SIGCONT)

    thread = threading.Thread(target=hold, daemon=True)
    thread.start()
    yield
    ending.set()
    thread.join()
    os.kill(pid, signal.SIGCONT)


@pytest.mark.parametrize(("frames_a_period", "hold"), [(1, FIFTH_OF_A_CORE), (10, FIFTH_OF_A_CORE), (10, LONG_STANDS)])
def test_the_shown_age_is_right_while_the_service_lags(make_service, master, frames_a_period, hold):
    service = make_service("--serial", master.path)
    service.wait_for(lambda s: s["accumulator"]["loaded_cells"] == 96 and s["links"]["rs232"]["frames"] > 20)
    with service.client() as client:
        before = client.get("/sessions").json()["sessions"]
    master.frames_a_period = frames_a_period
    errors_s = []
    with (
        held(service.process.pid, *hold),
        connect(service.base_url.replace("http", "ws") + "/api/v1/live", max_size=1 << 22) as live,
    ):
        end_s = time.monotonic() + WATCHED_S
        while time.monotonic() < end_s or len(errors_s) < FEWEST:
            message = json.loads(live.recv(timeout=30))
            now_s = time.monotonic()
            sent_ago_s = now_s - message["sent_s"]  # the same clock here; a page finds it by itself
            shown_s = message["age"]["voltage"] + sent_ago_s
            errors_s.append(shown_s - (master.uptime_s(now_s) - message["uptime_s"]))
    assert max(abs(error) for error in errors_s) < 0.3
    with service.client() as client:
        assert [each["id"] for each in client.get("/sessions").json()["sessions"]] == [each["id"] for each in before]
