import pytest

from firmware_protocol.elcon import ChargerCommand, ChargerFlags, ChargerStatus
from firmware_protocol.errors import DecodeError, EncodeError


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        (ChargerCommand(98.0, 16.0, is_charging=True), "03D400A000000000"),  # the vendor's example
        (ChargerCommand(403.2, 16.0, is_charging=True), "0FC000A000000000"),
        (ChargerCommand(403.2, 0.0, is_charging=False), "0FC0000001000000"),
        (ChargerCommand(403.16, 11.96, is_charging=True), "0FC0007800000000"),
    ],
)
def test_command_bytes(command, expected):
    assert command.to_bytes() == bytes.fromhex(expected)


def test_command_is_understood():
    assert ChargerCommand.from_bytes(bytes.fromhex("03D400A000000000")) == ChargerCommand(98.0, 16.0, is_charging=True)


@pytest.mark.parametrize("control", [1, 2, 0xFF])
def test_any_control_but_zero_stops(control):
    assert not ChargerCommand.from_bytes(bytes([3, 0xD4, 0, 0xA0, control, 0, 0, 0])).is_charging


def test_status_there_and_back():
    data = bytes.fromhex("0FA8007B09000000")
    status = ChargerStatus.from_bytes(data)
    assert status == ChargerStatus(400.8, 12.3, ChargerFlags.HARDWARE | ChargerFlags.BATTERY)
    assert status.to_bytes() == data


def test_flag_bits_without_a_meaning_are_kept():
    data = bytes.fromhex("00000000E0000000")
    assert ChargerStatus.from_bytes(data).to_bytes() == data


def test_reserved_bytes_do_not_matter():
    assert ChargerStatus.from_bytes(bytes.fromhex("0FA8007B00ABCDEF")) == ChargerStatus(400.8, 12.3)


@pytest.mark.parametrize("size", [0, 7, 9])
@pytest.mark.parametrize(("kind", "what"), [(ChargerCommand, "charger command"), (ChargerStatus, "charger status")])
def test_wrong_length_is_refused(kind, what, size):
    with pytest.raises(DecodeError) as refused:
        kind.from_bytes(bytes(size))
    assert (refused.value.what, refused.value.reason) == (what, f"{size} bytes, not 8")


@pytest.mark.parametrize("value", [-0.1, 6553.6, float("nan"), float("inf")])
@pytest.mark.parametrize("field", ["voltage_v", "current_a"])
@pytest.mark.parametrize("kind", [ChargerCommand, ChargerStatus])
def test_value_that_does_not_fit_names_its_limit(kind, field, value):
    values = {"voltage_v": 0.0, "current_a": 0.0} | {field: value}
    message = kind(**values, is_charging=True) if kind is ChargerCommand else kind(**values)
    with pytest.raises(EncodeError) as refused:
        message.to_bytes()
    assert (refused.value.field, refused.value.limit) == (field, "0..6553.5")
    assert refused.value.value is value


def test_the_highest_values_fit():
    assert ChargerCommand(6553.5, 6553.5, is_charging=True).to_bytes() == bytes.fromhex("FFFFFFFF00000000")
    assert ChargerStatus(6553.5, 0.0, ChargerFlags(0x1FF)).to_bytes() == bytes.fromhex("FFFF0000FF000000")
