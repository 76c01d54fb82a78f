import numpy as np
import pytest

from firmware_protocol.config_image import default_image
from firmware_protocol.temperature_sensor import sensor_voltage_v
from simulator.memory import Config, MasterMemory
from simulator.slave import SlaveChain
from simulator.slave_reader import SlaveReader, degc_from_sensor


@pytest.fixture
def chain() -> SlaveChain:
    chain = SlaveChain(8, np.random.default_rng(1))
    chain.cell_v = np.full(96, 3.7)
    chain.sensor_v = np.array([sensor_voltage_v(-20 + cell) for cell in range(96)])
    return chain


@pytest.fixture
def memory() -> MasterMemory:
    return MasterMemory()


def test_both_phases_give_every_cell_its_temperature(chain, memory):
    reader = SlaveReader(memory, chain)
    reader.read_temperatures(0.0)
    assert np.isnan(reader.temperatures_degc()).sum() == 48
    reader.read_temperatures(0.1)
    assert reader.temperatures_degc() == pytest.approx(np.arange(96) - 20.0, abs=0.1)


def test_bleeding_goes_on_after_the_temperatures_were_read(chain, memory):
    reader = SlaveReader(memory, chain)
    bled = np.zeros(96, dtype=bool)
    bled[[3, 50]] = True
    reader.configure(Config.from_image(default_image()), bled, 0.0)
    for now_s in (0.0, 0.1):
        reader.read_temperatures(now_s)
        assert np.array_equal(chain.discharging, bled)


def test_a_damaged_packet_keeps_the_old_voltages_and_is_counted(chain, memory):
    reader = SlaveReader(memory, chain)
    reader.read_voltages(0.0)
    chain.bit_error_rate = 5e-3
    chain.cell_v = np.full(96, 3.8)
    for _ in range(3):
        reader.read_voltages(0.02)
    assert reader.packet_errors > 0
    assert set(np.unique(memory.slave_cvr)) <= {37_000, 38_000}


def test_damaged_packets_are_counted_in_the_struct_of_their_slave(chain, memory):
    reader = SlaveReader(memory, chain)
    reader.self_check(0.0)
    chain.set_powered(5, False)
    for k in range(10):
        reader.read_voltages(0.1 * k)
    chain.set_powered(5, True)
    reader.self_check(1.0)
    since_boot, last_second = memory.slave_com[:, 0], memory.slave_com[:, 1]
    assert since_boot.tolist() == last_second.tolist() == [0, 0, 0, 0, 0, 40, 0, 0]
    reader.self_check(2.0)
    assert (since_boot[5], last_second[5]) == (40, 0)


def test_a_slave_that_fails_its_self_tests_is_named_with_what_failed(chain, memory):
    reader = SlaveReader(memory, chain)
    reader.self_check(0.0)
    assert not reader.failed_self_test.any()
    chain.stick(2, 0x80)
    chain.multiplexer_failed[6] = True
    reader.self_check(1.0)
    assert memory.slave_com[:, 2].tolist() == [0, 0, 1 | 2 | 4, 0, 0, 0, 8, 0]
    assert np.flatnonzero(reader.failed_self_test).tolist() == [2, 6]


def test_the_count_of_damaged_packets_stays_at_its_end(chain, memory):
    reader = SlaveReader(memory, chain)
    chain.set_powered(5, False)
    for _ in range(0x10000 // 4 + 1):
        reader.read_voltages(0.0)
    assert memory.slave_com[5, 0] == 0xFFFF


def test_a_silent_slave_is_named(chain, memory):
    reader = SlaveReader(memory, chain)
    chain.set_powered(6, False)
    assert np.flatnonzero(reader.read_voltages(0.0)).tolist() == [6]


@pytest.mark.parametrize(("wire", "cells"), [(2, [2, 3]), (11, [11]), (95, [95]), (47, [47]), (40, [40, 41])])
def test_open_wire_is_found_at_the_cells_it_belongs_to(chain, memory, wire, cells):
    reader = SlaveReader(memory, chain)
    chain.open_wires.add(wire)
    reader.self_check(0.0)
    assert np.flatnonzero(reader.open_wire_cells).tolist() == cells
    chain.open_wires.clear()
    reader.self_check(1.0)
    assert not reader.open_wire_cells.any()


def test_sensor_voltages_outside_the_curve_are_no_temperature():
    assert np.isnan(degc_from_sensor(np.array([0.0, 1.2, 2.6]))).all()
