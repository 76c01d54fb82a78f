"""SIGTERM at any moment of the start is obeyed within two seconds."""

import os
import signal
import subprocess
import sys
import time

import pytest

from tests.campaign import campaign, of_size, tell_figure

OBEYED_S = 2.0
MOMENTS = of_size(0, 4, 40)
LONGEST_S = 4.0  # a start takes less


@pytest.mark.skipif(not MOMENTS, reason="one start for each moment: in the campaign")
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
        at_s = time.monotonic()
        started.send_signal(signal.SIGTERM)
        started.wait(60)
        took.append(time.monotonic() - at_s)
    tell_figure(f"SIGTERM at {MOMENTS} moments of the start: obeyed within {max(took):.2f} s")
    assert max(took) < OBEYED_S
