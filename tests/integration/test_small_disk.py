"""Recording on a real file system of two megabytes: full, with room again, and read-only."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

PROJECT = Path(__file__).parents[2]
SIZE = "3m"

FILL = """
import os, time
from pathlib import Path
from app.sources.items import SerialItem
from app.clock import Clock
from app.sessions.recording.auto_recorder import AutoRecorder
from app.sessions.reading.reader import SessionFile
from app.sessions.recording.disk import DiskLimits
from app.sessions.recording.recorder import Recorder

disk = Path(os.environ["DISK"])
limits = DiskLimits(warn_free_bytes=1500_000, stop_free_bytes=int(os.environ["KEEP"]))
recorder = Recorder(disk / "sessions", Clock(), version="test", limits=limits)
session = recorder.start()
sent, warned_at, stalled_at = 0, None, None
while stalled_at is None:
    for _ in range(25):
        recorder.frame(time.monotonic_ns(), time.time_ns(), 0, sent.to_bytes(4, "little") * 100, False)
        sent += 1
    try:
        recorder.flush()
    except Exception as error:
        stalled_at = sent
        print(error)
    status = recorder.status
    if warned_at is None and status.warning:
        warned_at = sent
print(0 < warned_at < stalled_at, status.state, status.lost_items)
with SessionFile(session.path) as file:
    print(file.info.frames >= stalled_at - 50, file.problems())
(disk / "ballast").unlink()
recorder.flush()
print(recorder.status.state)
recorder.close()
with SessionFile(session.path) as file:
    stored = [int.from_bytes(frame.raw[:4], "little") for frame in file.frames()]
    print(stored == list(range(sent)), file.info.is_closed, file.problems())
"""

READ_ONLY = """
import os, time
from pathlib import Path
from app.sessions.catalogue import Catalogue
from app.clock import Clock
from app.sessions.recording.auto_recorder import AutoRecorder
from app.sources.items import SerialItem
from app.words import render
from firmware_protocol.framing import decode_chunk, encode_frame

disk = Path(os.environ["DISK"])
events = []
recorder = AutoRecorder(disk / "sessions", automatic=True, on_event=events.append, clock=Clock())
for i in range(20):
    recorder.on_item(SerialItem(i * 10**9, i * 10**9, decode_chunk(encode_frame(3, i, i, bytes(4))[1:-1])))
print([event.code for event in events], render(events[0].message).endswith("Read-only file system"))
(info,) = Catalogue(disk / "sessions").list()
print(info.name, info.frames)
"""

PREPARE = """
import os, time
from pathlib import Path
from app.clock import Clock
from app.sessions.recording.disk import DiskLimits
from app.sessions.recording.recorder import Recorder

limits = DiskLimits(stop_free_bytes=0)
recorder = Recorder(Path(os.environ["DISK"]) / "sessions", Clock(), version="test", limits=limits)
recorder.start("from before")
recorder.frame(time.monotonic_ns(), time.time_ns(), 0, b"x", False)
recorder.close()
"""


def on_small_disk(tmp_path: Path, script: str) -> list[str]:
    """Run a shell script as root of a user namespace, with a file system of SIZE mounted at $DISK."""
    disk = tmp_path / "disk"
    disk.mkdir()
    environment = os.environ | {"DISK": str(disk), "PYTHON": sys.executable, "PYTHONPATH": str(PROJECT)}
    mount = f'mount -t tmpfs -o size={SIZE} tmpfs "$DISK"'
    inside = ["unshare", "--user", "--map-root-user", "--mount", "bash", "-euc"]
    if shutil.which("unshare") is None or subprocess.run([*inside, mount], env=environment, check=False).returncode:
        if os.environ.get("CI") == "true":
            pytest.fail("a small file system cannot be mounted here")
        pytest.skip("a small file system cannot be mounted here")
    run = subprocess.run(
        [*inside, f"{mount}\n{script}"],
        env=environment, cwd=PROJECT, capture_output=True, text=True, timeout=50, check=False,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    return run.stdout.splitlines()


@pytest.mark.skipif(sys.platform != "linux", reason="needs Linux namespaces")
@pytest.mark.parametrize("keep_free", [400_000, 0])
def test_a_disk_that_fills_up_is_told_early_stalls_cleanly_and_resumes(tmp_path: Path, keep_free: int) -> None:
    """With some kept free the recorder stops by itself; with none it meets the disk's own refusal."""
    script = f'head -c 600000 /dev/zero > "$DISK/ballast"\nKEEP={keep_free} "$PYTHON" - <<"END"\n{FILL}\nEND'
    reason, stalled, readable, resumed, complete = on_small_disk(tmp_path, script)
    assert ("disk nearly full" if keep_free else "disk does not accept the session") in reason
    assert stalled == "True stalled 0"
    assert readable == "True []"
    assert resumed == "recording"
    assert complete == "True True []"


@pytest.mark.skipif(sys.platform != "linux", reason="needs Linux namespaces")
def test_a_read_only_disk_is_told_once_and_its_sessions_are_read(tmp_path: Path) -> None:
    script = f'"$PYTHON" - <<"END"\n{PREPARE}\nEND\nmount -o remount,ro "$DISK"\n"$PYTHON" - <<"END"\n{READ_ONLY}\nEND'
    codes, info = on_small_disk(tmp_path, script)
    assert codes == "['recording-failed'] True"
    assert info == "from before 1"


@pytest.mark.skipif(sys.platform != "linux", reason="needs Linux namespaces")
def test_an_import_that_fills_the_disk_ends_in_one_line_and_leaves_nothing(tmp_path: Path) -> None:
    table = tmp_path / "long.csv"
    rows = (f"{k / 10},{k % 7},{3.7 + k % 97 / 1000:.4f},{3.7 + k % 89 / 1000:.4f}\n" for k in range(4000))
    table.write_text("Time (s),Current (A),Cell 1 (V),Cell 2 (V)\n" + "".join(rows))
    script = (
        f'head -c 2900000 /dev/zero > "$DISK/ballast"\n"$PYTHON" -m app.cli sessions import "{table}"'
        ' --data "$DISK/data" 2>&1 || true\nls "$DISK/data/sessions"'
    )
    [line] = on_small_disk(tmp_path, script)
    assert line.endswith("No space left on device")
