"""foxBMS 2 with 216 cells, simulated on a bus of its own and served: what is shown, alarms, the recording."""

import json

import numpy as np
import pytest

from app.commands.simulate import simulated
from app.sources.loaded_battery import load_battery
from simulator.library import find_scenario
from simulator.scenario_player import ScenarioPlayer
from tests.service_process import until

RESOLUTION_V = 0.001  # resolution in the DBC
NOISE_V = 0.0006  # noise of the simulated inputs
PROFILE = """\
include = ["foxbms-2"]
[battery]
name = "foxBMS with limits"
[battery.limits]
cell_voltage_max_v = 4.2
cell_voltage_min_v = 2.5
"""
AT_REST = """\
title = "at rest"
description = "Nothing happens."
seed = 11
[start]
soc = 0.62
soc_spread = 0.01
[[phase]]
load = "rest"
"""


@pytest.fixture
def files(tmp_path):
    (tmp_path / "fox.toml").write_text(PROFILE)
    (tmp_path / "rest.toml").write_text(AT_REST)
    return tmp_path


def test_a_simulated_foxbms_is_shown_judged_recorded_and_replayed(make_service, voltwall, files):
    profile, scenario = str(files / "fox.toml"), str(files / "rest.toml")
    service = make_service("--battery", profile, "--scenario", scenario)
    loaded = load_battery(profile)
    twin = simulated(loaded, loaded.dbc_mapping)
    player = ScenarioPlayer(find_scenario(scenario, twin.shape), battery=twin)
    player.run(2.0)
    expected = player.simulation.board.voltage_v

    shown = service.wait_for(lambda s: None not in s["cells"]["voltage_v"])
    assert len(expected) == 216
    np.testing.assert_allclose(shown["cells"]["voltage_v"], expected, atol=RESOLUTION_V / 2 + NOISE_V)
    with service.client() as client:
        assert client.get("/battery").json()["segments"] == [18] * 12
        over_rest = client.get("/snapshot").json()
        np.testing.assert_allclose(over_rest["cells"]["voltage_v"], expected, atol=RESOLUTION_V / 2 + NOISE_V)
        faults = {fault["name"] for fault in client.get("/simulator").json()["faults"]}
        assert "joint-resistance-high" in faults
        assert "serial-noise" not in faults
        stuck = {"fault": "cell-voltage-stuck", "pack": 12, "cell": 18, "value": 4.3}
        assert client.post("/simulator/faults", json=stuck).status_code == 201
    over = service.wait_for(lambda s: is_told(s["alarms"], 215))
    assert over["cells"]["voltage_v"][215] == pytest.approx(4.3, abs=0.003)
    service.wait_for(lambda s: s["master"]["state"] == "fault")
    service.wait_for(lambda s: s["time"] > over["time"] + 3.0)  # a recording that goes on after the alarm

    with service.client() as client:
        session = client.get("/sessions").json()["sessions"][0]["id"]
        assert client.post(f"/sessions/{session}/stop").is_success
        until(lambda: not client.get("/snapshot").json()["recording"])
    assert service.stop() == 0
    run = voltwall("replay", session, "--json", "--data", str(service.data))
    assert run.returncode == 0, run.stderr
    replayed = [json.loads(line) for line in run.stdout.splitlines()]
    whole = [s for s in replayed if None not in s["cells"]["voltage_v"]]
    np.testing.assert_allclose(whole[0]["cells"]["voltage_v"], expected, atol=RESOLUTION_V / 2 + NOISE_V)
    assert any(is_told(s["alarms"], 215) for s in replayed)


def is_told(alarms, cell):
    return any(cell in (alarm.get("cells") or [alarm.get("cell")]) for alarm in alarms)
