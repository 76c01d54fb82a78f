"""Hundreds of kills and power cuts at random instants: nothing that was acknowledged is lost, every file opens.

`make campaign` has more of both.
"""

import os
import random
import shutil
import struct
import subprocess
import sys
from pathlib import Path

import pytest

from app.sessions.errors import NotASession
from app.sessions.reading.reader import SessionFile
from tests.c_programs import build_faulty_disk
from tests.campaign import campaign, of_size

PROJECT = Path(__file__).parents[2]
KILLS = of_size(4, 30, 150, 600)
CUTS = of_size(5, 60, 300, 100_000)  # at most at every change of the files
SECTOR = 512
ACKNOWLEDGED = 5  # a record of faulty_disk.c

KILL = """
import os, random, signal, sys, time
from pathlib import Path
from app.clock import Clock
from app.sessions.reading.reader import SessionFile
from app.sessions.recording.recorder import Recorder

def record(folder, acknowledged):
    recorder = Recorder(folder, Clock(), version="test")
    recorder.start()
    sent = 0
    while True:
        for _ in range(20):
            now = time.monotonic_ns()
            recorder.frame(now, time.time_ns(), 0, sent.to_bytes(4, "little") * 60, False)  # no checksum holds
            sent += 1
        recorder.flush()
        os.write(acknowledged, sent.to_bytes(4, "little"))

rng = random.Random(1)
total = 0
for number in range(int(sys.argv[2])):
    folder = Path(sys.argv[1]) / str(number)
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        record(folder, writing)
    os.close(writing)
    commits, heard, began_s = rng.randrange(2, 6), b"", time.monotonic()
    while len(heard) < 4 * commits:
        heard += os.read(reading, 4 * commits - len(heard))
    time.sleep(rng.uniform(0.0, (time.monotonic() - began_s) / commits))  # anywhere in the next one, however long it is
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    while more := os.read(reading, 65536):
        heard += more
    os.close(reading)
    acknowledged = int.from_bytes(heard[len(heard) // 4 * 4 - 4:len(heard) // 4 * 4], "little")
    (path,) = folder.glob("*.sqlite")
    with SessionFile(path) as session:
        stored = [int.from_bytes(frame.raw[:4], "little") for frame in session.frames()]
        assert session.problems() == [], session.problems()
    assert stored == list(range(len(stored))), number
    assert len(stored) >= acknowledged > 0, (number, len(stored), acknowledged)
    total += acknowledged
print(total)
"""

