from dataclasses import replace

import numpy as np
import pytest

from firmware_protocol.can_tables import rx_messages, with_rx_messages
from firmware_protocol.framing import LINE_BYTES_PER_S
from firmware_protocol.memory_map import FIELDS, T_MISSING
from firmware_protocol.messages import (
    Command,
    CommandId,
    EventCode,
    MessageType,
    Result,
    Write,
)
from simulator.bms_state import ChargingState, RelayState
from simulator.faults import FaultBoard
from simulator.loads import ConstantCurrent, Rest
from tests.master_memory import FLAG


def start_driving(host, amps: float = 50.0) -> None:
    host.simulation.set_load(ConstantCurrent(amps))
    host.run(2.0)
    assert host.simulation.master.relay_state is RelayState.VEHICLE


def test_nothing_streams_before_x_and_after_y(host):
    host.run(1.0)
    assert {frame.type for frame in host.frames} == {MessageType.EVENT}
    host.simulation.receive(b"x")
    host.run(1.0)
    n_frames = len(host.frames)
    assert n_frames > 10
    host.simulation.receive(b"y")
    host.run(0.1)
    n_frames = len(host.frames)
    host.run(1.0)
    assert len(host.frames) == n_frames


def test_no_stretch_of_the_stream_is_faster_than_the_line(host):
    host.ask(Write(0, host.config(telemetry_period=20)))
    host.simulation.receive(b"x")
    host.arrivals.clear()
    host.run(5.0)
    times = np.array([time for time, _ in host.arrivals])
    sizes = np.array([size for _, size in host.arrivals])
    gaps = np.diff(times)
    assert (gaps >= sizes[1:] / LINE_BYTES_PER_S - 1e-9).all()
    assert sizes.sum() / 5.0 > 0.97 * LINE_BYTES_PER_S  # and none of it is wasted


def test_fast_frames_leave_every_period_and_slow_ones_fill_the_struct(host):
    host.simulation.receive(b"x")
    host.run(3.0)
    fast = [frame.uptime_ms for frame in host.frames if frame.type == MessageType.DATA and len(frame.body) > 300]
    assert set(np.diff(fast)) <= {99, 100, 101}
    image = host.memory.image
    steady = slice(0, 420), slice(440, 526), slice(2396, 2982)  # configuration, slave 0 to its cfgr, capacities
    assert all(host.image[part] == image[part] for part in steady)
    assert min(FIELDS["slave[7].cvr"].unpack(host.image)) > 30_000


def test_sequence_numbers_count_every_frame(host):
    host.simulation.receive(b"x")
    host.ask(Command(CommandId.SET_SOC, 5000))
    host.run(20.0)
    steps = {(b.sequence - a.sequence) & 0xFF for a, b in zip(host.frames, host.frames[1:], strict=False)}
    assert steps == {1}
    assert len(host.frames) > 256


def test_measured_values_are_within_the_hardware_s_errors(host):
    host.simulation.receive(b"x")
    start_driving(host)
    host.run(3.0)
    accumulator = host.simulation.accumulator
    v = np.array(FIELDS["v"].unpack(host.image)) * 1e-4
    t = np.array(FIELDS["t"].unpack(host.image))
    assert np.abs(v - accumulator.terminal_voltage_v).max() < 3e-3
    assert np.abs(t - accumulator.temperature_degc).max() <= 1.0
    assert host.value("i_fc") == pytest.approx(5_000, abs=150)
    assert host.value("v_tot") == pytest.approx(accumulator.voltage_v * 100, rel=1e-3)
    assert host.value("v_min") == min(FIELDS["v"].unpack(host.image))
    assert host.value("v_max_id") == int(v.argmax())
    assert host.value("n_slaves") == 8


