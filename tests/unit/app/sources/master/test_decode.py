"""What the shadow image says in units, and what it does not say because it never came or came too long ago."""

import numpy as np
import pytest

from app.sources.master.decode import BLANK_S, Decoder
from app.sources.master.shadow import ShadowImage
from firmware_protocol.memory_map import FIELDS, MASTER_SIZE, N_CELLS, STATUS_FLAGS
from firmware_protocol.messages import Window
from firmware_protocol.older_maps import FIRST_MAP, fields_of

SECOND = 1_000_000_000


def shadow_with(**raw):
    """A shadow that holds these fields, in counts, since 1 s; nothing else ever came."""
    shadow, image = ShadowImage(), bytearray(MASTER_SIZE)
    for name, value in raw.items():
        field = FIELDS[name.replace("__", ".")]
        field.pack_into(image, tuple(value) if isinstance(value, list) else (value,))
        shadow.write((Window(field.offset, bytes(image[field.offset : field.end])),), SECOND)
    return shadow


def decoder(now_s=1.0, **raw):
    return Decoder(shadow_with(**raw), round(now_s * SECOND))


def test_numbers_are_in_their_units():
    now = decoder(i_fs=-5, v_tot=39850, soc=9991, t_max=-8, dod=1_000_000)
    assert now.number("i_fs") == pytest.approx(-0.05)
    assert now.number("v_tot") == pytest.approx(398.5)
    assert now.number("soc") == pytest.approx(0.9991)
    assert now.number("t_max") == -8
    assert now.number("dod") == pytest.approx(1.0)
    assert now.number("dod", fields_of(FIRST_MAP)) == pytest.approx(1 / 3.6)
    assert now.integer("i_fs") == -5


def test_what_never_came_is_unknown_and_not_zero():
    now = decoder()
    assert now.number("v_tot") is None
    assert now.integer("v_tot") is None
    assert not now.is_known("v_tot")
    assert np.isnan(now.voltages_v()).all()
    assert np.isnan(now.temperatures_degc()).all()
    assert now.balancing() is None
    assert now.flags() is None
    assert now.charger().state is None
    assert now.charger().enabled is None
    assert now.charger().flags == ()


@pytest.mark.parametrize(("age_s", "is_known"), [(0.0, True), (BLANK_S, True), (BLANK_S + 0.001, False)])
def test_what_came_too_long_ago_is_unknown(age_s, is_known):
    now = decoder(1.0 + age_s, v=[37000] * N_CELLS, i_fs=100, status__flags=1)
    assert now.is_known("i_fs") is is_known
    assert (now.number("i_fs") is not None) is is_known
    assert np.isfinite(now.voltages_v()).all() == is_known
    assert (now.flags() is not None) is is_known


def test_a_field_of_which_one_byte_is_missing_is_unknown():
    shadow = ShadowImage()
    shadow.write((Window(1884, b"\xfb\xff\xff"),), SECOND)
    assert Decoder(shadow, SECOND).number("i_fs") is None
    shadow.write((Window(1887, b"\xff"),), SECOND)
    assert Decoder(shadow, SECOND).number("i_fs") == pytest.approx(-0.05)


def test_cells_without_a_measurement_are_missing_each_for_itself():
    voltages = [37000 + i for i in range(N_CELLS)]
    voltages[3], voltages[95] = 0, 65535
    temperatures = [20] * N_CELLS
    temperatures[7], temperatures[8] = -128, -127
    now = decoder(v=voltages, t=temperatures)
    assert np.flatnonzero(np.isnan(now.voltages_v())).tolist() == [3, 95]
    assert now.voltages_v()[94] == pytest.approx(3.7094)
    assert np.flatnonzero(np.isnan(now.temperatures_degc())).tolist() == [7]
    assert now.temperatures_degc()[8] == -127


def test_what_is_unknown_cannot_be_overwritten_by_who_reads_it():
    missing = decoder().voltages_v()
    with pytest.raises(ValueError, match="read-only"):
        missing[0] = 3.7


