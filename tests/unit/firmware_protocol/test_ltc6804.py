from dataclasses import replace

import pytest

from firmware_protocol import ltc6804
from firmware_protocol.errors import DecodeError, EncodeError
from firmware_protocol.ltc6804 import AdcMode, Command, Configuration, StatusA, StatusB


def bitwise_pec15(data):
    """The data sheet's procedure, bit by bit: din XOR the top bit enters at bits 0, 3, 4, 7, 8, 10, 14."""
    register = [(0x0010 >> i) & 1 for i in range(15)]
    for byte in data:
        for shift in range(7, -1, -1):
            in0 = (byte >> shift & 1) ^ register[14]
            register = [in0, *register[:14]]
            for tap in (3, 4, 7, 8, 10, 14):
                register[tap] ^= in0
    return sum(bit << i for i, bit in enumerate(register)) << 1


@pytest.mark.parametrize(
    ("data", "pec"),
    [
        ("0001", 0x3D6E),  # worked example of the data sheet
        ("0002", 0x2B0A),
        ("0004", 0x07C2),
        ("0711", 0xC9C0),
        ("0360", 0xF46C),
        ("B80A", 0xF5BC),
        ("000000000000", 0xC212),
        ("FFFFFFFFFFFF", 0x664C),
        ("010203040506", 0x22EE),
        ("889088908890", 0xE5B2),
    ],
)
def test_pec15_vectors(data, pec):
    assert ltc6804.pec15(bytes.fromhex(data)) == pec


@pytest.mark.parametrize("data", [bytes([byte]) * n for byte in (0, 1, 0x5A, 0xFF) for n in (0, 1, 2, 6, 40)])
def test_pec15_equals_the_bitwise_procedure(data):
    assert ltc6804.pec15(data) == bitwise_pec15(data)


@pytest.mark.parametrize(
    ("convert", "arguments", "code"),
    [
        (ltc6804.adcv, {}, 0x360),
        (ltc6804.adcv, {"discharge_permitted": True}, 0x370),
        (ltc6804.adcv, {"mode": AdcMode.FILTERED}, 0x3E0),
        (ltc6804.adcv, {"mode": AdcMode.FAST}, 0x2E0),
        (ltc6804.adcv, {"channel": 1}, 0x361),
        (ltc6804.adcv, {"channel": 6}, 0x366),
        (ltc6804.adcv, {"mode": AdcMode.FILTERED, "discharge_permitted": True, "channel": 3}, 0x3F3),
        (ltc6804.adax, {}, 0x560),
        (ltc6804.adax, {"mode": AdcMode.FAST}, 0x4E0),
        (ltc6804.adax, {"mode": AdcMode.FILTERED}, 0x5E0),
        (ltc6804.adax, {"channel": 6}, 0x566),
        (ltc6804.adstat, {}, 0x568),
        (ltc6804.adstat, {"mode": AdcMode.FAST}, 0x4E8),
        (ltc6804.adstat, {"channel": 4}, 0x56C),
    ],
)
def test_conversion_commands(convert, arguments, code):
    assert convert(**arguments) == code


def test_broadcast_and_addressed_packets():
    assert ltc6804.command_packet(Command.WRCFG).hex() == "00013d6e"
    assert ltc6804.command_packet(Command.RDCVA, 0).hex() == "800477d6"
    assert ltc6804.command_packet(Command.RDCVA, 1).hex() == "88048428"
    assert ltc6804.command_packet(Command.RDCVD, 7).hex() == "b80af5bc"


@pytest.mark.parametrize("address", [None, 0, 7, 15])
@pytest.mark.parametrize("command", [Command.WRCFG, Command.STCOMM, ltc6804.adcv()])
def test_command_packet_is_understood(command, address):
    assert ltc6804.decode_command(ltc6804.command_packet(command, address)) == (command, address)


@pytest.mark.parametrize(
    ("packet", "reason", "offset"),
    [
        ("", "0 bytes, at least 4", None),
        ("00013d", "3 bytes, at least 4", None),
        ("00013d6f", "PEC", 2),
        ("0801" + f"{ltc6804.pec15(bytes([8, 1])):04x}", "address bits without the address mark", 0),
    ],
)
def test_packet_that_is_none_is_refused(packet, reason, offset):
    with pytest.raises(DecodeError) as refused:
        ltc6804.decode_command(bytes.fromhex(packet))
    assert (refused.value.what, refused.value.reason, refused.value.offset) == ("LTC6804 command", reason, offset)


