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


@pytest.mark.parametrize("now_ns", [0, 4])
def test_age_is_never_negative(now_ns):
    shadow = ShadowImage()
    shadow.write((Window(0, b"\1"),), 5)
    assert shadow.age_s(0, 1, now_ns) == 0.0


def test_a_window_brings_its_bytes_and_no_byte_beside_it():
    shadow = ShadowImage()
    current = FIELDS["i_fs"]
    shadow.write((Window(current.offset, b"\xfb\xff\xff"),), SECOND)
    assert shadow.image[current.offset - 1 : current.end] == b"\0\xfb\xff\xff\0"
    assert Decoder(shadow, SECOND).number("i_fs") is None
    shadow.write((Window(current.offset + 3, b"\xff"),), SECOND)
    assert Decoder(shadow, SECOND).number("i_fs") == pytest.approx(-0.05)
    assert [shadow.age_s(at, 1, SECOND) for at in (current.offset - 1, current.end)] == [None, None]


@pytest.mark.parametrize(
    ("windows", "taken"),
    [
        ([(420, b"\x01"), (2982, b"\x10\x27")], {420: b"\x01", 2982: b"\x10\x27"}),  # flags and the SOC
        ([(1884, b"\xfb\xff")], {}),  # half a number is not mixed with its old half
        ([(1884, b"\xfb\xff"), (1886, b"\xff\xff")], {1884: b"\xfb\xff\xff\xff"}),
        ([(1897, b"\x01\x02\x03\x04\x05")], {1898: b"\x02\x03\x04\x05"}),  # part of an array
        ([(2391, b"\x77")], {}),  # padding between fields
        ([(421, b"\x01")], {}),  # the ninth flag without the others of its byte
    ],
)
def test_of_a_can_message_whole_numbers_and_flag_bytes_are_taken(windows, taken):
    shadow, expected = ShadowImage(), bytearray(b"\xaa" * MASTER_SIZE)
    shadow.write((Window(0, bytes(expected)),), 1)
    shadow.write_whole_elements(tuple(Window(*window) for window in windows), 9)
    for offset, data in taken.items():
        expected[offset : offset + len(data)] = data
    assert shadow.image == expected
    new = {offset + k for offset, data in taken.items() for k in range(len(data))}
    assert {at for at in range(MASTER_SIZE) if shadow.measured_ns[at] == 9} == new
