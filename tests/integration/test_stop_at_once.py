"""SIGTERM at any moment of the start is obeyed within two seconds, those without a core not counted."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.campaign import campaign, of_size, report_figure

OBEYED_S = 2.0
MOMENTS = of_size(0, 4, 16, 40)
LONGEST_S = 4.0  # a start takes less


def waited_for_a_core_s(pid: int) -> float:
    """How long the process's main thread could have run and had no core, because the machine had other things to do."""
    _, waited_ns, _ = Path(f"/proc/{pid}/schedstat").read_text().split()
    return int(waited_ns) / 1e9


@pytest.mark.skipif(not MOMENTS, reason="one start for each moment: in the campaign")
@pytest.mark.skipif(not Path("/proc/self/schedstat").exists(), reason="no /proc/PID/schedstat here")
@campaign(60, 200, 600)
def test_sigterm_is_obeyed_at_any_moment_of_the_start(tmp_path):
    took = []
    for number in range(MOMENTS):
        environment = os.environ | {
            "HOME": str(tmp_path / f"home-{number}"),
            "XDG_CACHE_HOME": str(tmp_path / str(number)),
        }
        command = [sys.executable, "-m", "app.cli", "serve", "--port", "0", "--data", str(tmp_path / f"data-{number}")]
        started = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(LONGEST_S * number / MOMENTS)
        at_s, waited_s = time.monotonic(), waited_for_a_core_s(started.pid)
        started.send_signal(signal.SIGTERM)
        os.waitid(os.P_PID, started.pid, os.WEXITED | os.WNOWAIT)  # what it waited is told until it is waited for
        waited_s = waited_for_a_core_s(started.pid) - waited_s
        took.append(time.monotonic() - at_s - waited_s)
        started.wait()
    report_figure(f"SIGTERM at {MOMENTS} moments of the start: obeyed within {max(took):.2f} s of its own time")
    assert max(took) < OBEYED_S
