import numpy as np
import pytest

from firmware_protocol.ltc6804 import READ_CELLS, AdcMode, Command, decode_group
from simulator.conversion import ADOW, AXST, CVST, REFERENCE_START_S, STATST, SelfTest, decode_conversion
from simulator.slave import CORE_WAKE_S, PORT_IDLE_S, WATCHDOG_S, SlaveChain
from tests.ltc6804_packets import (
    Configuration,
    StatusA,
    StatusB,
    adax,
    adcv,
    adstat,
    command_packet,
    decode_words,
    write_packet,
)

LATER_S = 0.3  # longer than any conversion


def address_of(slave: int | None) -> int | None:
    """Return what the switches on a slave's board say; slaves are counted from 0 here."""
    return None if slave is None else slave + 1


def group(chain: SlaveChain, command: Command, slave: int, now_s: float = LATER_S) -> bytes:
    return decode_group(chain.execute(command_packet(command, address_of(slave)), chain.wake(now_s)))


def read(chain: SlaveChain, command: Command, slave: int, now_s: float = LATER_S) -> tuple[int | None, ...]:
    return decode_words(group(chain, command, slave, now_s))


def tell(chain: SlaveChain, command: int, now_s: float = 0.1, slave: int | None = None) -> float:
    """Wake the chips and send a command; return when it arrived."""
    at_s = chain.wake(now_s)
    chain.execute(command_packet(command, address_of(slave)), at_s)
    return at_s


def configure(chain: SlaveChain, configuration: Configuration, slave: int | None = None, now_s: float = 0.0) -> None:
    chain.execute(write_packet(Command.WRCFG, configuration.to_bytes(), address_of(slave)), chain.wake(now_s))


def discharge(chain: SlaveChain, cells: set[int], slave: int | None = None, now_s: float = 0.0) -> None:
    configure(chain, Configuration(discharging=tuple(cell in cells for cell in range(12))), slave, now_s)


def test_registers_hold_no_measurement_before_the_first_conversion(chain):
    assert read(chain, Command.RDCVA, 3) == (None, None, None)


def test_conversion_reaches_every_register_group_in_steps_of_100_uv(chain):
    tell(chain, adcv())
    words = [word for command in READ_CELLS for word in read(chain, command, 5)]
    assert words == [30_000 + 100 * (60 + cell) for cell in range(12)]


def test_one_channel_converts_the_two_cells_that_share_it(chain):
    tell(chain, adcv(channel=2))
    words = [word for command in READ_CELLS for word in read(chain, command, 0)]
    assert [cell for cell, word in enumerate(words) if word is not None] == [1, 7]


TIMES_US = {
    adcv(AdcMode.FAST): 1113,
    adcv(AdcMode.NORMAL): 2335,
    adcv(AdcMode.FILTERED): 201_317,
    adcv(AdcMode.NORMAL, channel=3): 405,
    adax(AdcMode.NORMAL): 2335,
    adstat(AdcMode.NORMAL): 1563,
    ADOW | AdcMode.NORMAL << 7: 2335,
    SelfTest(CVST, AdcMode.NORMAL, 1).command: 2335,
    Command.DIAGN: 400,
}


@pytest.mark.parametrize(("command", "time_us"), TIMES_US.items())
def test_a_conversion_takes_the_time_of_the_data_sheet(chain, command, time_us):
    at_s = tell(chain, command)
    poll = command_packet(Command.PLADC)
    seen = []
    for share in np.linspace(0.0, 1.02, 103):
        now_s = at_s + share * time_us * 1e-6
        chain.wake(now_s)
        seen.append(chain.execute(poll, max(now_s, chain.wake(now_s))))
    assert seen.index(b"\xff") in (99, 100, 101)
    assert set(seen[:99]) == {b"\0"}


@pytest.mark.parametrize(("option", "time_us"), [(False, 1113), (True, 1288)])
def test_the_options_bit_makes_a_conversion_slower(option, time_us):
    conversion = decode_conversion(adcv(AdcMode.FAST))
    assert conversion.time_s(adc_option=option) == pytest.approx(time_us * 1e-6)


