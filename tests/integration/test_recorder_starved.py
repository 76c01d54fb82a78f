"""A kill loses at most half a second of what came down the line, also where the service has a twentieth of a core."""

import os
import random
import sys
import threading
import time

import pytest

from app.commands.bench_measurements import fast_frame
from app.sessions.catalogue import Catalogue
from app.sessions.reading.reader import SessionFile
from firmware_protocol.framing import LINE_BYTES_PER_S
from tests.campaign import campaign, of_size, report_figure
from tests.service_process import Service, until
from tests.starved import starved

SHARE = 0.05
KILLS = of_size(0, 1, 3, 12)
LOST_S = 0.5
STARVED_S = (6.0, 12.0)


class Line:
    """A master that fills its line: every frame, and when its last byte was due."""

    def __init__(self):
        self.descriptor, self.slave = os.openpty()
        import tty

        tty.setraw(self.descriptor)
        self.path = os.ttyname(self.slave)
        self.sent = []
        self.is_over = threading.Event()
        self.threads = [threading.Thread(target=self.send), threading.Thread(target=self.drain, daemon=True)]
        for thread in self.threads:
            thread.start()

    def send(self):
        step, due_s = 0, time.monotonic()
        while not self.is_over.is_set():
            frame = fast_frame(step, 1000 + 40 * step)
            due_s += len(frame) / LINE_BYTES_PER_S
            if (wait_s := due_s - time.monotonic()) > 0:
                self.is_over.wait(wait_s)
            self.sent.append((due_s, frame[1:-1]))
            os.write(self.descriptor, frame)
            step += 1

    def drain(self):
        try:
            while os.read(self.descriptor, 4096):
                pass
        except OSError:
            return

    def end(self):
        self.is_over.set()
        os.close(self.slave)  # a write that waits fails
        self.threads[0].join(1.0)
        os.close(self.descriptor)


@pytest.mark.skipif(not KILLS, reason="half a minute for each kill: in the campaign")
@pytest.mark.skipif(sys.platform == "win32", reason="a pseudo-terminal")
@campaign(60, 300, 1500)
def test_a_starved_service_loses_at_most_half_a_second_by_a_kill(tmp_path):
    lost_s, how = [], ""
    for number in range(KILLS):
        line, service = Line(), None
        try:
            service = Service(tmp_path / str(number), ["--serial", line.path]).start()
            with service.client() as client:
                until(lambda: client.get("/recorder").json()["state"] == "recording")
                service.wait_for(lambda snapshot: (snapshot["prediction"] or {}).get("power") or snapshot["seq"] > 100)
            with starved(service.process.pid, SHARE) as how:
                began_s = time.monotonic()
                time.sleep(random.Random(number).uniform(*STARVED_S))
                killed_s = time.monotonic()
                service.process.kill()
            service.process.join()
        finally:
            line.end()
            if service is not None and service.is_running:
                service.kill()
        (info,) = Catalogue(tmp_path / str(number) / "sessions").list()
        with SessionFile(info.path) as session:
            stored = {bytes(frame.raw) for frame in session.frames()}
        missing = [due_s for due_s, raw in line.sent if raw not in stored and began_s < due_s < killed_s]
        lost_s.append(killed_s - min(missing, default=killed_s))
    text = ", ".join(f"{each:.2f}" for each in sorted(lost_s))
    report_figure(f"kills at {SHARE:.0%} of a core ({how}): {KILLS}, lost at most {max(lost_s):.2f} s ({text})")
    assert max(lost_s) <= LOST_S
