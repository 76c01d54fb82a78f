import numpy as np
import pytest

from firmware_protocol.ltc6804 import (
    READ_CELLS,
    AdcMode,
    Command,
    Configuration,
    StatusA,
    StatusB,
    adax,
    adcv,
    adstat,
    command_packet,
    decode_group,
    decode_words,
    write_packet,
)
from simulator.self_test import AXST, CVST, STATST, SelfTest, decode_self_test
from simulator.slave import ADOW, WATCHDOG_S, SlaveChain


@pytest.fixture
def chain() -> SlaveChain:
    chain = SlaveChain(8, np.random.default_rng(1))
    chain.cell_v = 3.0 + 0.01 * np.arange(96)
    chain.sensor_v = np.full(96, 1.86)
    return chain


def read(chain: SlaveChain, command: Command, address: int) -> tuple[int | None, int | None, int | None]:
    return decode_words(decode_group(chain.execute(command_packet(command, address), 0.0)))


def discharge(chain: SlaveChain, cells: set[int], address: int | None = None, now_s: float = 0.0) -> None:
    configuration = Configuration(discharging=tuple(cell in cells for cell in range(12)))
    chain.execute(write_packet(Command.WRCFG, configuration.to_bytes(), address), now_s)


def test_registers_hold_no_measurement_before_the_first_conversion(chain):
    assert read(chain, Command.RDCVA, 3) == (None, None, None)


def test_conversion_reaches_every_register_group_in_steps_of_100_uv(chain):
    chain.execute(command_packet(adcv()), 0.0)
    words = [word for command in READ_CELLS for word in read(chain, command, 5)]
    assert words == [30_000 + 100 * (60 + cell) for cell in range(12)]


def test_a_command_with_a_wrong_check_word_does_nothing(chain):
    packet = bytearray(command_packet(adcv()))
    packet[3] ^= 2
    chain.execute(bytes(packet), 0.0)
    assert read(chain, Command.RDCVA, 0) == (None, None, None)


def test_configuration_reaches_one_slave_or_all(chain):
    discharge(chain, {0, 11}, address=2)
    assert set(np.flatnonzero(chain.discharging)) == {24, 35}
    discharge(chain, {5})
    assert set(np.flatnonzero(chain.discharging)) == {5 + 12 * pack for pack in range(8)}
    data = decode_group(chain.execute(command_packet(Command.RDCFG, 7), 0.0))
    assert Configuration.from_bytes(data).discharging[5]


def test_measuring_interrupts_bleeding_unless_discharge_is_permitted(chain):
    discharge(chain, {0})
    chain.execute(command_packet(adcv()), 0.0)
    assert read(chain, Command.RDCVA, 0)[0] == 30_000
    chain.execute(command_packet(adcv(discharge_permitted=True)), 0.0)
    assert read(chain, Command.RDCVA, 0) == (18_600, 30_100, 30_200)


def test_watchdog_ends_bleeding_two_seconds_after_the_last_command(chain):
    discharge(chain, {1}, now_s=10.0)
    chain.watch(10.0 + WATCHDOG_S)
    assert chain.discharging.any()
    chain.watch(10.1 + WATCHDOG_S)
    assert not chain.discharging.any()


def timed(chain: SlaveChain, timer_code: int, now_s: float) -> None:
    switches = (True,) + (False,) * 11
    configuration = Configuration(discharging=switches, discharge_timer_code=timer_code)
    chain.execute(write_packet(Command.WRCFG, configuration.to_bytes(), 3), now_s)


def test_the_discharge_timer_outlives_the_watchdog_and_ends_the_bleeding(chain):
    chain.has_timer_pin = True
    timed(chain, timer_code=2, now_s=0.0)  # one minute
    chain.watch(59.9)
    assert np.flatnonzero(chain.discharging).tolist() == [36]
    assert chain.cfgr[3, :4].tolist() == chain.cfgr[0, :4].tolist()
    chain.watch(60.1)
    assert not chain.discharging.any()


def test_the_discharge_timer_ends_the_bleeding_of_a_chip_that_is_talked_to(chain):
    chain.has_timer_pin = True
    timed(chain, timer_code=1, now_s=0.0)  # half a minute
    for now_s in range(29):
        chain.execute(command_packet(adcv()), float(now_s))
        chain.watch(float(now_s))
    assert chain.discharging.any()
    chain.execute(command_packet(adcv()), 30.0)
    chain.watch(30.1)
    assert not chain.discharging.any()


def test_a_new_configuration_starts_the_discharge_timer_again(chain):
    chain.has_timer_pin = True
    timed(chain, timer_code=1, now_s=0.0)
    timed(chain, timer_code=1, now_s=20.0)
    chain.watch(40.0)
    assert chain.discharging.any()


def test_without_its_pin_the_discharge_timer_does_not_run(chain):
    timed(chain, timer_code=15, now_s=0.0)
    chain.watch(2.1)
    assert not chain.discharging.any()