def test_a_broadcast_with_the_highest_command_is_understood():
    assert ltc6804.decode_command(ltc6804.command_packet(0x7FF)) == (0x7FF, None)
    assert ltc6804.decode_command(ltc6804.command_packet(0, 15)) == (0, 15)


def test_write_packet_carries_two_pecs():
    packet = ltc6804.write_packet(Command.WRCFG, bytes.fromhex("059846A40010"), 3)
    assert len(packet) == 12
    assert ltc6804.decode_command(packet) == (Command.WRCFG, 3)
    assert ltc6804.decode_group(packet[4:]) == bytes.fromhex("059846A40010")


@pytest.mark.parametrize("flipped", range(64))
def test_any_flipped_bit_of_a_group_is_noticed(flipped):
    reply = bytearray(ltc6804.with_pec(bytes.fromhex("889088908890")))
    reply[flipped // 8] ^= 1 << flipped % 8
    with pytest.raises(DecodeError) as refused:
        ltc6804.decode_group(bytes(reply))
    assert (refused.value.what, refused.value.reason, refused.value.offset) == ("LTC6804 register group", "PEC", 6)


@pytest.mark.parametrize("size", [0, 6, 7, 9])
def test_a_group_and_its_pec_are_eight_bytes(size):
    with pytest.raises(DecodeError) as refused:
        ltc6804.decode_group(bytes(size))
    assert (refused.value.what, refused.value.reason) == ("LTC6804 register group", f"{size} bytes, not 8")


def test_cell_group_is_low_byte_first_and_ffff_is_missing():
    assert ltc6804.decode_words(bytes.fromhex("88 90 FF FF 10 A4")) == (37000, None, 42000)
    assert ltc6804.encode_words((37000, None, 42000)) == bytes.fromhex("8890FFFF10A4")


def test_documented_default_configuration():
    cfgr = Configuration.from_bytes(bytes.fromhex("059846A40010"))
    assert (cfgr.reference_on, cfgr.adc_option, cfgr.discharge_timer_code) == (True, True, 1)
    assert cfgr.under_voltage_v == pytest.approx(2.7024)
    assert cfgr.over_voltage_v == pytest.approx(4.2048)
    assert not any(cfgr.discharging)
    assert cfgr.to_bytes() == bytes.fromhex("059846A40010")


def test_thresholds_of_the_cell():
    cfgr = Configuration(under_voltage_code=0x619, over_voltage_code=0xA41)
    assert (cfgr.under_voltage_v, cfgr.over_voltage_v) == pytest.approx((2.5, 4.2), abs=1e-3)
    assert cfgr.to_bytes()[1:4] == bytes([0x19, 0x16, 0xA4])


@pytest.mark.parametrize(("cell", "bytes_4_5"), [(0, "0100"), (7, "8000"), (8, "0001"), (11, "0008")])
def test_each_cell_has_its_discharge_bit(cell, bytes_4_5):
    discharging = tuple(i == cell for i in range(12))
    assert Configuration(discharging=discharging).to_bytes()[4:].hex() == bytes_4_5


@pytest.mark.parametrize("data", ["000000000000", "ffffffffffff", "059846a40010", "a5c3e1f00918"])
def test_groups_there_and_back(data):
    raw = bytes.fromhex(data)
    assert Configuration.from_bytes(raw).to_bytes() == raw
    assert StatusA.from_bytes(raw).to_bytes() == raw
    assert ltc6804.encode_words(ltc6804.decode_words(raw)) == raw


@pytest.mark.parametrize("data", ["000000000000", "fffffffffff3", "50c30c000071"])
def test_status_b_there_and_back(data):
    assert StatusB.from_bytes(bytes.fromhex(data)).to_bytes() == bytes.fromhex(data)


def test_status_in_units():
    status = StatusA.from_bytes(bytes.fromhex("4059 5656 50C3"))
    assert status.total_v == pytest.approx(45.696)
    assert status.die_degc == pytest.approx(0x5656 * 1e-4 / 7.5e-3 - 273)
    assert StatusA(None, None, None).total_v is None
    assert StatusA(None, None, None).die_degc is None
    flags = StatusB.from_bytes(bytes.fromhex("50C3 060000 71"))
    assert (flags.over_voltage[0], flags.under_voltage[1], flags.under_voltage[0]) == (True, True, False)
    assert (flags.revision, flags.thermal_shutdown, flags.multiplexer_failed) == (7, True, False)


@pytest.mark.parametrize(
    ("call", "field", "value", "limit"),
    [
        (lambda: ltc6804.adcv(channel=7), "channel", 7, "0..6"),
        (lambda: ltc6804.adax(channel=-1), "channel", -1, "0..6"),
        (lambda: ltc6804.adstat(channel=5), "channel", 5, "0..4"),
        (lambda: ltc6804.command_packet(0x800), "command", 0x800, "0..0x7ff"),
        (lambda: ltc6804.command_packet(-1), "command", -1, "0..0x7ff"),
        (lambda: ltc6804.command_packet(1, 16), "address", 16, "0..15"),
        (lambda: ltc6804.command_packet(1, -1), "address", -1, "0..15"),
        (lambda: ltc6804.write_packet(1, bytes(5)), "data", "5 bytes", "6 bytes"),
        (lambda: Configuration(under_voltage_code=4096).to_bytes(), "under_voltage_code", 4096, "0..4095"),
        (lambda: Configuration(over_voltage_code=-1).to_bytes(), "over_voltage_code", -1, "0..4095"),
        (lambda: Configuration(over_voltage_code=4096).to_bytes(), "over_voltage_code", 4096, "0..4095"),
        (lambda: Configuration(discharge_timer_code=16).to_bytes(), "discharge_timer_code", 16, "0..15"),
        (lambda: Configuration(discharging=(True,) * 11).to_bytes(), "discharging", 11, "12 cells"),
    ],
)
def test_what_does_not_fit_names_its_limit(call, field, value, limit):
    with pytest.raises(EncodeError) as refused:
        call()
    assert (refused.value.field, refused.value.value, refused.value.limit) == (field, value, limit)


def test_codes_at_their_limits():
    full = Configuration(under_voltage_code=4095, over_voltage_code=4095, discharge_timer_code=15)
    assert full.to_bytes() == bytes.fromhex("fcffffff00f0")


def test_the_flags_of_the_configuration_have_their_bits():
    plain = Configuration(gpio_pull_down_off=(False,) * 5, reference_on=False)
    assert plain.to_bytes() == bytes(6)
    assert Configuration().to_bytes() == bytes.fromhex("fc0000000000"), "as the chip starts"
    for flags, first in (
        ({"gpio_pull_down_off": (True, False, False, False, False)}, 0x08),
        ({"gpio_pull_down_off": (False, False, False, False, True)}, 0x80),
        ({"reference_on": True}, 0x04),
        ({"software_timer_enabled": True}, 0x02),
        ({"adc_option": True}, 0x01),
    ):
        configuration = replace(plain, **flags)
        assert configuration.to_bytes()[0] == first
        assert Configuration.from_bytes(bytes([first]) + bytes(5)) == configuration


@pytest.mark.parametrize("cell", [0, 5, 11])
def test_status_flags_of_each_cell_have_their_bits(cell):
    one = tuple(i == cell for i in range(12))
    none = (False,) * 12
    under = StatusB(30000, one, none)
    over = StatusB(None, none, one, revision=15, multiplexer_failed=True)
    assert under.to_bytes() == b"\x30\x75" + (1 << 2 * cell).to_bytes(3, "little") + b"\x00"
    assert over.to_bytes() == b"\xff\xff" + (2 << 2 * cell).to_bytes(3, "little") + b"\xf2"
    assert [StatusB.from_bytes(status.to_bytes()) for status in (under, over)] == [under, over]


def test_a_status_with_flags_for_fewer_cells_on_one_side_is_refused():
    with pytest.raises(ValueError, match="shorter"):
        StatusB(0, (False,) * 12, (False,) * 11).to_bytes()


@pytest.mark.parametrize("size", [0, 5, 7])
@pytest.mark.parametrize(
    "parse", [Configuration.from_bytes, StatusA.from_bytes, StatusB.from_bytes, ltc6804.decode_words]
)
def test_group_of_the_wrong_length_is_refused(parse, size):
    with pytest.raises(DecodeError) as refused:
        parse(bytes(size))
    assert (refused.value.what, refused.value.reason) == ("LTC6804 register group", f"{size} bytes, not 6")