RECORD = """
import ctypes, sys, time
from pathlib import Path
from app.sessions.recording.recorder import Recorder
from tests.fake_clock import FunctionClock
from firmware_protocol.framing import encode_frame
from firmware_protocol.messages import Data, MessageType, Window

acknowledged = ctypes.CDLL(None).acknowledged
now = 0
WALL = 1790000000 * 10**9
recorder = Recorder(Path(sys.argv[1]), FunctionClock(lambda: now, lambda: WALL + now), version="test")
recorder.start()
sent = 0
for batch in range(120):
    for _ in range(30):
        body = Data((Window(1896, sent.to_bytes(4, "little") * 48),)).to_body()
        now = sent * 100_000_000
        raw = encode_frame(MessageType.DATA, sent & 255, sent * 100, body)[1:-1]
        recorder.frame(now, WALL + now, 0, raw, True)
        sent += 1
    recorder.flush()
    acknowledged(sent)
recorder.close()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL is POSIX")
@campaign(240, 300, 1200)
def test_a_kill_at_any_instant_loses_nothing_that_was_acknowledged(tmp_path: Path, tell) -> None:
    run = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", KILL, str(tmp_path), str(KILLS)],
        capture_output=True, text=True, cwd=PROJECT, check=False,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr[-2000:]
    assert int(run.stdout) >= KILLS * 2 * 20  # two commits of twenty frames at least
    tell(f"kills: {KILLS} recorders killed, none of {int(run.stdout)} acknowledged frames lost, every file opens")


class Disk:
    """The files of a session as a disk holds them: what was forced, and sectors of the rest that may have arrived."""

    def __init__(self) -> None:
        self.forced = [bytearray(), bytearray()]
        self.waiting: list[list[tuple[int, bytes | None]]] = [[], []]

    def apply(self, op: int, file: int, offset: int, data: bytes) -> None:
        if op == 1:
            self.waiting[file].append((offset, data))
        elif op == 2:
            self.waiting[file].append((offset, None))
        elif op == 3:
            for each in self.waiting[file]:
                put(self.forced[file], *each)
            self.waiting[file].clear()

    def after_cut(self, rng: random.Random) -> list[bytearray]:
        """Forced bytes, and of what waited some writes, whole, torn at a sector, or not at all, in any order."""
        found = [bytearray(each) for each in self.forced]
        for content, waiting in zip(found, self.waiting, strict=True):
            chosen = [each for each in waiting if rng.random() < 0.6]
            rng.shuffle(chosen)
            for offset, data in chosen:
                if data is not None and rng.random() < 0.4:
                    data = data[: rng.randrange(0, len(data) + SECTOR, SECTOR)]
                put(content, offset, data)
        return found


def put(content: bytearray, offset: int, data: bytes | None) -> None:
    if data is None:
        del content[offset:]
        content.extend(bytes(max(0, offset - len(content))))
    elif data:
        content.extend(bytes(max(0, offset - len(content))))
        content[offset : offset + len(data)] = data


@pytest.mark.skipif(sys.platform != "linux" or not shutil.which("gcc"), reason="needs Linux and gcc")
@campaign(240, 300, 1200)
def test_a_power_cut_at_any_instant_loses_nothing_that_was_acknowledged(tmp_path: Path, tell) -> None:
    log = tmp_path / "writes"
    environment = os.environ | {
        "LD_PRELOAD": str(build_faulty_disk()),
        "WRITE_LOG": str(log),
        "FAULT_FOLDER": str(tmp_path / "live"),
    }
    subprocess.run([sys.executable, "-c", RECORD, str(tmp_path / "live")], env=environment, cwd=PROJECT, check=True)
    raw = log.read_bytes()
    operations, at = [], 0
    while at < len(raw):
        op, offset, length, n_path = struct.unpack_from("<BQIH", raw, at)
        at += 15 + n_path
        path = raw[at - n_path : at].decode()
        if op == ACKNOWLEDGED or path.endswith((".sqlite", ".sqlite-wal")):
            operations.append((op, int(path.endswith("-wal")), offset, raw[at : at + length]))
        at += length
    assert sum(op == 3 for op, *_ in operations) > 100
    assert any(op == 1 and file == 0 for op, file, *_ in operations)
    rng = random.Random(7)
    instants = iter(sorted(rng.sample(range(len(operations)), min(CUTS, len(operations)))))
    disk, acknowledged, opened = Disk(), 0, 0
    due = next(instants, None)
    for number, (op, file, offset, data) in enumerate(operations):
        if op == ACKNOWLEDGED:
            acknowledged = offset
        disk.apply(op, file, offset, data)
        if number != due:
            continue
        due = next(instants, None)
        folder = tmp_path / "cut"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        database, wal = disk.after_cut(rng)
        (folder / "cut.sqlite").write_bytes(database)
        if wal:
            (folder / "cut.sqlite-wal").write_bytes(wal)
        try:
            with SessionFile(folder / "cut.sqlite") as session:
                stored = [frame.t_mono_ns // 100_000_000 for frame in session.frames()]
                assert session.problems() == []
                samples = session.series(["v[0]"])["v[0]"].time_s
            opened += 1
        except NotASession:
            assert acknowledged == 0, "the file does not open"
            continue
        assert stored == list(range(len(stored)))
        assert len(stored) >= acknowledged, number
        assert len(samples) == min(len(stored), 2000) or len(stored) > 2000
    assert opened > 0.8 * min(CUTS, len(operations))
    tell(f"power cuts: {min(CUTS, len(operations))} in a session, no acknowledged frame lost, {opened} files open")
