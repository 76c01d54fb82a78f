"""The set-up of the slaves against the code that the BMS thesis prints, written down here as it stands there."""

import numpy as np
import pytest

from firmware_protocol.ltc6804 import Command, Configuration, command_packet, decode_command, decode_group
from firmware_protocol.memory_map import T_MISSING
from simulator import slave_reader
from simulator.conversion import REFERENCE_START_S, decode_conversion
from simulator.memory import MasterMemory
from simulator.slave import CORE_WAKE_S, PORT_IDLE_S, SlaveChain
from simulator.slave_reader import CHECK_STAGE_S, CHECK_STAGES, SlaveReader
from simulator.slave_setup import DEFAULT_CFGR, THESIS_SENSOR_INPUTS

CFGR_DEFAULT = bytes((0x05, 0x98, 0x46, 0xA4, 0x00, 0x10))  # B.8
UPDATE_TIMING_US = (500, 4500, 1400, 100)  # B.8
PASS_S = 0.02


class Listening(SlaveChain):
    """Eight slaves, and what the master told them when."""

    def __init__(self, sensor_inputs: tuple[int, ...] = THESIS_SENSOR_INPUTS) -> None:
        super().__init__(8, np.random.default_rng(1), sensor_inputs)
        self.converters.cell_v = 3.0 + 0.01 * np.arange(96)
        self.converters.sensor_v = np.full(96, 1.86)
        self.heard: list[tuple[float, bytes]] = []

    def execute(self, packet: bytes, now_s: float) -> bytes:
        self.heard.append((now_s, packet))
        return super().execute(packet, now_s)

    def wake(self, now_s: float) -> float:
        self.heard.append((now_s, b""))
        return super().wake(now_s)

    def read_cells(self, now_s: float):
        self.heard.append((now_s, b"read"))
        return super().read_cells(now_s)


@pytest.fixture
def chain() -> Listening:
    return Listening()


@pytest.fixture
def memory() -> MasterMemory:
    return MasterMemory()


@pytest.fixture
def reader(chain, memory) -> SlaveReader:
    reader = SlaveReader(memory, chain)
    reader.start(0.0)
    return reader


def test_the_start_clears_writes_to_all_and_reads_every_address_back(chain, memory, reader):
    commands = [decode_command(packet[:4]) for _, packet in chain.heard if packet]
    assert commands == [(Command.CLRCELL, None), (Command.WRCFG, None)]
    assert chain.heard[2][1][4:10] == CFGR_DEFAULT == DEFAULT_CFGR
    assert memory.slave_cfgr.tolist() == [[CFGR_DEFAULT[0] | 2, *CFGR_DEFAULT[1:]]] * 8  # and SWTEN is high
    assert memory.slave_status.tolist() == [1] * 8


def test_the_first_slave_has_address_1_and_the_last_8(chain, reader):
    answers = [chain.execute(command_packet(Command.RDCFG, address), chain.wake(0.01)) for address in range(16)]
    assert [address for address, answer in enumerate(answers) if answer != b"\xff" * 8] == [*range(1, 9)]
    assert {decode_group(answers[address])[1:] for address in range(1, 9)} == {CFGR_DEFAULT[1:]}


def test_what_the_configuration_means():
    meaning = Configuration.from_bytes(CFGR_DEFAULT)
    assert (meaning.reference_on, meaning.adc_option, meaning.discharge_timer_code) == (True, True, 1)
    assert (meaning.under_voltage_v, meaning.over_voltage_v) == pytest.approx((2.7024, 4.2048))
    assert not any((*meaning.discharging, *meaning.gpio_pull_down_off))


def test_a_slave_that_does_not_hold_the_configuration_is_a_fault_from_the_start(chain, memory):
    chain.set_powered(3, False)
    SlaveReader(memory, chain).start(0.0)
    assert memory.slave_status.tolist() == [1, 1, 1, 255, 1, 1, 1, 1]


def test_the_waits_are_those_that_the_thesis_prints(chain, reader):
    """Each stands where the data sheet needs it: wake-up, cells at 2 kHz, sensors switched in, sensors at 14 kHz."""
    chain.heard.clear()
    reader.begin(0.1)
    reader.read_voltages()
    reader.read_temperatures()
    times_us = [round(1e6 * (at_s - 0.1)) for at_s, _ in chain.heard]
    kinds = ["read" if packet == b"read" else packet and decode_command(packet[:4])[0] for _, packet in chain.heard]
    woken, cells, woken_again, read, switched, sensors, sensors_read = range(7)
    assert kinds[:7] == [b"", 0x3E0, b"", "read", Command.WRCFG, 0x2F0, "read"]
    byte_us = 8
    settle_us, cells_us, sensors_us, switch_us = UPDATE_TIMING_US
    assert times_us[cells] - times_us[woken] == settle_us + 4 * byte_us
    assert times_us[woken_again] - times_us[cells] == cells_us
    assert times_us[sensors] - times_us[switched] == switch_us + 4 * byte_us
    assert times_us[sensors_read] - times_us[sensors] == sensors_us + 4 * byte_us
    assert times_us[read] < times_us[switched]  # voltages first, as their filter is the slower one


