import numpy as np
import pytest

from firmware_protocol.ltc6804 import StatusB
from firmware_protocol.memory_map import T_MISSING
from firmware_protocol.temperature_sensor import FIRST_DEGC, POINTS_V, STEP_DEGC
from simulator.memory import MasterMemory
from simulator.slave import SlaveChain
from simulator.slave_reader import CHECK_STAGES, SlaveReader, degc_from_sensor


@pytest.fixture
def chain() -> SlaveChain:
    chain = SlaveChain(8, np.random.default_rng(1))
    chain.converters.cell_v = np.full(96, 3.7)
    curve_degc = FIRST_DEGC + STEP_DEGC * np.arange(len(POINTS_V))
    chain.converters.sensor_v = np.interp(np.arange(-20, 76), curve_degc, POINTS_V)
    return chain


@pytest.fixture
def memory() -> MasterMemory:
    return MasterMemory()


def read_temperatures(reader: SlaveReader, now_s: float) -> None:
    reader.begin(now_s)
    reader.read_temperatures()


def read_voltages(reader: SlaveReader, now_s: float) -> np.ndarray:
    reader.begin(now_s)
    return reader.read_voltages()


def check(reader: SlaveReader, now_s: float) -> None:
    """Run every stage of a check, each in a pass of its own."""
    for stage in range(CHECK_STAGES):
        reader.begin(now_s + 0.02 * stage)
        reader.self_check()


@pytest.fixture
def reader(chain, memory) -> SlaveReader:
    """Return a reader whose chips are configured and have their reference up."""
    reader = SlaveReader(memory, chain)
    reader.start(0.0)
    return reader


def test_both_phases_give_every_cell_its_temperature(chain, memory, reader):
    read_temperatures(reader, 0.1)
    assert np.count_nonzero(reader.temperatures_degc() == T_MISSING) == 48
    read_temperatures(reader, 0.2)
    in_their_order = [0, 2, 4, 6, 8, 10, 1, 3, 5, 7, 9, 11]
    assert reader.temperatures_degc().tolist() == [-20 + 12 * pack + at for pack in range(8) for at in in_their_order]


def test_bleeding_goes_on_after_the_temperatures_were_read(chain, memory, reader):
    bled = np.zeros(96, dtype=bool)
    bled[[3, 50]] = True
    reader.configure(bled)
    for now_s in (0.1, 0.2):
        read_temperatures(reader, now_s)
        assert np.array_equal(chain.discharging, bled)


def test_a_damaged_packet_keeps_the_old_voltages_and_is_counted(chain, memory, reader):
    read_voltages(reader, 0.1)
    assert set(np.unique(memory.slave_cvr)) == {37_000}
    chain.bit_error_rate = 5e-3
    chain.converters.cell_v = np.full(96, 3.8)
    for k in range(3):
        read_voltages(reader, 0.12 + 0.02 * k)
    assert reader.packet_errors > 0
    assert set(np.unique(memory.slave_cvr)) <= {37_000, 38_000}


def test_damaged_commands_neither_fail_a_self_test_nor_lose_a_temperature(chain, memory, reader):
    chain.bit_error_rate = 1e-3
    missing = 0
    for k in range(50):
        read_voltages(reader, 1.0 * k)
        check(reader, 1.0 * k + 0.1)
        read_temperatures(reader, 1.0 * k + 0.3)
        read_temperatures(reader, 1.0 * k + 0.5)
        assert not reader.failed_self_test.any()
        missing += int(np.count_nonzero(reader.temperatures_degc() == T_MISSING))
    assert memory.slave_com[:, 0].min() > 100
    assert missing < 200  # of 4800; every damaged command loses 48


def test_damaged_packets_are_counted_in_the_struct_of_their_slave(chain, memory, reader):
    check(reader, 0.0)
    chain.set_powered(5, False)
    for k in range(10):
        read_voltages(reader, 0.1 * k)
    chain.set_powered(5, True)
    check(reader, 1.0)
    since_boot, last_second = memory.slave_com[:, 0], memory.slave_com[:, 1]
    assert since_boot.tolist() == last_second.tolist() == [0, 0, 0, 0, 0, 40, 0, 0]
    check(reader, 2.0)
    assert (since_boot[5], last_second[5]) == (40, 0)


