import pytest

from app.sources.master.shadow import ShadowImage
from firmware_protocol.memory_map import FIELDS
from firmware_protocol.messages import Window


def test_half_a_number_is_not_mixed_with_its_old_half():
    shadow = ShadowImage()
    current = FIELDS["i_fs"]
    shadow.write((Window(current.offset, (5).to_bytes(4, "little", signed=True)),), 1)
    shadow.write_whole_elements((Window(current.offset, b"\xfb\xff"),), 2)
    assert current.unpack(shadow.image) == (5,)
    assert shadow.measured_ns[current.offset] == 1


def test_whole_numbers_and_flag_bytes_are_taken():
    shadow = ShadowImage()
    shadow.write_whole_elements((Window(420, b"\x01"), Window(2982, b"\x10\x27")), 7)
    assert FIELDS["soc"].unpack(shadow.image) == (10000,)
    assert shadow.image[420] == 1
    assert shadow.measured_ns[420] == 7


@pytest.mark.parametrize("now_ns", [0, 4])
def test_age_is_never_negative(now_ns):
    shadow = ShadowImage()
    shadow.write((Window(0, b"\1"),), 5)
    assert shadow.age_s(0, 1, now_ns) == 0.0


def test_a_window_touches_no_byte_beside_it():
    shadow = ShadowImage()
    shadow.write((Window(100, b"\xaa\xbb"),), 5)
    assert shadow.image[99:103] == b"\0\xaa\xbb\0"
    assert shadow.age_s(99, 1, 5) is None
    assert shadow.age_s(102, 1, 5) is None
    assert shadow.age_s(100, 2, 5) == 0.0


def test_an_element_whose_bytes_come_in_two_windows_of_one_message_is_whole():
    shadow = ShadowImage()
    shadow.write_whole_elements((Window(1884, b"\xfb\xff"), Window(1886, b"\xff\xff")), 9)
    assert FIELDS["i_fs"].unpack(shadow.image) == (-5,)
    assert shadow.age_s(1884, 4, 9) == 0.0


def test_of_an_array_the_whole_elements_are_taken_and_the_others_not():
    shadow = ShadowImage()
    shadow.write_whole_elements((Window(1897, b"\x01\x02\x03\x04\x05"),), 9)
    assert FIELDS["v"].unpack(shadow.image)[:4] == (0, 0x0302, 0x0504, 0)
    assert shadow.age_s(1896, 2, 9) is None


@pytest.mark.parametrize("offset", [2391, 421])
def test_padding_and_the_ninth_flag_without_the_others_of_its_byte_are_never_taken_from_can(offset):
    shadow = ShadowImage()
    shadow.write_whole_elements((Window(offset, b"\x01"),), 9)
    assert shadow.image[offset] == 0
    assert shadow.age_s(offset, 1, 9) is None
