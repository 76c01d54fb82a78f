import numpy as np
import pytest

from firmware_protocol.ltc6804 import (
    READ_CELLS,
    Command,
    Configuration,
    StatusA,
    adcv,
    adstat,
    command_packet,
    decode_group,
    decode_words,
    write_packet,
)
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
