"""Every command that works for long says how far it is and how long it still takes, on a terminal."""

import io
import re
from collections.abc import Container
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from app.cli import main
from app.commands.cell_table import write_table
from app.estimation.cell_model.cell_file import load_cell
from app.sessions.recording.recorder import Recorder
from app.sources.recordings import can_log
from firmware_protocol.framing import encode_frame
from firmware_protocol.memory_map import FIELDS
from firmware_protocol.messages import Data, Window
from tests.fake_clock import FunctionClock
from tests.open_loop import simulate
from tests.peer_batteries import one_signal_a_cell

CELL = load_cell("samsung-25r-10p")
WALL_NS = 1_790_000_000 * 10**9


class Terminal(io.StringIO):
    """Standard error that is a terminal."""

    def isatty(self) -> bool:
        return True


def run(*words: str | Path) -> str:
    """What a command shows on a terminal that is told of every step, however short."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("app.commands.console.SHOWN_AFTER_S", 0.0)
        patched.setattr("app.commands.console.EVERY_S", 0.0)
        terminal = Terminal()
        patched.setattr("sys.stderr", terminal)
        assert main([str(word) for word in words]) == 0
    return terminal.getvalue()


def shares(shown: str) -> list[float]:
    """The per cents that were shown; each with a time left, and none left standing."""
    assert f"\r{'':<60}\r" in shown[shown.rindex(" %, ") :]
    return [float(each) for each in re.findall(r"([0-9.]+) %, \d+ (?:s|min) left", shown)]


def recordings(folder: Path, *received: Container[int]) -> list[Path]:
    """A session each of three minutes, with a current and 96 voltages ten times a second where it was received."""
    now_ns = 0
    recorder = Recorder(folder / "sessions", FunctionClock(lambda: now_ns, lambda: WALL_NS + now_ns), version="1.0")
    made = []
    for steps in received:
        made.append(recorder.start("", {}).path)
        for k in range(1800):
            now_ns += 100_000_000
            current = Window(FIELDS["i_fs"].offset, (3000).to_bytes(4, "little"))
            cells = Window(FIELDS["v"].offset, (37000 + k).to_bytes(2, "little") * 96)
            body = Data((current, cells)).to_body()
            if k in steps:
                recorder.frame(now_ns, WALL_NS + now_ns, 0, encode_frame(1, k % 256, k * 100, body)[1:-1], True)
        recorder.flush()
        recorder.stop()
    recorder.close()
    return made


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two sessions."""
    folder = tmp_path_factory.mktemp("data")
    recordings(folder, range(1800), range(1800))
    return folder


@pytest.mark.parametrize(
    "words",
    [
        ["check"],
        ["check", "ID", "--repair", "OUT"],
        ["report", "ID"],
        ["laps", "ID"],
        ["compare", "ID", "--with", "OTHER"],
    ],
    ids=" ".join,
)
def test_a_look_at_sessions_tells_how_far_it_is(data: Path, tmp_path: Path, words: list[str]) -> None:
    first, other = sorted(path.stem for path in (data / "sessions").glob("*.sqlite"))
    named = {"ID": first, "OTHER": other, "OUT": str(tmp_path / "out.sqlite")}
    found = shares(run("sessions", *(named.get(word, word) for word in words), "--data", data))
    assert found
    if words[0] != "compare":  # two sessions of a line each
        assert all(low <= high for low, high in pairwise(found))
        assert found[-1] >= 99.0


def test_the_filter_along_a_recording_tells_how_far_it_is(tmp_path: Path) -> None:
    time_s = np.arange(2000.0)
    _, voltage_v = simulate(CELL, time_s, np.full(2000, 5.0), np.full(2000, 25.0), 0.9)
    write_table(tmp_path / "drive.csv", {"time_s": time_s, "current_a": np.full(2000, 5.0), "voltage_v": voltage_v})
    assert shares(run("estimate", tmp_path / "drive.csv", "--cell", "samsung-25r-10p"))[-1] == 100.0