def test_each_wait_is_longer_than_what_the_chip_needs_but_not_by_much():
    settle_s, cells_s, sensors_s, _ = (us * 1e-6 for us in UPDATE_TIMING_US)
    for command, wait_s in ((0x3E0, cells_s), (0x2F0, sensors_s)):
        needed_s = decode_conversion(command).time_s(adc_option=True)
        assert needed_s < wait_s < 1.1 * needed_s
    assert settle_s > CORE_WAKE_S
    assert cells_s > PORT_IDLE_S  # so a pulse wakes the port before the cells are read


def test_one_slave_and_eight_take_the_time_that_the_thesis_measured_and_expected(chain, reader):
    """Figure 5.1.5: 10 ms with one slave, about 20 ms with more; voltages and both phases of temperatures."""
    reader.begin(0.1)
    reader.read_voltages()
    voltages_s = reader.busy_until_s - 0.1
    reader.read_temperatures()
    phase_s = reader.busy_until_s - 0.1 - voltages_s
    eight_s = voltages_s + 2 * phase_s
    of_seven_s = 3 * 7 * 4 * 12 * 8e-6  # their packets of the three readings
    assert eight_s == pytest.approx(20e-3, rel=0.15)
    assert eight_s - of_seven_s == pytest.approx(10e-3, rel=0.15)


def test_a_stage_of_the_check_fits_into_a_pass_beside_the_voltages(chain, reader):
    for stage in range(CHECK_STAGES):
        begin_s = 0.1 + PASS_S * stage
        reader.begin(begin_s)
        reader.read_voltages()
        before_s = reader.busy_until_s
        reader.self_check()
        assert reader.busy_until_s - before_s <= CHECK_STAGE_S
        assert reader.busy_until_s <= begin_s + PASS_S


@pytest.mark.parametrize(("wait_us", "is_ready"), [(4300, False), (4500, True)])
def test_a_shorter_wait_gives_the_voltages_of_before(chain, memory, reader, monkeypatch, wait_us, is_ready):
    for now_s in (0.1, 0.12):
        reader.begin(now_s)
        reader.read_voltages()
    before = memory.slave_cvr.tolist()
    chain.converters.cell_v = np.full(96, 4.0)
    monkeypatch.setitem(slave_reader._WAIT_S, slave_reader._CONVERT, wait_us * 1e-6)
    reader.begin(0.14)
    reader.read_voltages()
    assert memory.slave_cvr.tolist() == ([[40_000] * 12] * 8 if is_ready else before)


def test_without_its_reference_the_first_reading_is_none(chain, memory, reader):
    """4500 us are not enough for the 4.4 ms of the reference besides: what stands there was cleared at the start."""
    reader.begin(REFERENCE_START_S / 4)
    reader.read_voltages()
    assert set(memory.slave_cvr.reshape(-1).tolist()) == {0xFFFF}
    reader.begin(PASS_S)
    reader.read_voltages()
    assert memory.slave_cvr.reshape(-1).tolist() == [30_000 + 100 * cell for cell in range(96)]


def temperatures_of(chain: Listening, reader: SlaveReader) -> list[int]:
    for now_s in (0.1, 0.2):
        reader.begin(now_s)
        reader.read_temperatures()
    return reader.temperatures_degc().tolist()


def test_temperatures_are_taken_out_of_both_phases_as_the_thesis_counts_them(chain, memory, reader):
    """B.10: k begins at 0, steps by two and once by three, and t[j] is temp[k]."""
    columns, k = [], 0
    for _ in range(12):
        columns.append(k)
        k += 2
        if k == 12:
            k += 1
    assert columns[1] == 2
    for cell, column in enumerate(columns):
        memory.slave_temp[:] = 0
        memory.slave_temp[:, column] = 18_600
        expected = [25 if at == cell else T_MISSING for at in range(12)] * 8
        assert reader.temperatures_degc().tolist() == expected


def test_a_team_whose_sensors_sit_on_their_own_cells_says_so():
    chain = Listening(tuple(range(12)))
    reader = SlaveReader(MasterMemory(), chain)
    reader.start(0.0)
    chain.converters.sensor_v[[1, 14]] = 1.68
    assert np.flatnonzero(np.array(temperatures_of(chain, reader)) == 40).tolist() == [1, 14]
