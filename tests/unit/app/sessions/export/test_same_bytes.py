"""Exports are, byte for byte, those of the version before sessions were read through one block iterator (0.1.0).

But for `v_min`, `v_avg` and `v_tot` of no cell, which were 0 V and are empty.
"""

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
    ("session_1", "csv"): "bb2ed5f5b0fa5c0f4fd7568ab7d46aca241c2e48b5e07932a746b9e3b304beeb",
    ("session_1", "ld"): "6f111611f9687cb3961e6b0b73120b689628506958c50f5eecab6c04bd5b3a7d",
    ("session_2", "csv"): "bb2ed5f5b0fa5c0f4fd7568ab7d46aca241c2e48b5e07932a746b9e3b304beeb",
    ("session_2", "ld"): "591f5bc7a438f94329f663f7d780c332dd2217caf876b644af2e5d782aee3f30",
    ("eventful", "csv"): "0eb2b3a99010257bd6b8d1275994b81b3cb56227af15a846063e2125688f353d",
    ("eventful", "ld"): "e9f507548c27da74e28c8fb19932af1579766ce5c0654208875e7d0c8d8aa5b0",
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
