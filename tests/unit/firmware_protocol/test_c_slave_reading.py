"""What the C driver of the slaves reads into the struct, and how long it takes on the pair."""

import ctypes

import numpy as np
import pytest

from firmware_protocol.ltc6804 import SENSOR_FIRST_DEGC, SENSOR_POINTS_V, SENSOR_STEP_DEGC, Command, decode_group
from firmware_protocol.memory_map import T_MISSING
from simulator.conversion import decode_conversion
from simulator.slave import CORE_WAKE_S, PORT_IDLE_S
from tests.c_programs import slaves_library
from tests.c_slaves import CReader, cells_of, load, started
from tests.ltc6804_packets import Configuration, StatusB, command_packet

CFGR_DEFAULT = bytes((0x05, 0x98, 0x46, 0xA4, 0x00, 0x10))  # B.8 of the BMS thesis
UPDATE_TIMING_US = (500, 4500, 1400, 100)  # B.8
CHECK_STAGES = 4
PASS_S = 0.02


@pytest.fixture(scope="module")
def library() -> ctypes.CDLL:
    return load(slaves_library("-fsanitize=undefined", "-fno-sanitize-recover=all"))


@pytest.fixture
def reader(library) -> CReader:
    reader = started(library)
    reader.chain.converters.cell_v = np.full(96, 3.7)
    curve_degc = SENSOR_FIRST_DEGC + SENSOR_STEP_DEGC * np.arange(len(SENSOR_POINTS_V))
    reader.chain.converters.sensor_v = np.interp(np.arange(-20, 76), curve_degc, SENSOR_POINTS_V)
    return reader


def read_temperatures(reader: CReader, now_s: float) -> list[int]:
    reader.begin(now_s)
    reader.read_temperatures()
    return reader.temperatures_degc()


def read_voltages(reader: CReader, now_s: float) -> int:
    reader.begin(now_s)
    return reader.read_voltages()


def check(reader: CReader, now_s: float) -> None:
    """Run every stage of a check, each in a pass of its own."""
    for stage in range(CHECK_STAGES):
        reader.begin(now_s + 0.02 * stage)
        reader.self_check()


def test_the_first_slave_has_address_1_and_the_last_8(reader):
    chain = reader.chain
    answers = [chain.execute(command_packet(Command.RDCFG, address), chain.wake(0.01)) for address in range(16)]
    assert [address for address, answer in enumerate(answers) if answer != b"\xff" * 8] == [*range(1, 9)]
    assert {decode_group(answers[address])[1:] for address in range(1, 9)} == {CFGR_DEFAULT[1:]}
    assert reader.memory.slave_cfgr.tolist() == [[CFGR_DEFAULT[0] | 2, *CFGR_DEFAULT[1:]]] * 8  # and SWTEN is high


def test_what_the_configuration_means():
    meaning = Configuration.from_bytes(CFGR_DEFAULT)
    assert (meaning.reference_on, meaning.adc_option, meaning.discharge_timer_code) == (True, True, 1)
    assert (meaning.under_voltage_v, meaning.over_voltage_v) == pytest.approx((2.7024, 4.2048))
    assert not any((*meaning.discharging, *meaning.gpio_pull_down_off))


def test_each_wait_is_longer_than_what_the_chip_needs_but_not_by_much():
    settle_s, cells_s, sensors_s, _ = (us * 1e-6 for us in UPDATE_TIMING_US)
    for command, wait_s in ((0x3E0, cells_s), (0x2F0, sensors_s)):
        needed_s = decode_conversion(command).time_s(adc_option=True)
        assert needed_s < wait_s < 1.1 * needed_s
    assert settle_s > CORE_WAKE_S
    assert cells_s > PORT_IDLE_S  # so a pulse wakes the port before the cells are read


def test_one_slave_and_eight_take_the_time_that_the_thesis_measured_and_expected(reader):
    """Figure 5.1.5: 10 ms with one slave, about 20 ms with more; voltages and both phases of temperatures."""
    read_voltages(reader, 0.1)
    voltages_s = reader.now_s - 0.1
    reader.read_temperatures()
    phase_s = reader.now_s - 0.1 - voltages_s
    eight_s = voltages_s + 2 * phase_s
    of_seven_s = 3 * 7 * 4 * 12 * 8e-6  # their packets of the three readings
    assert eight_s == pytest.approx(20e-3, rel=0.15)
    assert eight_s - of_seven_s == pytest.approx(10e-3, rel=0.15)


def test_a_stage_of_the_check_fits_into_a_pass_beside_the_voltages(reader):
    for stage in range(CHECK_STAGES):
        begin_s = 0.1 + PASS_S * stage
        read_voltages(reader, begin_s)
        before_s = reader.now_s
        reader.self_check()
        assert reader.now_s - before_s <= 10e-3
        assert reader.now_s <= begin_s + PASS_S