def test_voltage_filter_weights_the_new_sample_by_alpha(host):
    host.ask(Write(0, host.config(v_alpha=0.1)))
    inputs = host.simulation.board.cell_inputs
    host.run(1.0)
    memory = host.memory
    before = int(memory.v[10])
    inputs.stuck_v[10] = 3.0
    inputs.faults_changed()
    host.run(0.02)
    assert int(memory.v[10]) - before == pytest.approx(0.1 * (30_000 - before), abs=3)
    host.run(2.0)
    assert int(memory.v[10]) == pytest.approx(30_000, abs=2)


def test_soc_starts_from_the_voltage_and_counts_the_current(host):
    memory = host.memory
    soc = FIELDS["soc"]
    assert soc.unpack(memory.image)[0] == pytest.approx(7000, abs=150)
    host.ask(Command(CommandId.SET_SOC, 6000))
    start_driving(host, amps=90.0)
    before = soc.unpack(memory.image)[0]
    host.run(60.0)
    drawn_ah = 90.0 * 60 / 3600
    assert before - soc.unpack(memory.image)[0] == pytest.approx(drawn_ah / 25 * 1e4, rel=0.03)


def test_a_trip_opens_the_relays_and_stays_until_cleared(host):
    start_driving(host)
    host.simulation.board.chain.set_powered(2, False)
    host.run(1.0)
    assert host.events[-1].code == EventCode.TRIP_SLAVE_LOST
    assert host.events[-1].cell == 24
    assert host.simulation.master.relay_state is RelayState.OPEN
    assert host.simulation.current_a == 0.0
    assert host.ask(Command(CommandId.CLEAR_FAULTS)).result == Result.NOT_NOW
    host.simulation.board.chain.set_powered(2, True)
    host.run(1.0)
    assert host.simulation.master.relay_state is RelayState.OPEN
    assert host.ask(Command(CommandId.CLEAR_FAULTS)).result == Result.DONE
    host.run(2.0)
    assert host.simulation.master.relay_state is RelayState.VEHICLE


@pytest.mark.parametrize("cause", ["master-watchdog-reset", "master-supply-lost"])
def test_a_trip_outlives_the_master_s_restart(host, cause):
    start_driving(host)
    faults = FaultBoard(host.simulation)
    faults.inject("temperature-sensor-fault", 5, 80)
    host.run(2.0)
    faults.clear("temperature-sensor-fault", 5)
    faults.inject(cause)
    host.run(4.0)
    assert host.simulation.board.boots == 2
    assert host.simulation.master.relay_state is RelayState.OPEN
    assert not host.memory.flags & FLAG["fit"]
    assert host.simulation.current_a == 0.0
    assert host.ask(Command(CommandId.CLEAR_FAULTS)).result == Result.DONE
    host.run(2.0)
    assert host.simulation.master.relay_state is RelayState.VEHICLE


def test_a_current_sensor_that_is_off_trips_whatever_the_limit(host):
    host.ask(Write(0, host.config(i_disc_max=320)))
    start_driving(host)
    FaultBoard(host.simulation).inject("current-sensor-open")
    host.run(0.7)
    trips = [code for event in host.events if (code := EventCode(event.code)).name.startswith("TRIP_")]
    assert trips == [EventCode.TRIP_SENSOR_LOST]
    assert host.simulation.master.relay_state is RelayState.OPEN


def test_a_current_that_passes_where_an_open_input_stands_does_not_trip(host):
    host.ask(Write(0, host.config(i_disc_max=320)))
    start_driving(host, 290.0)
    for amperes in (306.0, 308.0, 310.0, 312.0):
        host.simulation.set_load(ConstantCurrent(amperes))
        host.run(0.3)
    assert host.simulation.master.is_ok


