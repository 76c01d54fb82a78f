import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from firmware_protocol.ltc6804 import with_pec
from simulator.isospi import carry, is_intact, to_packets


@given(st.lists(st.binary(min_size=6, max_size=6), min_size=1, max_size=8))
def test_packets_of_many_groups_equal_the_reference_one_by_one(groups):
    words = np.frombuffer(b"".join(groups), dtype="<u2").reshape(-1, 3)
    packets = to_packets(words)
    assert [packet.tobytes() for packet in packets] == [with_pec(group) for group in groups]
    assert is_intact(packets).all()


@given(st.binary(min_size=6, max_size=6), st.integers(0, 62))
def test_any_flipped_bit_is_noticed(group, bit):
    raw = bytearray(with_pec(group))
    bit += bit == 56  # the last bit of the check word is always 0 and carries nothing
    raw[bit // 8] ^= 1 << bit % 8
    assert not is_intact(np.frombuffer(bytes(raw), dtype="<u2"))


@given(st.integers(0, 2**32), st.lists(st.booleans(), min_size=8, max_size=8))
def test_a_quiet_pair_carries_what_packets_made_and_checked_would(seed, silent):
    rng = np.random.default_rng(seed)
    registers = rng.integers(0, 0xFFFF, (8, 12), dtype="<u2")
    quiet = carry(registers, None, 0.0, rng)
    packets = to_packets(registers.reshape(8, 4, 3))
    assert is_intact(packets).all()
    assert np.array_equal(quiet.words, packets[..., :3])
    assert quiet.is_whole
    idle = np.array(silent)
    partly = carry(registers, idle, 0.0, rng)
    assert np.array_equal(partly.words[~idle], quiet.words[~idle])
    assert not partly.intact[idle].any()
    assert partly.is_whole == (not idle.any())
