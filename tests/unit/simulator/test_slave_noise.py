"""A disturbed isoSPI line, both ways: what is damaged is seen and does nothing."""

import numpy as np

from firmware_protocol.ltc6804 import Command, with_pec
from tests.ltc6804_packets import Configuration, adcv, command_packet, write_packet


def test_noise_damages_packets_at_the_rate_asked_for_and_every_damage_is_seen(chain):
    chain.execute(command_packet(adcv()), chain.wake(0.1))
    at_s = chain.wake(0.2)
    clean = chain.read_cells(at_s)
    assert clean.shape == (8, 4, 3)
    chain.bit_error_rate = 1e-3
    damaged = 0
    for _ in range(50):
        packets = chain.read_cells(at_s)
        is_intact = np.array([[with_pec(packet[:6]) == packet for packet in map(bytes, row)] for row in packets])
        damaged += int(np.count_nonzero(~is_intact))
        assert np.array_equal(packets[is_intact][:, :3], clean[is_intact])
    commands_and_answers = 32e-3 + 64e-3
    assert 0.7 < damaged / (50 * 32 * commands_and_answers) < 1.3


def test_noise_damages_commands_and_what_is_written_with_them(chain):
    chain.bit_error_rate = 1e-2
    on, off = (
        write_packet(Command.WRCFG, Configuration(discharging=(is_on,) * 12).to_bytes()) for is_on in (True, False)
    )
    at_s, arrived, changes = chain.wake(0.2), 0, 200
    for k in range(changes):
        before = chain.cfgr.copy()
        chain.execute((on, off)[k % 2], at_s)
        bits = np.unpackbits(chain.cfgr[:, 4:], axis=1, bitorder="little")[:, :12]
        assert bits.all() == bits.any()  # all of it, or the old
        arrived += bool((bits == (k % 2 == 0)).all() and (chain.cfgr != before).any())
    intact = (1 - 8e-2) ** 12
    assert 0.4 * intact < arrived / changes < 1.1 * intact


def test_a_conversion_whose_command_was_damaged_does_not_begin(chain):
    chain.execute(command_packet(adcv()), chain.wake(0.1))
    chain.converters.cell_v = chain.converters.cell_v + 0.1
    chain.bit_error_rate = 0.02
    at_s = chain.wake(0.2)
    begun = 0
    for _ in range(100):
        chain.execute(command_packet(adcv()), at_s)
        begun += chain.converters.is_busy(slice(None))
        at_s = chain.wake(at_s + 5e-3)
        chain.execute(command_packet(Command.PLADC), at_s)
    assert 30 < begun < 70
