"""A recorded session becomes a scenario: recorded, exported by the command, replayed into the physics."""

from pathlib import Path

import numpy as np
import pytest

from app.cli import main
from app.sessions.recording.recorder import Recorder
from firmware_protocol.framing import Frame, FrameDecoder
from simulator.library import find_scenario
from simulator.scenario_file import load_scenario
from simulator.scenario_player import ScenarioPlayer
from tests.fake_clock import FunctionClock

WALL_NS = 1_790_000_000 * 10**9
STANDBY_S = 5.0
DRIVEN_S = 60.0
DRIVE = f"""
title = "drive"
description = "Drives."
seed = 5
[start]
soc = 0.8
ambient_degc = 31
[[phase]]
load = "idle"
for_s = {STANDBY_S}
[[phase]]
load = "pattern"
pattern = "hard"
for_s = {DRIVEN_S}
"""


def soc_after_the_drive(player: ScenarioPlayer) -> np.ndarray:
    player.run(STANDBY_S + DRIVEN_S - 1.0 - player.simulation.now_s)
    return player.simulation.accumulator.soc.copy()


@pytest.fixture
def driven(tmp_path: Path) -> tuple[str, np.ndarray]:
    """Record a drive; return the session's id and the cells' states of charge at its end."""
    (tmp_path / "drive.toml").write_text(DRIVE)
    player = ScenarioPlayer(load_scenario(tmp_path / "drive.toml"), step_s=0.05)
    simulation, decoder = player.simulation, FrameDecoder()
    recorder = Recorder(tmp_path / "data" / "sessions", FunctionClock(lambda: 0, lambda: WALL_NS), version="1.0")

    def record(data: bytes) -> None:
        at_ns = round(simulation.now_s * 1e9)
        for item in decoder.feed(data):
            recorder.frame(at_ns, WALL_NS + at_ns, 0, item.raw, isinstance(item, Frame))

    player.run(STANDBY_S)
    simulation.serial_out = record
    session = recorder.start("drive", {})
    simulation.receive(b"x")
    soc = soc_after_the_drive(player)
    recorder.close()
    return session.id, soc


def test_a_session_replayed_as_a_scenario_draws_the_same_charge_from_the_same_cells_in_the_same_air(driven, tmp_path):
    session_id, soc = driven
    out = tmp_path / "drive.csv"
    signals = [word for name in ("i_fc", "t_min", "soc") for word in ("--signal", name)]
    assert main(["export", session_id, "--data", str(tmp_path / "data"), "--out", str(out), *signals]) == 0
    again = ScenarioPlayer(find_scenario(str(out)), step_s=0.05)
    start = again.simulation.accumulator.soc.copy()
    assert start.mean() == pytest.approx(0.8, abs=0.02)
    drawn = start.mean() - soc_after_the_drive(again).mean()
    assert drawn > 0.005
    assert drawn == pytest.approx(0.8 - soc.mean(), rel=0.05)
    assert again.simulation.accumulator.ambient_degc == pytest.approx(31, abs=1)
