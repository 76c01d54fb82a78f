import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from firmware_protocol.ltc6804 import with_pec
from simulator.isospi import carry, to_packets


@given(st.lists(st.binary(min_size=6, max_size=6), min_size=1, max_size=8))
def test_packets_of_many_groups_equal_the_reference_one_by_one(groups):
    words = np.frombuffer(b"".join(groups), dtype="<u2").reshape(-1, 3)
    packets = to_packets(words)
    assert [packet.tobytes() for packet in packets] == [with_pec(group) for group in groups]


@given(st.integers(0, 2**32), st.lists(st.booleans(), min_size=8, max_size=8))
def test_a_quiet_pair_carries_the_registers_and_an_idle_line_nothing(seed, silent):
    rng = np.random.default_rng(seed)
    registers = rng.integers(0, 0xFFFF, (8, 12), dtype="<u2")
    packets = to_packets(registers.reshape(8, 4, 3))
    assert np.array_equal(carry(registers, None, 0.0, rng), packets[..., :3])
    idle = np.array(silent)
    partly = carry(registers, idle, 0.0, rng)
    assert np.array_equal(partly[~idle], packets[~idle])
    assert (partly[idle] == 0xFFFF).all()