def test_cells_of_a_lost_slave_are_missing_and_not_zero_volts_for_the_minimum(host):
    host.simulation.receive(b"x")
    host.simulation.board.chain.set_powered(7, False)
    host.run(2.0)
    assert set(FIELDS["v"].unpack(host.image)[84:]) == {0}
    assert set(FIELDS["t"].unpack(host.image)[84:]) == {T_MISSING}
    assert host.value("v_min") > 30_000
    assert host.value("t_min") > 0
    assert host.value("n_slaves") == 7
    assert FIELDS["slave[7].status"].unpack(host.image)[0] == 255
    assert EventCode.TRIP_V_MIN not in {event.code for event in host.events}


def test_charging_is_refused_while_driving_and_driving_while_charging(host):
    start_driving(host)
    assert host.ask(Command(CommandId.CHARGE_START)).result == Result.NOT_NOW
    assert host.ask(Command(CommandId.BALANCE_START)).result == Result.NOT_NOW
    assert host.ask(Command(CommandId.RESET)).result == Result.NOT_NOW
    host.simulation.set_load(Rest())
    host.simulation.charger.is_plugged = True
    host.run(1.0)
    assert host.ask(Command(CommandId.CHARGE_START)).result == Result.DONE
    host.run(20.0)
    assert host.simulation.master.relay_state is RelayState.CHARGER
    assert host.simulation.current_a < -4.0
    host.simulation.set_load(ConstantCurrent(50.0))
    host.run(2.0)
    assert host.simulation.master.relay_state is RelayState.CHARGER


def test_charging_stops_when_the_charger_is_pulled(host):
    host.simulation.charger.is_plugged = True
    host.run(1.0)
    host.ask(Command(CommandId.CHARGE_START))
    host.run(10.0)
    assert host.memory.flags & FLAG["charging"]
    host.simulation.charger.is_plugged = False
    host.run(7.0)
    assert not host.memory.flags & (FLAG["charging"] | FLAG["charger"])
    assert host.simulation.master.relay_state is RelayState.OPEN


def charge_by_can(host) -> None:
    host.ask(Write(0, with_rx_messages(host.config(), [replace(rx_messages(host.config())[0], charges=True)])))


def test_charging_begins_with_a_charger_on_can_and_ends_with_its_silence_where_configured(host):
    charge_by_can(host)
    host.simulation.charger.is_plugged = True
    host.run(10.0)
    assert host.memory.charger("state") == ChargingState.CONSTANT_CURRENT
    assert host.simulation.master.relay_state is RelayState.CHARGER
    host.ask(Command(CommandId.CHARGE_STOP))
    host.run(2.0)
    assert host.memory.charger("state") == ChargingState.OFF  # the charger is still received
    host.simulation.charger.is_plugged = False
    host.run(7.0)
    host.simulation.charger.is_plugged = True
    host.run(3.0)
    assert host.memory.flags & FLAG["charging"]
    host.simulation.charger.is_plugged = False
    host.run(7.0)
    assert host.memory.charger("state") == ChargingState.OFF  # no fault
    assert host.simulation.master.relay_state is RelayState.OPEN


def test_a_charger_that_is_heard_while_the_car_drives_begins_nothing(host):
    charge_by_can(host)
    start_driving(host)
    host.simulation.charger.is_plugged = True
    host.run(3.0)
    host.simulation.set_load(Rest())
    host.run(3.0)
    assert not host.memory.flags & FLAG["charging"]


def test_balancing_by_command_bleeds_high_cells_and_ends_by_itself(make_host):
    host = make_host(soc=0.7)
    host.ask(Write(0, host.config(balance_threshold=0.002)))
    host.run(1.0)
    host.ask(Command(CommandId.BALANCE_START))
    host.run(3.0)
    bled = host.simulation.board.chain.discharging
    voltages = host.simulation.accumulator.terminal_voltage_v
    assert bled.any()
    assert voltages[bled].min() > voltages.min() + 1e-3
    assert host.memory.flags & FLAG["balancing"]
    host.ask(Write(0, host.config(balance_threshold=0.2)))
    host.run(2.0)
    assert not host.simulation.board.chain.discharging.any()
    assert not host.memory.flags & FLAG["balancing"]