def test_a_slave_that_fails_its_self_tests_is_named_with_what_failed(chain, memory, reader):
    check(reader, 0.1)
    assert not reader.failed_self_test.any()
    chain.converters.stick(2, 0x80)
    chain.converters.multiplexer_failed[6] = True
    chain.converters.drift(7, 0.99)
    check(reader, 1.0)
    assert memory.slave_com[:, 2].tolist() == [0, 0, 1 | 2 | 4, 0, 0, 0, 8, 16]
    assert np.flatnonzero(reader.failed_self_test).tolist() == [2, 6, 7]


def test_a_slave_that_comes_back_is_configured_at_once_and_passes_its_check(chain, memory, reader):
    read_voltages(reader, 0.1)
    chain.set_powered(5, False)
    assert read_voltages(reader, 0.12)[5]
    chain.set_powered(5, True)
    assert not read_voltages(reader, 0.14).any()
    assert reader.has_returned
    read_voltages(reader, 0.16)
    assert not reader.has_returned
    assert memory.slave_cvr[5].tolist() == [37_000] * 12
    check(reader, 0.2)
    assert not reader.failed_self_test.any()


def test_flags_of_the_chips_reach_the_struct(chain, memory, reader):
    chain.converters.cell_v = np.where(np.arange(96) == 30, 2.4, 3.7)
    read_voltages(reader, 0.1)
    check(reader, 0.2)
    flags = [StatusB.from_bytes(memory.slave_str[n, 3:].astype("<u2").tobytes()).under_voltage for n in range(8)]
    assert np.flatnonzero(flags).tolist() == [30]


def test_what_is_asked_in_a_pass_takes_its_time_on_the_bus(reader):
    reader.begin(1.0)
    reader.read_voltages()
    assert reader.busy_until_s - 1.0 == pytest.approx(0.5e-3 + 4.5e-3 + 384 * 8e-6, rel=0.01)


def test_the_count_of_damaged_packets_stays_at_its_end(chain, memory, reader):
    chain.set_powered(5, False)
    for _ in range(0x10000 // 4 + 1):
        read_voltages(reader, 0.0)
    assert memory.slave_com[5, 0] == 0xFFFF


def test_a_silent_slave_is_named(chain, memory, reader):
    chain.set_powered(6, False)
    assert np.flatnonzero(read_voltages(reader, 0.0)).tolist() == [6]


@pytest.mark.parametrize(("wire", "cells"), [(2, [2, 3]), (11, [11]), (95, [95]), (47, [47]), (40, [40, 41])])
def test_open_wire_is_found_at_the_cells_it_belongs_to(chain, memory, reader, wire, cells):
    chain.converters.open_wires.add(wire)
    check(reader, 0.0)
    assert np.flatnonzero(reader.open_wire_cells).tolist() == cells
    chain.converters.open_wires.clear()
    check(reader, 1.0)
    assert not reader.open_wire_cells.any()


def test_an_input_beside_an_open_wire_gives_no_temperature(chain, memory, reader):
    """It floats between a sensor's 1.9 V and a cell's 3.7 V, and half of what comes out would be a temperature."""
    chain.converters.open_wires.add(2)
    check(reader, 0.0)
    for k in range(20):
        read_temperatures(reader, 1.0 + 0.1 * k)
        missing = np.flatnonzero(reader.temperatures_degc() == T_MISSING)
        assert {1, 7} <= set(missing.tolist())  # whose sensors sit on inputs 2 and 3
    assert missing.tolist() == [1, 7]


@pytest.mark.parametrize(
    ("volts", "degc"),
    [
        (1.955, 17.5),  # copies of the table that lost the 1.92 V point are 5 K wrong on one side of 20 degC
        (1.89, 22.5),
        (2.225, -4.58),  # the cold side has its sign
        (2.122, 4.0),
        (2.4449, -40.0),  # rounding at the ends is no fault
        (1.2951, 120.0),
    ],
)
def test_a_sensor_voltage_is_read_along_the_published_curve(volts, degc):
    assert degc_from_sensor(np.array([volts])) == pytest.approx(degc, abs=0.01)


def test_sensor_voltages_outside_the_curve_are_no_temperature():
    assert np.isnan(degc_from_sensor(np.array([0.0, 1.2, 1.29, 2.45, 2.6, 6.5535]))).all()