def test_reading_before_the_end_of_the_first_conversion_gives_no_measurement(chain):
    at_s = tell(chain, adcv())
    assert read(chain, Command.RDCVA, 0, at_s + 2.2e-3) == (None, None, None)
    assert read(chain, Command.RDCVA, 0, at_s + 2.4e-3) == (30_000, 30_100, 30_200)


def test_reading_before_the_end_of_a_later_conversion_gives_the_old_values(chain):
    tell(chain, adcv())
    chain.converters.cell_v = chain.converters.cell_v + 1.0
    at_s = tell(chain, adcv(), now_s=0.2)
    assert read(chain, Command.RDCVA, 0, at_s + 2.2e-3) == (30_000, 30_100, 30_200)
    assert read(chain, Command.RDCVA, 0, at_s + 2.4e-3) == (40_000, 40_100, 40_200)


def test_a_conversion_holds_what_stood_at_the_inputs_when_it_began(chain):
    at_s = tell(chain, adcv())
    chain.converters.cell_v = chain.converters.cell_v + 1.0
    assert read(chain, Command.RDCVA, 0, at_s + 3e-3)[0] == 30_000


def test_a_new_command_ends_the_conversion_under_way(chain):
    at_s = tell(chain, adcv())
    chain.execute(command_packet(adcv(AdcMode.FILTERED)), at_s + 1e-3)
    assert read(chain, Command.RDCVA, 0, at_s + 5e-3) == (None, None, None)


def test_one_slave_may_convert_while_the_others_keep_theirs(chain):
    tell(chain, adcv(), slave=3)
    assert read(chain, Command.RDCVA, 3)[0] == 33_600
    assert read(chain, Command.RDCVA, 2) == (None, None, None)


def test_without_its_reference_a_conversion_takes_longer(chain):
    configure(chain, Configuration(reference_on=False), now_s=0.05)
    at_s = tell(chain, adcv())
    assert read(chain, Command.RDCVA, 0, at_s + 3e-3) == (None, None, None)
    assert read(chain, Command.RDCVA, 0, at_s + 2.4e-3 + REFERENCE_START_S)[0] == 30_000


def test_a_command_with_a_wrong_check_word_does_nothing(chain):
    packet = bytearray(command_packet(adcv()))
    packet[3] ^= 2
    chain.execute(bytes(packet), chain.wake(0.1))
    assert read(chain, Command.RDCVA, 0) == (None, None, None)


def test_an_idle_port_loses_the_packet_that_wakes_it(chain):
    at_s = tell(chain, adcv())
    idle_s = at_s + 1.1 * PORT_IDLE_S
    assert chain.execute(command_packet(Command.RDCVA, 1), idle_s) == b"\xff" * 8
    assert read(chain, Command.RDCVA, 0, idle_s + 1e-4)[0] == 30_000


def test_a_chip_asleep_needs_its_time_to_wake_and_has_lost_its_configuration(chain):
    asleep_s = WATCHDOG_S + 0.1
    chain.wake(asleep_s)
    early_s = asleep_s + 0.5 * CORE_WAKE_S
    assert chain.execute(command_packet(Command.RDCFG, 1), early_s) == b"\xff" * 8
    awake = group(chain, Command.RDCFG, 0, asleep_s + 2 * CORE_WAKE_S)
    assert not Configuration.from_bytes(awake).reference_on


def test_configuration_reaches_one_slave_or_all(chain):
    discharge(chain, {0, 11}, slave=2)
    assert set(np.flatnonzero(chain.discharging)) == {24, 35}
    discharge(chain, {5})
    assert set(np.flatnonzero(chain.discharging)) == {5 + 12 * pack for pack in range(8)}
    assert Configuration.from_bytes(group(chain, Command.RDCFG, 7)).discharging[5]


def test_measuring_interrupts_bleeding_unless_discharge_is_permitted(chain):
    discharge(chain, {0})
    tell(chain, adcv())
    assert read(chain, Command.RDCVA, 0)[0] == 30_000
    tell(chain, adcv(discharge_permitted=True), now_s=0.4)
    assert read(chain, Command.RDCVA, 0, 0.7) == (18_600, 30_100, 30_200)


