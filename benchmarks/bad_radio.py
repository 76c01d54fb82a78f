"""A recorder followed over a bad radio: what is lost (nothing may be), how late is what is live, when is it all here.

    python -m benchmarks.bad_radio [--minutes 8] [--latency 1] [--loss 0.3] [--cut-s 120] [--rate 60000]

The car is `voltwall serve` with the simulated accumulator, recording in real time. The radio (tests/bad_radio.py)
stands for TCP over a link with this latency each way, this share of packets lost (sent again after a round trip, twice
as long each time) and this rate for all; it is cut twice, each time for an eighth of the time or for `--cut-s`. The
live view is a state of 1 kB a second through the same air, as a car publishes it.
"""

from __future__ import annotations

import argparse
import json
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from contextlib import ExitStack, suppress
from pathlib import Path
from urllib.parse import urlsplit

from app.clock import Clock
from app.service.mqtt.cars import CarClock
from app.sessions.reading.reader import SessionFile
from app.sessions.transfer.fetch import Remote
from app.sessions.transfer.follow import Follower
from app.sessions.transfer.session_copy import SessionCopy
from tests.bad_radio import BadRadio

STATE_BYTES = 1000
LATE_S = 1.0  # beyond the shortest way: as the service has it


class LiveView:
    """A car that tells its state once a second, and the pit that hears it."""

    def __init__(self) -> None:
        self.server = socket.create_server(("127.0.0.1", 0))
        self.port = 0  # at the pit's end of the radio
        self.delays: list[float] = []
        self.is_counted = True
        self._clock, self._sent_s = CarClock(), 0.0
        threading.Thread(target=self._tell, daemon=True).start()

    def _tell(self) -> None:
        while True:
            connection, _ = self.server.accept()
            threading.Thread(target=self._tell_one, args=(connection,), daemon=True).start()

    @staticmethod
    def _tell_one(connection: socket.socket) -> None:
        with suppress(OSError), connection:
            while True:
                connection.sendall(json.dumps({"s": time.monotonic()}).ljust(STATE_BYTES - 1).encode() + b"\n")
                time.sleep(1.0)

    def hear(self) -> None:
        """Connect, and again for ever."""
        while True:
            with suppress(OSError, ValueError), socket.create_connection(("127.0.0.1", self.port), 15) as connection:
                connection.settimeout(15)
                for line in connection.makefile("rb"):
                    now = time.monotonic()
                    sent = json.loads(line)["s"]
                    self._clock.waited_s("run", sent, now)
                    self._sent_s = sent
                    if self.is_counted:
                        self.delays.append(now - sent)
            time.sleep(0.5)

    def waits(self) -> bool:
        """Whether the newest state that is here is late."""
        age_s = time.monotonic() - self._sent_s - self._clock.offset_s
        return LATE_S + 1.0 <= age_s < 10.0  # one is told a second

    def told(self) -> str:
        """Return the delays since the last time, in words."""
        delays, self.delays = sorted(self.delays), []
        if len(delays) < 2:
            return "nothing came"
        cut = statistics.quantiles(delays, n=100, method="inclusive")
        return f"{len(delays)} states, delay median {cut[49]:.1f} s, p90 {cut[89]:.1f} s, most {delays[-1]:.1f} s"


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=8.0)
    parser.add_argument("--latency", type=float, default=1.0)
    parser.add_argument("--loss", type=float, default=0.3)
    parser.add_argument("--cut-s", type=float, help="of each of the two cuts (default: an eighth of the time)")
    parser.add_argument("--rate", type=float, default=60_000.0)
    parser.add_argument("--order", choices=("oldest", "newest"), default="newest")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack:
        folder = Path(name)
        program = [sys.executable, "-m", "app.cli", "serve", "--port", "0", "--data", f"{folder}/car", "--seed", "1"]
        car = subprocess.Popen([*program, "--filter", "coulomb"], stdout=subprocess.PIPE, text=True)
        stack.callback(car.kill)
        assert car.stdout is not None
        url = urlsplit(next(line.split("Voltwall: ")[1].strip() for line in car.stdout if "Voltwall: " in line))
        radio = BadRadio(("127.0.0.1", url.port or 80), latency_s=args.latency, loss=args.loss, rate_bytes_s=args.rate)
        stack.callback(radio.close)
        live = LiveView()
        live.port = radio.also(("127.0.0.1", live.server.getsockname()[1]))
        threading.Thread(target=live.hear, daemon=True).start()
        start = time.monotonic()
        quarter_s = 60 * args.minutes / 4

        def told(what: str) -> None:
            copies = [copy.state() for copy in SessionCopy.all_in(folder / "pit")]
            missing = ", ".join(f"{c['missing_s']:.0f} of {c['pieces'] * c['piece_s']:.0f} s missing" for c in copies)
            took = time.monotonic() - start
            print(f"{took:6.0f} s  {what:26} live: {live.told():66} {radio.bytes / 1e6:6.2f} MB  {missing}", flush=True)

        time.sleep(quarter_s)
        told("without following")
        (folder / "pit").mkdir()
        remote = Remote(radio.url, label="car")
        follower = Follower(remote, folder / "pit", Clock(), order=args.order, live_waits=live.waits)
        ending = threading.Event()
        threading.Thread(target=follower.run, args=(ending,), daemon=True).start()
        time.sleep(quarter_s)
        told("following")
        for number in (1, 2):
            radio.cut(hangs=True)
            time.sleep(quarter_s / 2 if args.cut_s is None else args.cut_s)
            told(f"after cut {number}")
            radio.mend()
            time.sleep(quarter_s / 2)
            told("following again")
        session_id = finish(url.geturl())
        ended = time.monotonic()
        path = folder / "pit" / f"car-{session_id}.sqlite"
        while not path.with_name(path.name + ".fetched").exists() or SessionCopy(folder / "pit", path.stem).head:
            time.sleep(1)
        told(f"whole {time.monotonic() - ended:.0f} s after its end")
        ending.set()
        compare(folder / "car" / "sessions" / f"{session_id}.sqlite", path)


def finish(url: str) -> str:
    """Stop the car's session and return its id, once it is closed."""

    def ask(path: str, data: bytes | None = None) -> dict[str, list[dict[str, object]]]:
        with urllib.request.urlopen(urllib.request.Request(f"{url}/api/v1/{path}", data), timeout=60) as answer:
            return dict(json.loads(answer.read() or b"{}"))

    session_id = str(next(each["id"] for each in ask("sessions")["sessions"] if each["recording"]))
    ask(f"sessions/{session_id}/stop", b"")
    while not next(each["closed"] for each in ask("sessions")["sessions"] if each["id"] == session_id):
        time.sleep(0.2)
    return session_id


def compare(original: Path, copy: Path) -> None:
    """Print how many frames differ."""
    with SessionFile(original) as there, SessionFile(copy) as here:
        frames, copied = list(there.frames()), list(here.frames())
        can, can_copied = list(there.can_frames()), list(here.can_frames())
        print(
            f"frames {len(frames)}, of them in the copy {len(copied)}, identical: {frames == copied}; "
            f"CAN frames {len(can)}, identical: {can == can_copied}; problems of the copy: {here.problems()}"
        )


if __name__ == "__main__":
    main()
