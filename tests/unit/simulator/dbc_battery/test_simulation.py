import numpy as np
import pytest

from firmware_protocol.messages import CommandId
from simulator.errors import FaultError
from simulator.fault_kinds import FAULTS, Target
from simulator.faults import FaultBoard


def test_what_is_read_is_what_is_true_but_for_the_sensors_errors(rig):
    rig.draw(10.0)
    rig.run(20.0)
    accumulator, read = rig.simulation.accumulator, rig.voice.last
    np.testing.assert_allclose(read("voltage"), accumulator.terminal_voltage_v, atol=3e-3)
    assert read("current")[0] == pytest.approx(10.0, abs=0.8)
    assert read("soc")[0] == pytest.approx(float(accumulator.soc.mean()), abs=0.02)
    assert read("pack_voltage")[0] == pytest.approx(float(accumulator.terminal_voltage_v.sum()), abs=0.1)
    sensors = [accumulator.temperature_degc[i * 5 : i * 5 + 5].mean() for i in range(6)]
    np.testing.assert_allclose(read("temperature")[:6], sensors, atol=0.5)


def test_relays_close_by_pre_charge_when_the_car_asks(rig):
    rig.run(1.0)
    assert not rig.voice.last("state.closed")[0]
    rig.draw(5.0)
    rig.run(5.0)
    states = [received["state.precharge"][0] for _, received in rig.voice.received]
    assert 1.0 in states
    assert rig.voice.last("state.closed")[0] == 1.0
    assert rig.simulation.current_a == pytest.approx(5.0)


def test_a_cell_has_the_resistance_of_its_size(make_rig):
    small, large = make_rig(capacity_ah=2.5), make_rig(capacity_ah=25.0)
    drops = []
    for rig in (small, large):
        before = rig.simulation.accumulator.terminal_voltage_v.mean()
        rig.draw(10.0)
        rig.run(3.0)
        drops.append(before - rig.simulation.accumulator.terminal_voltage_v.mean())
    assert 7 < drops[0] / drops[1] < 11  # the law of charge transfer is flatter at high currents


def test_charging_ends_full_and_below_the_limit(make_rig):
    rig = make_rig(soc=0.97)
    rig.simulation.charger.is_plugged = True
    rig.run(1.0)
    rig.simulation.bms.command(CommandId.CHARGE_START, 0, rig.simulation.now_s)
    for _ in range(60):
        rig.run(60.0)
        if not rig.simulation.bms.charging.is_active:
            break
    assert rig.simulation.bms.charging.state.name == "DONE"
    assert not rig.voice.last("state.fault")[0]
    assert max(received["voltage"].max() for _, received in rig.voice.received) < 4.2
    assert rig.voice.last("voltage").max() == pytest.approx(4.15, abs=0.015)


@pytest.mark.parametrize("name", [name for name, kind in FAULTS.items() if kind.is_of_team])
def test_a_fault_of_the_teams_own_master_is_refused_by_its_name(rig, name):
    with pytest.raises(FaultError, match=f"{name}.*only the team's own"):
        FaultBoard(rig.simulation).inject(name)


@pytest.mark.parametrize("name", [name for name, kind in FAULTS.items() if not kind.is_of_team])
def test_every_other_fault_is_injected_run_and_cleared(rig, name):
    faults = FaultBoard(rig.simulation)
    rig.draw(5.0)
    rig.run(2.0)
    faults.inject(name, {Target.CELL: 19, Target.PACK: 2, Target.NONE: 0}[FAULTS[name].target])
    rig.run(3.0)
    faults.clear_all()
    rig.run(2.0)


def test_a_target_beyond_the_battery_is_refused(rig):
    faults = FaultBoard(rig.simulation)
    with pytest.raises(FaultError, match=r"outside 0\.\.29"):
        faults.inject("joint-resistance-high", 30)
    with pytest.raises(FaultError, match=r"outside 0\.\.2"):
        faults.inject("slave-lost", 3)


def test_an_open_wire_takes_the_voltages_of_both_its_neighbours_in_the_pack(rig):
    rig.run(1.0)
    faults = FaultBoard(rig.simulation)
    faults.inject("sense-wire-open", 3)
    faults.inject("sense-wire-open", 19)  # the last one of its pack
    rig.run(0.3)
    assert np.flatnonzero(np.isnan(rig.voice.last("voltage"))).tolist() == [3, 4, 19]
    rig.run(2.0)
    assert rig.voice.last("state.fault")[0] == 1.0


def test_a_lost_board_takes_the_voltages_and_sensors_of_its_pack(rig):
    rig.run(1.0)
    FaultBoard(rig.simulation).inject("slave-lost", 1)
    rig.run(0.3)
    assert np.flatnonzero(np.isnan(rig.voice.last("voltage"))).tolist() == list(range(14, 20))
    assert np.isnan(rig.voice.last("temperature")).tolist() == [False, False, True, True, False, False, False]


def test_a_sensor_that_is_stuck_or_off_says_so_for_all_its_cells(rig):
    faults = FaultBoard(rig.simulation)
    faults.inject("temperature-sensor-fault", 7, 55.0)
    faults.inject("temperature-sensor-open", 22)
    rig.run(1.0)
    degc = rig.voice.last("temperature")
    assert degc[1] == 55.0
    assert np.isnan(degc[4])
    assert np.isfinite(np.delete(degc, 4)).all()


def test_a_bms_without_power_is_silent_and_comes_back(rig):
    rig.run(2.0)
    FaultBoard(rig.simulation).inject("master-supply-lost", 0, 1.5)
    n = len(rig.voice.received)
    rig.run(1.4)
    assert len(rig.voice.received) == n
    rig.run(1.0)
    assert len(rig.voice.received) > n


def test_a_trip_opens_the_relays_and_stays_until_it_is_cleared(make_rig):
    rig = make_rig(limits={"cell_voltage_max_v": 4.0})
    rig.draw(5.0)
    rig.run(3.0)
    faults = FaultBoard(rig.simulation)
    faults.inject("cell-voltage-stuck", 8, 4.1)
    rig.run(1.0)
    assert rig.voice.last("state.fault")[0] == 1.0
    assert rig.voice.last("state.closed")[0] == 0.0
    assert not rig.simulation.bms.command(CommandId.CLEAR_FAULTS, 0, rig.simulation.now_s)
    faults.clear_all()
    rig.run(1.0)
    assert rig.voice.last("state.fault")[0] == 1.0
    assert rig.simulation.bms.command(CommandId.CLEAR_FAULTS, 0, rig.simulation.now_s)
    rig.run(1.0)
    assert rig.voice.last("state.fault")[0] == 0.0


def test_balancing_brings_the_cells_together(make_rig):
    rig = make_rig(capacity_ah=0.5)  # so that it does not take hours
    faults = FaultBoard(rig.simulation)
    rig.run(2.0)
    soc = rig.simulation.accumulator.soc
    faults.inject("self-discharge-high", 5, 1.0)  # one cell loses a few percent
    rig.run(60.0)
    faults.clear_all()
    rig.run(60.0)
    spread = np.ptp(soc)
    assert rig.simulation.bms.command(CommandId.BALANCE_START, 0, rig.simulation.now_s)
    rig.run(60.0)
    assert rig.voice.last("state.balancing")[0] == 1.0
    assert rig.voice.last("balancing")[5] == 0.0
    assert np.ptp(soc) < spread