def test_conversions_take_their_time_from_the_bleeding(chain):
    assert chain.take_bleeding(0.02) is None
    discharge(chain, {0})
    assert set(chain.take_bleeding(0.02)[[0, 12, 84]]) == {1.0}
    tell(chain, adcv())
    bled = chain.take_bleeding(0.02)
    assert bled[12] == pytest.approx(1 - 2.335 / 20)
    assert bled[13] == 0.0
    tell(chain, adcv(AdcMode.FILTERED))
    assert not chain.take_bleeding(0.02).any()


def test_watchdog_ends_bleeding_two_seconds_after_the_last_wake_up(chain):
    discharge(chain, {1}, now_s=10.0)
    chain.watch(10.0 + WATCHDOG_S)
    assert chain.discharging.any()
    chain.watch(10.1 + WATCHDOG_S)
    assert not chain.discharging.any()


def timed(chain: SlaveChain, timer_code: int, now_s: float) -> None:
    switches = (True,) + (False,) * 11
    configure(chain, Configuration(discharging=switches, discharge_timer_code=timer_code), 3, now_s)


def test_the_discharge_timer_outlives_the_watchdog_and_ends_the_bleeding(chain):
    timed(chain, timer_code=2, now_s=0.0)  # one minute
    chain.watch(59.9)
    assert np.flatnonzero(chain.discharging).tolist() == [36]
    assert chain.cfgr[3, :4].tolist() == chain.cfgr[0, :4].tolist()
    chain.watch(60.1)
    assert not chain.discharging.any()


def test_the_discharge_timer_ends_the_bleeding_of_a_chip_that_is_talked_to(chain):
    timed(chain, timer_code=1, now_s=0.0)  # half a minute
    for now_s in range(29):
        tell(chain, adcv(), float(now_s))
        chain.watch(float(now_s))
    assert chain.discharging.any()
    tell(chain, adcv(), 30.0)
    chain.watch(30.1)
    assert not chain.discharging.any()


def test_a_new_configuration_starts_the_discharge_timer_again(chain):
    timed(chain, timer_code=1, now_s=0.0)
    timed(chain, timer_code=1, now_s=20.0)
    chain.watch(40.0)
    assert chain.discharging.any()


def test_without_its_pin_the_discharge_timer_does_not_run(chain):
    chain.has_timer_pin = False
    timed(chain, timer_code=15, now_s=0.0)
    chain.watch(2.1)
    assert not chain.discharging.any()


@pytest.mark.parametrize(("now_s", "code"), [(0.0, 9), (59.0, 9), (299.0, 9), (301.0, 8), (1199.0, 1), (1201.0, 0)])
def test_the_configuration_tells_what_is_left_of_the_timer(chain, now_s, code):
    timed(chain, timer_code=9, now_s=0.0)  # 20 minutes
    begin_s = chain.wake(0.0)
    configuration = Configuration.from_bytes(group(chain, Command.RDCFG, 3, begin_s + now_s + CORE_WAKE_S))
    assert (configuration.discharge_timer_code, configuration.software_timer_enabled) == (code, True)


def words(chain: SlaveChain, command: Command, now_s: float = LATER_S) -> set[int | None]:
    return set(read(chain, command, 3, now_s))


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
    configure(chain, Configuration(adc_option=adc_option))
    now_s = 0.1
    for pattern, code in zip((1, 2), codes, strict=True):
        for kind in (CVST, AXST, STATST):
            tell(chain, SelfTest(kind, mode, pattern).command, now_s)
            now_s += LATER_S
        for command in (*READ_CELLS, Command.RDAUXA, Command.RDAUXB, Command.RDSTATA):
            assert words(chain, command, now_s) == {code}


@pytest.mark.parametrize("bit", range(16))
def test_any_stuck_bit_shows_in_one_of_the_two_patterns(chain, bit):
    chain.converters.stick(3, 1 << bit)
    seen = []
    for pattern in (1, 2):
        test = SelfTest(CVST, AdcMode.NORMAL, pattern)
        tell(chain, test.command, 0.5 * pattern)
        seen.append(words(chain, Command.RDCVA, 0.5 * pattern + 0.1) == {test.code()})
    assert seen.count(False) == 1


def status_b(chain: SlaveChain, slave: int, now_s: float = LATER_S) -> StatusB:
    return StatusB.from_bytes(group(chain, Command.RDSTATB, slave, now_s))


