"""Simulated batteries on a real python-can bus, received by the live source."""

import time
from pathlib import Path

import can
import numpy as np
import pytest

from app.commands.simulate import simulated
from app.sources.dbc.source import DbcSource
from app.sources.items import CanItem
from app.sources.loaded_battery import load_battery
from firmware_protocol.memory_map import CAN_ID_EXTENDED
from simulator.can_ports import can_port
from simulator.library import find_scenario
from simulator.runner import Runner
from simulator.scenario_player import ScenarioPlayer
from tests.peer_batteries import alternating_fd

ROUND_S = {"orion-bms-2": 40.0}


@pytest.fixture
def fd_profile(tmp_path: Path) -> str:
    peer = alternating_fd()
    (tmp_path / "fd.dbc").write_text(peer.dbc())
    (tmp_path / "fd.toml").write_text(
        '[battery]\nname = "160 cells, FD"\nsegments = [32, 32, 32, 32, 32]\n[source]\ndbc = "fd.dbc"\n'
        f'[source.current]\nsignal = "Pack_Current"\n[source.pack_voltage]\nsignal = "BMS_PackStatus.Pack_Voltage"\n'
        f"{peer.profile}"
    )
    return str(tmp_path / "fd.toml")


@pytest.mark.parametrize("name", ["foxbms-2", "one-signal-a-cell", "orion-bms-2", "fd"])
def test_the_live_source_measures_what_the_simulated_battery_is(name, fd_profile, request):
    loaded = load_battery(fd_profile if name == "fd" else name)
    battery = simulated(loaded, loaded.dbc_mapping)
    player = ScenarioPlayer(find_scenario("clean-endurance", battery.shape), battery=battery)
    channel = f"{request.node.name}-{time.monotonic_ns()}"
    port = can_port(f"virtual:{channel}")
    runner = Runner(player.simulation, can=[port], speed=None)
    runner.open()
    source = DbcSource(loaded.battery, loaded.source, loaded.definitions)
    newest = None
    with can.Bus(interface="virtual", channel=channel) as listener:
        for _ in range(round(ROUND_S.get(name, 8.0) / 0.1)):
            runner.run(0.1)
            now_ns = round(player.simulation.now_s * 1e9)
            while (message := listener.recv(0)) is not None:
                can_id = message.arbitration_id | (CAN_ID_EXTENDED if message.is_extended_id else 0)
                assert message.is_fd == (len(message.data) > 8)
                found = source.feed(CanItem(now_ns, now_ns, can_id, bytes(message.data)))
                newest = found.measurement or newest
    runner.close()
    accumulator = player.simulation.accumulator
    assert newest is not None
    assert np.isfinite(newest.voltage_v).all()
    drive = 0.4 if name == "orion-bms-2" else 0.2  # what the load moves a cell's voltage by while the others are told
    np.testing.assert_allclose(newest.voltage_v, accumulator.terminal_voltage_v, atol=drive)
    if loaded.battery.n_sensors:
        np.testing.assert_allclose(newest.temperature_degc, accumulator.temperature_degc, atol=1.6)
    if name != "orion-bms-2":
        assert newest.reported.voltage_v == pytest.approx(accumulator.voltage_v, rel=0.02)


def test_a_fault_that_the_battery_cannot_have_is_refused_with_the_scenario_that_has_it(capsys):
    from app.cli import main

    assert main(["simulate", "--battery", "foxbms-2", "--scenario", "isospi-noise", "--can", "log:/dev/null"]) == 2
    assert "isospi-noise" in capsys.readouterr().err