@pytest.mark.parametrize(("now_s", "code"), [(0.0, 9), (59.0, 9), (299.0, 9), (301.0, 8), (1199.0, 1), (1201.0, 0)])
def test_the_configuration_tells_what_is_left_of_the_timer(chain, now_s, code):
    chain.has_timer_pin = True
    timed(chain, timer_code=9, now_s=0.0)  # 20 minutes
    answer = chain.execute(command_packet(Command.RDCFG, 3), now_s)
    configuration = Configuration.from_bytes(decode_group(answer))
    assert (configuration.discharge_timer_code, configuration.software_timer_enabled) == (code, True)


def words(chain: SlaveChain, command: Command) -> set[int | None]:
    return set(read(chain, command, 3))


@pytest.mark.parametrize(
    ("mode", "adc_option", "codes"),
    [
        (AdcMode.FAST, False, (0x9565, 0x6A9A)),
        (AdcMode.FAST, True, (0x9553, 0x6AAC)),
        (AdcMode.NORMAL, False, (0x9555, 0x6AAA)),
        (AdcMode.FILTERED, True, (0x9555, 0x6AAA)),
    ],
)
def test_self_tests_leave_the_codes_of_the_data_sheet(chain, mode, adc_option, codes):
    chain.execute(write_packet(Command.WRCFG, Configuration(adc_option=adc_option).to_bytes()), 0.0)
    for pattern, code in zip((1, 2), codes, strict=True):
        for kind in (CVST, AXST, STATST):
            chain.execute(command_packet(SelfTest(kind, mode, pattern).command), 0.0)
        for command in (*READ_CELLS, Command.RDAUXA, Command.RDAUXB, Command.RDSTATA):
            assert words(chain, command) == {code}


def test_self_test_commands_are_those_of_the_data_sheet():
    commands = [SelfTest(kind, AdcMode.NORMAL, pattern).command for kind in (CVST, AXST, STATST) for pattern in (1, 2)]
    assert commands == [0x327, 0x347, 0x527, 0x547, 0x52F, 0x54F]


def test_no_conversion_is_taken_for_a_self_test():
    modes = list(AdcMode)
    others = [
        adcv(mode, discharge_permitted=dcp, channel=n) for mode in modes for dcp in (False, True) for n in range(7)
    ]
    others += [adax(mode, n) for mode in modes for n in range(7)] + [
        adstat(mode, n) for mode in modes for n in range(5)
    ]
    others += [ADOW | mode << 7 | pull for mode in modes for pull in (0, 0x40)] + list(Command)
    assert [command for command in others if decode_self_test(command) is not None] == []


@pytest.mark.parametrize("bit", range(16))
def test_any_stuck_bit_shows_in_one_of_the_two_patterns(chain, bit):
    chain.stick(3, 1 << bit)
    seen = []
    for pattern in (1, 2):
        test = SelfTest(CVST, AdcMode.NORMAL, pattern)
        chain.execute(command_packet(test.command), 0.0)
        seen.append(words(chain, Command.RDCVA) == {test.code()})
    assert seen.count(False) == 1


def test_a_failed_multiplexer_is_told_by_the_diagnosis(chain):
    chain.multiplexer_failed[3] = True
    chain.execute(command_packet(adstat()), 0.0)
    chain.execute(command_packet(Command.DIAGN), 0.0)
    groups = [decode_group(chain.execute(command_packet(Command.RDSTATB, n), 0.0)) for n in range(8)]
    assert [StatusB.from_bytes(group).multiplexer_failed for group in groups] == [n == 3 for n in range(8)]


def test_a_slave_without_power_answers_with_an_idle_line_and_wakes_empty(chain):
    chain.execute(command_packet(adcv()), 0.0)
    chain.set_powered(4, False)
    assert chain.execute(command_packet(Command.RDCVA, 4), 0.0) == b"\xff" * 8
    chain.set_powered(4, True)
    assert read(chain, Command.RDCVA, 4) == (None, None, None)


def test_noise_damages_packets_at_the_rate_asked_for(chain):
    chain.execute(command_packet(adcv()), 0.0)
    clean = chain.read_cells()
    chain.bit_error_rate = 1e-3
    damaged = sum(int((chain.read_cells() != clean).any(axis=2).sum()) for _ in range(50))
    assert 0.5 < damaged / (50 * 32 * 64e-3) < 1.5


def test_an_open_wire_swaps_sides_with_the_pull(chain):
    chain.open_wires.add(2)  # between cells 2 and 3
    chain.execute(command_packet(ADOW | 2 << 7 | 0x40), 0.0)
    up = read(chain, Command.RDCVB, 0)
    chain.execute(command_packet(ADOW | 2 << 7), 0.0)
    down = read(chain, Command.RDCVB, 0)
    assert up[0] is not None
    assert down[0] is not None
    assert up[0] - down[0] < -4000
    assert up[1:] == down[1:]


def test_status_gives_the_sum_of_cells_and_the_die(chain):
    chain.board_degc = 31.0
    chain.execute(command_packet(adstat()), 0.0)
    data = decode_group(chain.execute(command_packet(Command.RDSTATA, 1), 0.0))
    status = StatusA.from_bytes(data)
    assert status.total_v == pytest.approx(chain.cell_v[12:24].sum(), abs=2e-3)
    assert status.die_degc == pytest.approx(31.0, abs=0.1)
