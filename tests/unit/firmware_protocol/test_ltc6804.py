import pytest

from firmware_protocol import ltc6804
from firmware_protocol.errors import DecodeError
from firmware_protocol.ltc6804 import Command
from tests.ltc6804_packets import Configuration, command_packet, write_packet


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
    assert ltc6804.decode_command(command_packet(0x7FF)) == (0x7FF, None)
    assert ltc6804.decode_command(command_packet(0, 15)) == (0, 15)


def test_documented_default_configuration():
    packet = write_packet(Command.WRCFG, bytes.fromhex("059846A40010"), 3)
    assert ltc6804.decode_command(packet) == (Command.WRCFG, 3)
    cfgr = Configuration.from_bytes(ltc6804.decode_group(packet[4:]))
    assert (cfgr.reference_on, cfgr.adc_option, cfgr.discharge_timer_code) == (True, True, 1)
    assert (cfgr.under_voltage_v, cfgr.over_voltage_v) == pytest.approx((2.7024, 4.2048))
    assert not any(cfgr.discharging)
    assert cfgr.to_bytes() == bytes.fromhex("059846A40010")


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