def test_cells_are_bled_by_hand_pack_by_pack(host):
    chosen = [3, 12 * 5 + 1, 12 * 5 + 11]
    assert host.ask(Command(CommandId.BALANCE_CELLS, 1 << 3)).result == Result.DONE
    assert host.ask(Command(CommandId.BALANCE_CELLS, 5 << 12 | 1 << 1 | 1 << 11)).result == Result.DONE
    host.run(2.0)
    assert list(np.flatnonzero(host.simulation.board.chain.discharging)) == chosen
    assert host.memory.flags & FLAG["balancing"]
    host.ask(Command(CommandId.BALANCE_CELLS, 5 << 12))
    host.run(2.0)
    assert list(np.flatnonzero(host.simulation.board.chain.discharging)) == [3]
    host.ask(Command(CommandId.BALANCE_STOP))
    host.run(2.0)
    assert not host.simulation.board.chain.discharging.any()


def test_the_count_starts_again_from_the_voltage_at_rest(host):
    host.ask(Command(CommandId.SET_SOC, 100))
    assert host.ask(Command(CommandId.SOC_FROM_OCV)).result == Result.DONE
    assert [event.value for event in host.events if event.code == EventCode.SOC_SET][-1] == pytest.approx(7000, abs=500)


def test_neither_is_done_while_the_car_drives(host):
    start_driving(host)
    assert host.ask(Command(CommandId.SOC_FROM_OCV)).result == Result.NOT_NOW
    assert host.ask(Command(CommandId.BALANCE_CELLS, 1)).result == Result.NOT_NOW


def test_fan_override_holds_until_given_back(host):
    host.ask(Command(CommandId.FAN_OVERRIDE, 200))
    host.run(0.1)
    assert host.memory.charger("fan_duty") == 200
    host.ask(Command(CommandId.FAN_OVERRIDE, -1))
    host.run(0.1)
    assert host.memory.charger("fan_duty") < 100


def test_a_reset_restores_the_count_from_the_journal(host):
    host.ask(Command(CommandId.SET_SOC, 4321))
    host.run(25.0)
    host.simulation.reset(cause=2)
    host.run(2.0)
    assert FIELDS["soc"].unpack(host.memory.image)[0] == pytest.approx(4321, abs=20)


def test_a_seed_repeats_a_run_to_the_last_byte(make_host):
    def played(seed: int) -> bytes:
        host = make_host(seed=seed)
        host.simulation.receive(b"x")
        host.simulation.set_load(ConstantCurrent(80.0))
        host.run(5.0)
        return b"".join(frame.raw for frame in host.frames)

    assert played(3) == played(3)
    assert played(3) != played(4)


def test_an_open_shutdown_circuit_opens_the_relays_without_a_trip_and_precharge_comes_again(host):
    start_driving(host)
    host.simulation.is_shutdown_open = True
    host.run(0.05)
    master = host.simulation.master
    assert (master.relay_state, host.simulation.current_a) == (RelayState.OPEN, 0.0)
    assert host.memory.flags & (FLAG["fit"] | FLAG["load"]) == FLAG["fit"]
    host.run(1.0)  # the link is discharged meanwhile
    host.simulation.is_shutdown_open = False
    host.run(0.5)
    assert master.relay_state is RelayState.PRECHARGE
    host.run(1.0)
    assert host.memory.flags & FLAG["load"]


def test_an_average_longer_than_a_pass_takes_the_samples_of_the_passes_before(host):
    host.ask(Write(0, host.config(fc_avg=1000)))
    start_driving(host, 100.0)
    host.run(2.0)
    host.simulation.set_load(ConstantCurrent(0.0))
    host.run(0.5)
    assert i_fc_a(host) == pytest.approx(50.0, abs=4.0)


def i_fc_a(host) -> float:
    return FIELDS["i_fc"].unpack(host.memory.image)[0] * 0.01