def test_a_reading_does_not_follow_the_shadow():
    shadow = shadow_with(v=[37000] * N_CELLS)
    before = Decoder(shadow, SECOND).voltages_v()
    shadow.write((Window(1896, b"\0\0"),), SECOND)
    assert before[0] == pytest.approx(3.7)


def test_every_flag_has_its_bit():
    for bit, name in enumerate(STATUS_FLAGS):
        flags = decoder(status__flags=1 << bit).flags()
        assert [each for each in STATUS_FLAGS if getattr(flags, each)] == [name]


def test_can_brings_the_first_eight_flags_and_leaves_the_ninth_open():
    shadow = ShadowImage()
    shadow.write((Window(420, b"\xff"),), SECOND)
    flags = Decoder(shadow, SECOND).flags()
    assert all(getattr(flags, name) for name in STATUS_FLAGS[:8])
    assert flags.load is None
    assert Decoder(shadow, SECOND + round((BLANK_S + 1) * SECOND)).flags() is None


@pytest.mark.parametrize(
    ("names", "age_s", "is_open"),
    [
        ((), 0.0, True),
        (("fit", "balancing"), 0.0, True),
        (("charger",), 0.0, False),
        (("charging",), 0.0, False),
        (("load",), 0.0, False),
        ((), BLANK_S + 1, False),  # unknown
    ],
)
def test_relays_are_open_where_neither_car_nor_charger_is_known_to_be_connected(names, age_s, is_open):
    raw = sum(1 << STATUS_FLAGS.index(name) for name in names)
    assert decoder(1.0 + age_s, status__flags=raw).relays_open() is is_open
    assert not decoder().relays_open()


@pytest.mark.parametrize(
    ("field", "raw", "name", "expected"),
    [
        *(("charger__state", raw, "state", name) for raw, name in ((0, "off"), (6, "fault"), (7, None), (255, None))),
        *(("charger__control", raw, "enabled", False) for raw in (1, 255)),
    ],
)
def test_a_charger_state_that_nobody_knows_is_none_and_any_control_but_zero_stops_it(field, raw, name, expected):
    assert getattr(decoder(**{field: raw}).charger(), name) == expected


def test_the_charger_is_read_in_its_units():
    charger = decoder(
        charger__v_set=4032, charger__i_set=160, charger__v_out=4000, charger__i_out=155, charger__control=0,
        charger__flags=0b01010, charger__state=2,
    ).charger()  # fmt: skip
    assert (charger.asked_voltage_v, charger.asked_current_a) == pytest.approx((403.2, 16.0))
    assert (charger.voltage_v, charger.current_a) == pytest.approx((400.0, 15.5))
    assert (charger.state, charger.enabled) == ("constant_current", True)
    assert charger.flags == ("over-temperature", "battery")


@pytest.mark.parametrize("cell", [0, 7, 8, 11, 12, 95])
def test_the_cells_that_are_bled_stand_in_the_slaves_configuration(cell):
    slaves = bytearray(1444)
    pack, index = divmod(cell, 12)
    start = 4 + 180 * pack + 80  # after n_slaves and its padding; CFGR4 and CFGR5 of the LTC6804
    slaves[start + index // 8] |= 1 << index % 8
    slaves[start + 1] |= 0xF0  # the discharge timer, no cells
    shadow = ShadowImage()
    shadow.write((Window(440, bytes(slaves)),), SECOND)
    bled = Decoder(shadow, SECOND).balancing()
    assert np.flatnonzero(bled).tolist() == [cell]
    assert Decoder(shadow, SECOND + round((BLANK_S + 1) * SECOND)).balancing() is None


def test_ages_are_those_of_the_oldest_byte_of_each_part():
    shadow = shadow_with(i_fs=1, v=[37000] * N_CELLS)
    shadow.write((Window(1896, b"\0\0"),), 3 * SECOND)
    ages = Decoder(shadow, 4 * SECOND).ages()
    assert (ages.current, ages.voltage) == (3.0, 3.0)
    assert ages.temperature is None
    assert ages.config is None


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