def test_temperatures_are_taken_out_of_both_phases_as_the_thesis_counts_them(reader):
    """B.10: k begins at 0, steps by two and once by three, and t[j] is temp[k]."""
    columns, k = [], 0
    for _ in range(12):
        columns.append(k)
        k += 2
        if k == 12:
            k += 1
    for cell, column in enumerate(columns):
        reader.memory.slave_temp[:] = 0
        reader.memory.slave_temp[:, column] = 18_600
        assert reader.temperatures_degc() == [25 if at == cell else T_MISSING for at in range(12)] * 8


def test_both_phases_give_every_cell_its_temperature(reader):
    assert read_temperatures(reader, 0.1).count(T_MISSING) == 48
    in_their_order = [0, 2, 4, 6, 8, 10, 1, 3, 5, 7, 9, 11]
    expected = [-20 + 12 * pack + at for pack in range(8) for at in in_their_order]
    assert read_temperatures(reader, 0.2) == expected


def test_a_team_whose_sensors_sit_on_their_own_cells_says_so(library):
    reader = started(library, tuple(range(12)))
    reader.chain.converters.sensor_v = np.full(96, 1.86)
    reader.chain.converters.sensor_v[[1, 14]] = 1.68
    read_temperatures(reader, 0.1)
    assert np.flatnonzero(np.array(read_temperatures(reader, 0.2)) == 40).tolist() == [1, 14]


def test_bleeding_goes_on_after_the_temperatures_were_read(reader):
    bled = np.isin(np.arange(96), [3, 50])
    reader.configure(bled)
    for now_s in (0.1, 0.2):
        read_temperatures(reader, now_s)
        assert np.array_equal(reader.chain.discharging, bled)


def test_a_damaged_packet_keeps_the_old_voltages_and_is_counted(reader):
    read_voltages(reader, 0.1)
    assert set(np.unique(reader.memory.slave_cvr)) == {37_000}
    reader.chain.bit_error_rate = 5e-3
    reader.chain.converters.cell_v = np.full(96, 3.8)
    for k in range(3):
        read_voltages(reader, 0.12 + 0.02 * k)
    assert reader.slaves.packet_errors > 0
    assert set(np.unique(reader.memory.slave_cvr)) <= {37_000, 38_000}


def test_damaged_commands_do_not_fail_a_self_test(reader):
    reader.chain.bit_error_rate = 1e-3
    for k in range(20):
        read_voltages(reader, 1.0 * k)
        check(reader, 1.0 * k + 0.1)
        assert not any(reader.slaves.failures)
    assert reader.memory.slave_com[:, 0].min() > 20


def test_damaged_packets_are_counted_in_the_struct_of_their_slave(reader):
    check(reader, 0.0)
    reader.chain.set_powered(5, False)
    for k in range(10):
        read_voltages(reader, 0.1 * k)
    reader.chain.set_powered(5, True)
    check(reader, 1.0)
    since_boot, last_second = reader.memory.slave_com[:, 0], reader.memory.slave_com[:, 1]
    assert since_boot.tolist() == last_second.tolist() == [0, 0, 0, 0, 0, 40, 0, 0]
    check(reader, 2.0)
    assert (since_boot[5], last_second[5]) == (40, 0)
    reader.slaves.bad_packets[5] = 0xFFFE
    reader.chain.set_powered(5, False)
    read_voltages(reader, 3.0)
    assert since_boot[5] == 0xFFFF  # it stays at its end


def test_a_slave_that_comes_back_is_configured_at_once_and_passes_its_check(reader):
    read_voltages(reader, 0.1)
    reader.chain.set_powered(5, False)
    assert read_voltages(reader, 0.12) == 1
    reader.chain.set_powered(5, True)
    assert read_voltages(reader, 0.14) == 0
    assert reader.slaves.has_returned
    read_voltages(reader, 0.16)
    assert not reader.slaves.has_returned
    assert reader.memory.slave_cvr[5].tolist() == [37_000] * 12
    check(reader, 0.2)
    assert not any(reader.slaves.failures)


def test_flags_of_the_chips_reach_the_struct(reader):
    reader.chain.converters.cell_v = np.where(np.arange(96) == 30, 2.4, 3.7)
    read_voltages(reader, 0.1)
    check(reader, 0.2)
    words = reader.memory.slave_str[:, 3:].astype("<u2")
    flags = [StatusB.from_bytes(words[n].tobytes()).under_voltage for n in range(8)]
    assert np.flatnonzero(flags).tolist() == [30]


def test_an_input_beside_an_open_wire_gives_no_temperature(reader):
    """It floats between a sensor's 1.9 V and a cell's 3.7 V, and half of what comes out would be a temperature."""
    reader.chain.converters.open_wires.add(2)
    check(reader, 0.0)
    assert np.flatnonzero(cells_of(reader.slaves.open_wires)).tolist() == [2, 3]
    for k in range(20):
        missing = np.flatnonzero(np.array(read_temperatures(reader, 1.0 + 0.1 * k)) == T_MISSING).tolist()
        assert {1, 7} <= set(missing)  # whose sensors sit on inputs 2 and 3
    assert missing == [1, 7]
