"""Exports are, byte for byte, those of the version before sessions were read through one block iterator (0.1.0)."""

import hashlib
import shutil
from pathlib import Path

import numpy as np
import pytest

from app.sessions.export.export import export
from app.sessions.reading.reader import SessionFile
from app.sessions.recording.recorder import Recorder
from app.sessions.storage.signals import Signals
from app.sources.loaded_battery import team_battery
from firmware_protocol.memory_map import CONFIG_SIZE, FIELDS
from firmware_protocol.older_maps import FIRST_MAP

FROZEN = Path(__file__).parents[1] / "frozen"
MONO_NS, WALL_NS = 5_000 * 10**9, 1_790_000_000 * 10**9
DIGESTS = {
    ("session_1", "csv"): "ec009d52a5107bfbf4326461c65dc01e78d2f2c88f30768e4d13e1b7c21684e5",
    ("session_1", "ld"): "70ae66673ec21493ff4c7b1e46b9c472907b4b5d7a7c524a5a1f3cf23b2b8023",
    ("session_2", "csv"): "ec009d52a5107bfbf4326461c65dc01e78d2f2c88f30768e4d13e1b7c21684e5",
    ("session_2", "ld"): "cc87bc943e259dabf48ea5a8ae71449f913790b209823c8e6d982f09fdc5ade7",
    ("eventful", "csv"): "5f9e55094413d5968a6416c4cd28fb424040d434602ff920a08c5617941f4220",
    ("eventful", "ld"): "61a77ed0ee8d45fb2821a72b30ea8f31932e96039ec9fdb5395afddbc80daa48",
}


def digest(path: Path, export_format: str) -> str:
    """Of the default signals and some that are sampled rarely, or told by the configuration."""
    signals = [
        *(signal.name for signal in Signals(team_battery()).of_table()),
        "conf.ts",
        "conf.v_cell_max",
        "r_fs[7]",
        "slave[3].cvr[5]",
    ]
    target = path.with_suffix(f".{export_format}")
    with SessionFile(path) as session:
        export(session, target, export_format, signals=signals)
    content = target.read_bytes()
    if export_format == "csv":  # the age of each row and its time stamp were added behind them
        content = b"".join(line.rsplit(b",", 2)[0] + b"\n" for line in content.splitlines())
    return hashlib.sha256(content).hexdigest()


@pytest.mark.parametrize("export_format", ["csv", "ld"])
@pytest.mark.parametrize("name", ["session_1", "session_2"])
def test_of_a_frozen_session(name: str, export_format: str, tmp_path: Path) -> None:
    shutil.copy(FROZEN / f"{name}.sqlite", tmp_path)
    assert digest(tmp_path / f"{name}.sqlite", export_format) == DIGESTS[name, export_format]


@pytest.mark.parametrize("export_format", ["csv", "ld"])
def test_of_a_session_with_everything_in_it(export_format: str, recorder: Recorder, stream, monkeypatch) -> None:
    monkeypatch.setattr("app.sessions.recording.recorder.MAP_HASH", bytes.fromhex(FIRST_MAP))  # as it was then
    assert digest(record_eventful(recorder, stream), export_format) == DIGESTS["eventful", export_format]


def record_eventful(recorder: Recorder, stream) -> Path:
    """Two stored chunks and a tail; windows that cut fields, silence with CAN in it, a reboot, missing values."""
    info = recorder.start("eventful", {"driver": "Anna", "filled": [[10.0, 12.5]]})
    image = bytearray(CONFIG_SIZE)
    FIELDS["conf.ts"].pack_into(image, (100,))
    recorder.config(MONO_NS, WALL_NS, bytes(image), "read")
    stream.feed(recorder, 650)
    recorder.flush()
    for windows in (((1896, 101),), ((1996, 92), (1884, 12)), ((2500, 200),), ((0, 420),)):
        recorder.frame(*stream.next(windows)[:2], 0, stream.next(windows)[2], True)
    silent_ns = stream.count * 10**8
    stream.skip(150)
    for i in range(100):
        at_ns = silent_ns + i * 10**8
        recorder.can_frame(MONO_NS + at_ns, WALL_NS + at_ns, 0x100, bytes.fromhex("281e9087e80300") + bytes([i]))
    stream.uptime_ms = 0
    for i in range(600):
        uptime_ms = stream.uptime_ms
        t_mono_ns, t_wall_ns, raw = stream.next()
        recorder.frame(t_mono_ns, t_wall_ns, 0, raw, True)
        if i % 70 == 1:
            recorder.flush()
        sigma = np.where(np.arange(96) % 7 == i % 7, np.nan, 0.01)
        recorder.estimates(t_mono_ns + 3_000_000, uptime_ms, np.linspace(0.9, 0.8, 96) - i * 1e-4, sigma)
    recorder.flush()
    return info.path
