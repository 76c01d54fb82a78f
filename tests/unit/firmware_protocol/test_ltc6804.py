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
    ("command", "code"),
    [
        (ltc6804.adcv(), 0x360),
        (ltc6804.adcv(discharge_permitted=True), 0x370),
        (ltc6804.adcv(AdcMode.FILTERED), 0x3E0),
        (ltc6804.adcv(AdcMode.FAST), 0x2E0),
        (ltc6804.adcv(channel=6), 0x366),
        (ltc6804.adax(), 0x560),
        (ltc6804.adax(AdcMode.FAST), 0x4E0),
        (ltc6804.adax(AdcMode.FILTERED), 0x5E0),
        (ltc6804.adstat(), 0x568),
    ],
)
def test_conversion_commands(command, code):
    assert command == code


def test_broadcast_and_addressed_packets():
    assert ltc6804.command_packet(Command.WRCFG).hex() == "00013d6e"
    assert ltc6804.command_packet(Command.RDCVA, 0).hex() == "800477d6"
    assert ltc6804.command_packet(Command.RDCVA, 1).hex() == "88048428"
    assert ltc6804.command_packet(Command.RDCVD, 7).hex() == "b80af5bc"


@pytest.mark.parametrize("address", [None, 0, 7, 15])
@pytest.mark.parametrize("command", [Command.WRCFG, Command.STCOMM, ltc6804.adcv()])
def test_command_packet_is_understood(command, address):
    assert ltc6804.decode_command(ltc6804.command_packet(command, address)) == (command, address)


@pytest.mark.parametrize("packet", ["", "00013d", "00013d6f", "0801" + f"{ltc6804.pec15(bytes([8, 1])):04x}"])
def test_packet_that_is_none_is_refused(packet):
    with pytest.raises(DecodeError):
        ltc6804.decode_command(bytes.fromhex(packet))


def test_write_packet_carries_two_pecs():
    packet = ltc6804.write_packet(Command.WRCFG, bytes.fromhex("059846A40010"), 3)
    assert len(packet) == 12
    assert ltc6804.decode_command(packet) == (Command.WRCFG, 3)
    assert ltc6804.decode_group(packet[4:]) == bytes.fromhex("059846A40010")


@pytest.mark.parametrize("flipped", range(64))
def test_any_flipped_bit_of_a_group_is_noticed(flipped):
    reply = bytearray(ltc6804.with_pec(bytes.fromhex("889088908890")))
    reply[flipped // 8] ^= 1 << flipped % 8
    with pytest.raises(DecodeError):
        ltc6804.decode_group(bytes(reply))


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
    assert ltc6804.voltage_codes(2.5, 4.2) == (0x619, 0xA41)
    cfgr = Configuration(under_voltage_code=0x619, over_voltage_code=0xA41)
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
    "call",
    [
        lambda: ltc6804.adcv(channel=7),
        lambda: ltc6804.adstat(channel=5),
        lambda: ltc6804.command_packet(0x800),
        lambda: ltc6804.command_packet(1, 16),
        lambda: ltc6804.write_packet(1, bytes(5)),
        lambda: ltc6804.voltage_codes(0.0, 4.2),
        lambda: ltc6804.voltage_codes(2.5, 6.56),
        lambda: Configuration(under_voltage_code=4096).to_bytes(),
        lambda: Configuration(discharge_timer_code=16).to_bytes(),
        lambda: Configuration(discharging=(True,) * 11).to_bytes(),
    ],
)
def test_what_does_not_fit_is_refused(call):
    with pytest.raises(EncodeError):
        call()


@pytest.mark.parametrize("parse", [Configuration.from_bytes, StatusA.from_bytes, StatusB.from_bytes])
def test_group_of_the_wrong_length_is_refused(parse):
    with pytest.raises(DecodeError):
        parse(bytes(5))