def test_an_identification_tells_its_rounds(tmp_path: Path) -> None:
    def write(name: str, steps: list[tuple[float, float]], step_s: float) -> Path:
        current = np.concatenate([np.full(round(s / step_s), c * CELL.capacity_ah) for c, s in steps])
        time_s, heat = step_s * np.arange(current.size), np.full(current.size, 25.0)
        soc, voltage = simulate(CELL, time_s, current, heat, 0.999)
        write_table(tmp_path / name, {"time_s": time_s, "current_a": current, "voltage_v": voltage, "soc": soc})
        return tmp_path / name

    slow = write("slow.csv", [(0, 600), (0.05, 71_640), (0, 3600)], 60.0)
    pulses = write("pulses.csv", [(0, 30), *[(4, 10), (0, 120), (1, 350), (0, 300)] * 8], 1.0)
    out = tmp_path / "cell.toml"
    shown = run("identify", "--ocv", slow, "--pulses", pulses, "--rc", "1", "--out", out)
    assert shares(shown) == [25.0, 50.0, 75.0, 100.0]


def test_filling_a_session_tells_how_far_it_is(tmp_path: Path) -> None:
    here, there = recordings(tmp_path, {*range(1800)} - {*range(600, 900)}, range(1800))
    found = shares(run("sessions", "fill", here, "--from", there, "--data", tmp_path))
    assert found[0] < 10.0  # end of reading, before writing
    assert all(low <= high for low, high in pairwise(found))
    assert found[-1] >= 99.0


def test_learning_and_checking_a_battery_tell_how_far_the_log_is_read(tmp_path: Path) -> None:
    peer = one_signal_a_cell(90, 45, "Voltage_Cell_{:02d}", "Temp_Sensor_{:02d}", 0.0001, "V")
    dbc, log, out = (tmp_path / name for name in ("car.dbc", "car.log", "car.toml"))
    dbc.write_text(peer.dbc())
    lines = [f"({t / 1e9:.6f}) can0 {i:03X}#{data.hex().upper()}" for t, i, data in peer.frames(6)]
    log.write_text("\n".join(lines) + "\n")
    for words in (["learn", "--dbc", dbc, "--log", log, "--out", out], ["check", out, "--log", log]):
        assert shares(run("battery", *words))[-1] == 100.0


def test_balancing_tells_its_charges_and_rests_as_one() -> None:
    for words in (["--rest", "--until", "0.9"], ["--rate", "1.0", "--hours", "0.3"]):
        found = shares(run("balance", "--thesis", "--circuit", "none", "--circuit", "passive", "--json", *words))
        assert all(low <= high for low, high in pairwise(found))
        assert min(found) < 50.0 < max(found) <= 100.0


def test_an_import_of_a_table_tells_how_far_it_is_read_and_written(tmp_path: Path) -> None:
    time_s = np.arange(12_000) / 10.0
    columns = {"time_s": time_s, "current_a": 5.0 + 0.0 * time_s, "voltage_v": 3.9 - 1e-5 * time_s}
    write_table(tmp_path / "drive.csv", columns)
    lines = (tmp_path / "drive.csv").read_text().splitlines()
    (tmp_path / "words.csv").write_text("\n".join([*lines[:9000], "a row,broken", *lines[9000:]]) + "\n")
    for name in ("drive.csv", "words.csv"):
        found = shares(run("sessions", "import", tmp_path / name, "--set", "max_rate_hz=0.1", "--data", tmp_path))
        assert {share for share in found if 0.0 < share < 2.0}  # rows read, of which writing follows
        assert max(found) == 100.0
        if name == "drive.csv":  # the other is read again, row by row
            assert all(low <= high for low, high in pairwise(found))


def test_an_import_by_a_dbc_tells_how_far_the_log_is_decoded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    peer = one_signal_a_cell(90, 45, "Voltage_Cell_{:02d}", "Temp_Sensor_{:02d}", 0.0001, "V")
    dbc, log = tmp_path / "car.dbc", tmp_path / "car.log"
    dbc.write_text(peer.dbc())
    lines = [f"({t / 1e9:.6f}) can0 {i:03X}#{data.hex().upper()}" for t, i, data in peer.frames(6)]
    log.write_text("\n".join(lines) + "\n")
    monkeypatch.setattr(can_log, "_READ_AT_ONCE", 1 << 12)
    names = ["time=time", "voltages=Voltage_Cell_{n}", "current=Pack_Current"]
    words = [word for name in names for word in ("--set", name)]
    found = shares(run("sessions", "import", log, "--dbc", dbc, *words, "--data", tmp_path))
    assert all(low <= high for low, high in pairwise(found))
    assert {share for share in found if 10.0 < share <= 20.0}
    assert found[-1] == 100.0
