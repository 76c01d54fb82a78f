import pytest

from app.sources.master.shadow import ShadowImage
from firmware_protocol.memory_map import FIELDS
from firmware_protocol.messages import Window


def test_age_is_of_the_oldest_byte_and_none_where_any_never_came():
    shadow = ShadowImage()
    shadow.write((Window(1896, b"\1\2"),), 1_000_000_000)
    assert shadow.age_s(1896, 2, 3_000_000_000) == 2.0
    assert shadow.age_s(1896, 4, 3_000_000_000) is None
    shadow.write((Window(1898, b"\1\2"),), 2_000_000_000)
    assert shadow.age_s(1896, 4, 3_000_000_000) == 2.0


def test_half_a_number_is_not_mixed_with_its_old_half():
    shadow = ShadowImage()
    current = FIELDS["i_fs"]
    shadow.write((Window(current.offset, (5).to_bytes(4, "little", signed=True)),), 1)
    shadow.write_whole_elements((Window(current.offset, b"\xfb\xff"),), 2)
    assert current.unpack(shadow.image) == (5,)
    assert shadow.arrived_ns[current.offset] == 1


def test_whole_numbers_and_flag_bytes_are_taken():
    shadow = ShadowImage()
    shadow.write_whole_elements((Window(420, b"\x01"), Window(2982, b"\x10\x27")), 7)
    assert FIELDS["soc"].unpack(shadow.image) == (10000,)
    assert shadow.image[420] == 1
    assert shadow.arrived_ns[420] == 7


@pytest.mark.parametrize("now_ns", [0, 4])
def test_age_is_never_negative(now_ns):
    shadow = ShadowImage()
    shadow.write((Window(0, b"\1"),), 5)
    assert shadow.age_s(0, 1, now_ns) == 0.0
