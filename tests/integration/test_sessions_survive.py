"""Sessions of a process that is killed, whose disk is full, whose power is cut: what is on the disk afterwards."""

import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from app.clock import Clock
from app.sessions.catalogue import Catalogue
from app.sessions.errors import NotASession
from app.sessions.reading.reader import SessionFile
from app.sessions.recording.recorder import Recorder
from firmware_protocol.framing import encode_frame
from tests.campaign import campaign, of_size

KILLS = of_size(1, 2, 8, 20)
PROJECT = Path(__file__).parents[2]

RECORD = """
import sys, time
from app.clock import Clock
from pathlib import Path
from app.sessions.recording.recorder import Recorder
from firmware_protocol.framing import encode_frame

recorder = Recorder(Path(sys.argv[1]), Clock(), version="test")
recorder.start("to be killed")
for i in range(100_000):
    raw = encode_frame(3, i & 0xFF, i, i.to_bytes(4, "little") + bytes(400))[1:-1]
    t_ns = time.monotonic_ns()
    recorder.frame(t_ns, time.time_ns(), 0, raw, True)
    print(t_ns, flush=True)
    time.sleep(0.005)
"""

FILL = """
import resource, sys, time
from pathlib import Path
from app.clock import Clock
from app.sessions.errors import RecordingFailed
from app.sessions.reading.reader import SessionFile
from app.sessions.recording.recorder import Recorder

recorder = Recorder(Path(sys.argv[1]), Clock(), version="test")
session = recorder.start()
recorder.flush()
resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, resource.RLIM_INFINITY))
sent = 0
try:
    while True:
        for _ in range(50):
            recorder.frame(time.monotonic_ns(), time.time_ns(), 0, sent.to_bytes(4, "little") * 100, False)
            sent += 1
        recorder.flush()
except RecordingFailed as error:
    print(error)
status = recorder.status
print(status.state, status.queued_items, status.lost_items)
with SessionFile(session.path) as file:
    print(file.info.frames, file.problems())
resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
recorder.flush()
print(recorder.status.state)
recorder.close()
with SessionFile(session.path) as file:
    stored = [int.from_bytes(frame.raw[:4], "little") for frame in file.frames()]
    print(stored == list(range(sent)), file.info.is_closed, file.problems())
"""


@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL is POSIX")
@campaign(240, 300, 600)
def test_a_killed_recorder_loses_at_most_the_last_half_second(tmp_path: Path, tell) -> None:
    worst_s = 0.0
    for seed in range(KILLS):
        folder = tmp_path / str(seed)
        process = subprocess.Popen(
            [sys.executable, "-c", RECORD, str(folder)], stdout=subprocess.PIPE, text=True, cwd=PROJECT
        )
        assert process.stdout is not None
        handed_over = [int(process.stdout.readline()) for _ in range(random.Random(seed).randint(150, 350))]
        process.send_signal(signal.SIGKILL)
        killed_ns = time.monotonic_ns()
        handed_over += [int(line) for line in process.stdout if line.endswith("\n")]
        process.wait()
        process.stdout.close()
        (info,) = Catalogue(folder).list()
        assert not info.is_closed
        with SessionFile(info.path) as session:
            stored = list(session.frames())
            assert session.problems() == []
        assert [frame.raw for frame in stored] == [
            encode_frame(3, i & 0xFF, i, i.to_bytes(4, "little") + bytes(400))[1:-1] for i in range(len(stored))
        ]
        due = [t_ns for t_ns in handed_over if t_ns <= killed_ns - 500_000_000]
        assert len(stored) >= len(due) > 0
        worst_s = max(worst_s, (killed_ns - handed_over[len(stored) - 1]) / 1e9)
    tell(f"kills: {KILLS} recorders at the line's pace, at most the last {worst_s:.2f} s lost")


@pytest.mark.skipif(sys.platform == "win32", reason="file size limits are POSIX")
def test_a_disk_that_takes_no_more_stalls_the_recorder_and_nothing_is_lost(tmp_path: Path) -> None:
    run = subprocess.run(
        [sys.executable, "-c", FILL, str(tmp_path)], capture_output=True, text=True, cwd=PROJECT, timeout=50
    )
    assert run.returncode == 0, run.stderr
    error, stalled, readable, resumed, complete = run.stdout.splitlines()
    assert "disk does not accept the session" in error
    state, queued, lost = stalled.split()
    assert (state, lost) == ("stalled", "0")
    assert int(queued) >= 50
    assert int(readable.split()[0]) > 0
    assert readable.endswith("[]")
    assert resumed == "recording"
    assert complete == "True True []"


def test_a_power_cut_at_any_byte_of_the_log_leaves_the_frames_before_it(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "live", Clock(), version="test")
    info = recorder.start()
    sent = []
    for i in range(120):
        raw = encode_frame(3, i & 0xFF, i, bytes([i]) * 300)[1:-1]
        sent.append(raw)
        recorder.frame(i * 10**7, i * 10**7, 0, raw, True)
        if i % 10 == 9:
            recorder.flush()
    log = info.path.with_name(info.path.name + "-wal")
    size = log.stat().st_size
    cut = tmp_path / "cut.sqlite"
    shutil.copy(info.path, cut)
    content = log.read_bytes()
    recorder.close()
    lengths = []
    for at in [*sorted(random.Random(1).sample(range(size), 60)), size]:
        for rest in tmp_path.glob("cut.sqlite-*"):
            rest.unlink()
        log_of_cut = tmp_path / "cut.sqlite-wal"
        log_of_cut.write_bytes(content[:at])
        try:
            with SessionFile(cut) as session:
                frames = [frame.raw for frame in session.frames()]
                assert session.problems() == []
        except NotASession:
            frames = []  # cut before the file had its tables
            assert lengths == [] or lengths[-1] == 0
        assert frames == sent[: len(frames)]
        lengths.append(len(frames))
    assert lengths == sorted(lengths)
    assert lengths[-1] == 120
    assert len(set(lengths)) > 5