def test_a_failed_multiplexer_is_told_by_the_diagnosis_until_it_passes(chain):
    chain.converters.multiplexer_failed[3] = True
    tell(chain, Command.DIAGN)
    assert [status_b(chain, n).multiplexer_failed for n in range(8)] == [n == 3 for n in range(8)]
    chain.converters.multiplexer_failed[3] = False
    tell(chain, Command.DIAGN, 0.4)
    assert not status_b(chain, 3, 0.5).multiplexer_failed


def test_cells_beyond_the_thresholds_are_flagged_by_the_next_conversion(chain):
    configure(chain, Configuration(under_voltage_code=0x619, over_voltage_code=0xA41))  # 2.5 and 4.2 V
    chain.converters.cell_v = np.full(96, 3.7)
    chain.converters.cell_v[[24, 35]] = 2.49
    chain.converters.cell_v[[28, 35 + 12]] = 4.21
    tell(chain, adcv())
    flags = status_b(chain, 2)
    assert np.flatnonzero(flags.under_voltage).tolist() == [0, 11]
    assert np.flatnonzero(flags.over_voltage).tolist() == [4]
    assert np.flatnonzero(status_b(chain, 3).over_voltage).tolist() == [11]
    chain.converters.cell_v = np.full(96, 3.7)
    assert any(status_b(chain, 2).under_voltage)
    tell(chain, adcv(), 0.6)
    assert not any((*status_b(chain, 2, 0.7).under_voltage, *status_b(chain, 2, 0.7).over_voltage))


def test_flags_follow_the_thresholds_of_their_conversion(chain):
    configure(chain, Configuration(under_voltage_code=0, over_voltage_code=4095))
    at_s = tell(chain, adcv())
    configure(chain, Configuration(under_voltage_code=4000, over_voltage_code=4095), now_s=at_s + 3e-3)
    assert not any(status_b(chain, 0).under_voltage)


def test_clearing_the_status_sets_every_flag_for_a_check_of_the_flags(chain):
    tell(chain, adcv())
    tell(chain, Command.CLRSTAT, 0.2)
    flags = status_b(chain, 0)
    assert all((*flags.under_voltage, *flags.over_voltage, flags.multiplexer_failed, flags.thermal_shutdown))
    assert flags.digital_supply is None
    assert not status_b(chain, 0).thermal_shutdown


def test_clearing_the_cells_takes_the_measurement_away(chain):
    tell(chain, adcv())
    tell(chain, Command.CLRCELL, 0.2)
    assert read(chain, Command.RDCVD, 7) == (None, None, None)


def test_a_drifting_reference_falsifies_every_voltage_and_shows_in_the_second_reference(chain):
    chain.converters.drift(3, 1.02)
    tell(chain, adcv())
    tell(chain, adax(), 0.2)
    assert read(chain, Command.RDCVA, 3)[0] == round(33_600 / 1.02)
    assert [read(chain, Command.RDAUXB, n)[2] for n in (2, 3)] == [30_000, round(30_000 / 1.02)]


def test_a_slave_without_power_answers_with_an_idle_line_and_wakes_empty(chain):
    tell(chain, adcv())
    chain.set_powered(4, False)
    assert chain.execute(command_packet(Command.RDCVA, 5), chain.wake(0.2)) == b"\xff" * 8
    assert read(chain, Command.RDCVA, 5)[0] == 36_000
    chain.set_powered(4, True)
    assert read(chain, Command.RDCVA, 4) == (None, None, None)


def test_an_open_wire_swaps_sides_with_the_pull(chain):
    chain.converters.open_wires.add(2)  # between cells 2 and 3
    tell(chain, ADOW | 2 << 7 | 0x40)
    up = read(chain, Command.RDCVB, 0)
    tell(chain, ADOW | 2 << 7, 0.6)
    down = read(chain, Command.RDCVB, 0, 0.7)
    assert up[0] - down[0] < -4000
    assert up[1:] == down[1:]


def test_status_gives_the_sum_of_cells_and_the_die(chain):
    chain.converters.board_degc = 31.0
    tell(chain, adstat())
    status = StatusA.from_bytes(group(chain, Command.RDSTATA, 1))
    assert status.total_v == pytest.approx(chain.converters.cell_v[12:24].sum(), abs=2e-3)
    assert status.die_degc == pytest.approx(31.0, abs=0.1)
