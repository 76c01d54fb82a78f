"""Batteries of other teams served live: a foxBMS of 216 cells and an Orion of 72 on a real python-can bus."""

import httpx
import numpy as np
import pytest

from app.battery.library import load_profile
from tests.battery_bus import SendingBus
from tests.battery_folder import write_profile
from tests.peer_batteries import cell_number, segments_in_fd_frames
from tests.service_process import WAIT_S, Service, until

FOX_CELLS, FOX_SENSORS = 216, 180


def fox_voltage_mv(cell):
    return 3600 + cell


def fox_frames(seconds=4):
    """foxBMS 2 with its default ids, packed by cantools: 54 frames of four voltages, 30 of six temperatures."""
    database = pytest.importorskip("cantools").database.load_file(load_profile("foxbms-2").dbc_files[0])
    found = []

    def send(at_s, name, **values):
        message = database.get_message_by_name(name)
        given = {signal.name: 0 for signal in message.signals} | values
        found.append((round(at_s * 1e9), message.frame_id, message.encode(given)))

    for turn in range(seconds * 10):
        at_s, current_a = turn * 0.1, (0.0, 40.0)[turn // 10 % 2]
        for group in range(FOX_CELLS // 4):
            volts = {f"Voltage_{k}": round(fox_voltage_mv(4 * group + k) - current_a) for k in range(4)}
            send(at_s + group * 1e-3, "CellVoltages", Group=group, **volts)
        for group in range(FOX_SENSORS // 6):
            send(
                at_s + 0.06 + group * 1e-3,
                "CellTemperatures",
                Group=group,
                **{f"Temperature_{k}": 25 + k for k in range(6)},
            )
        total_v = sum(fox_voltage_mv(cell) - current_a for cell in range(FOX_CELLS)) / 1000
        send(at_s + 0.055, "PackValues", BatteryVoltage=total_v, BusVoltage=total_v, Current=current_a)
        send(at_s + 0.056, "PackLimits", MaximumDischargeCurrent=200, MaximumChargeCurrent=100)
        send(at_s + 0.057, "PackStateEstimation", MinimumSoc=55.0)
        send(at_s + 0.058, "BmsState", State=7)
    return found


@pytest.fixture(scope="module")
def fox(tmp_path_factory):
    bus = SendingBus(fox_frames())
    service = Service(tmp_path_factory.mktemp("fox"), ["--battery", "foxbms-2", "--can", bus.url]).start()
    yield service
    service.stop()
    bus.close()


def all_there(snapshot):
    accumulator, cells = snapshot["accumulator"], snapshot["cells"]
    told = accumulator["loaded_cells"] == FOX_CELLS and accumulator["temperature_max_degc"] == 30
    return told and accumulator["soc_source"] == "filter" and max(cells["voltage_age_s"]) < 1.0


def test_every_cell_of_a_foxbms_is_live_with_its_estimate(fox):
    snapshot = fox.wait_for(all_there)
    volts = np.array(snapshot["cells"]["voltage_v"])
    spoken = np.array([fox_voltage_mv(cell) for cell in range(FOX_CELLS)]) / 1000
    assert np.abs(volts - spoken).max() <= 0.041  # the load pulls all of them down by 40 mV
    assert all(soc is not None for soc in snapshot["cells"]["soc"])
    assert [len(snapshot["cells"][name]) for name in ("soc", "temperature_degc")] == [FOX_CELLS] * 2
    assert len(snapshot["packs"]) == 12


def test_what_a_dbc_does_not_tell_is_missing_and_not_zero(fox):
    snapshot = fox.wait_for(all_there)
    master = snapshot["master"]
    assert [master[name] for name in ("firmware", "n_slaves", "boots", "map_matches")] == [None] * 4
    assert snapshot["links"]["rs232"]["state"] != "lost"
    assert snapshot["config_hash"] is None
    assert {pack["slave_status"] for pack in snapshot["packs"]} == {None}


def test_limits_that_signals_carry_are_in_force(fox):
    fox.wait_for(all_there)
    with fox.client() as client:
        battery = client.get("/battery").json()
    assert battery["limits"]["discharge_current_max_a"] == 200
    assert battery["limits"]["charge_current_max_a"] == 100
    assert battery["limits"]["cell_voltage_max_v"] is None


def test_history_metrics_and_the_monitor_know_all_cells_by_segment(fox):
    fox.wait_for(all_there)
    with fox.client() as client:
        until(lambda: len(client.get("/history", params={"cell": 215}).json()["time"]) > 3)
        named = {frame["name"] for frame in client.get("/can/trace").json()["by_id"]}
    assert "CellVoltages" in named
    metrics = httpx.get(fox.base_url + "/metrics", timeout=WAIT_S).text
    assert 'voltwall_cell_volts{cell="18",pack="12"}' in metrics
    assert metrics.count("voltwall_cell_volts{") == FOX_CELLS


def test_the_service_of_a_foxbms_is_well_and_records(fox):
    fox.wait_for(all_there)
    with fox.client() as client:
        until(lambda: client.get("/health").json()["status"] == "ok")
        until(lambda: fox.wait_for(all_there)["recording"] is not None)


@pytest.fixture
def orion(tmp_path):
    peer = cell_number()  # one cell every 100 ms
    limits = "cell_voltage_min_v = 2.8\ncell_voltage_max_v = 3.7\n"
    profile = write_profile(tmp_path, peer, (12,) * 6, limits, voltage="Pack_Inst_Voltage")
    bus = SendingBus(peer.frames(8))
    service = Service(tmp_path / "data", ["--battery", str(profile), "--can", bus.url]).start()
    yield service, bus
    service.stop()
    bus.close()


def test_cells_told_one_by_one_have_their_own_ages_alarms_and_an_end(orion):
    service, bus = orion
    snapshot = service.wait_for(lambda s: s["accumulator"]["loaded_cells"] == 72)
    assert max(snapshot["cells"]["voltage_age_s"]) > 3.0
    assert snapshot["age"]["voltage"] < 1.0
    # a limit of the profile alone, and no signal for a state
    snapshot = service.wait_for(lambda s: any(alarm["code"] == "cell-overvoltage" for alarm in s["alarms"]))
    assert snapshot["master"]["state"] == "unknown"
    bus.fall_silent()
    snapshot = service.wait_for(lambda s: s["accumulator"]["current_a"] is None)
    assert snapshot["age"]["voltage"] > 0.5
    service.wait_for(lambda s: any(alarm["code"] == "can-silent" for alarm in s["alarms"]))


def test_cells_in_frames_of_can_fd_are_live(tmp_path):
    peer = segments_in_fd_frames()
    profile = write_profile(tmp_path, peer, peer.segments, voltage="TS_Voltage")
    text = profile.read_text(encoding="utf-8").replace("Pack_Current", "TS_Current").replace("Pack_SOC", "SOC")
    profile.write_text(text, encoding="utf-8")
    bus = SendingBus(peer.frames(3))
    service = Service(tmp_path / "data", ["--battery", str(profile), "--can", bus.url]).start()
    try:
        snapshot = service.wait_for(
            lambda s: s["accumulator"]["loaded_cells"] == 140 and s["accumulator"]["current_a"] is not None
        )
        assert len(snapshot["packs"]) == 5
    finally:
        service.stop()
        bus.close()
