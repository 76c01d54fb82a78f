import pytest

from firmware_protocol import messages
from firmware_protocol.errors import DecodeError, EncodeError
from firmware_protocol.framing import MAX_BODY, Frame
from firmware_protocol.memory_map import CONFIG_SIZE, MAP_HASH, MASTER_SIZE
from firmware_protocol.messages import (
    MAX_READ,
    Command,
    CommandId,
    Data,
    Event,
    EventCode,
    Ident,
    IdentRequest,
    Load,
    MessageType,
    Read,
    Reply,
    Result,
    Store,
    Window,
    Write,
)


@pytest.mark.parametrize(
    ("message", "kind", "body"),
    [
        (Data((Window(1884, b"\xfb\xff\xff\xff"),)), MessageType.DATA, "5c07 0400 fbffffff"),
        (Data((Window(2982, b"\x07\x27"), Window(440, b"\x08"))), MessageType.DATA, "a60b 0200 0727 b801 0100 08"),
        (Data(()), MessageType.DATA, ""),
        (Reply(MessageType.WRITE, 9, Result.OUT_OF_RANGE, 4), MessageType.REPLY, "12 09 04 0400"),
        (Reply(MessageType.READ, 255, Result.DONE, data=b"\x64\x00"), MessageType.REPLY, "11 ff 00 ffff 6400"),
        (Event(EventCode.TRIP_V_MAX, 0, 36, 42013, 42000), MessageType.EVENT, "03 00 2400 1da40000 10a40000"),
        (Event(200, 1, 0xFFFF, -1, 0), MessageType.EVENT, "c8 01 ffff ffffffff 00000000"),
    ],
)
def test_messages_from_the_master(message, kind, body):
    raw = bytes.fromhex(body)
    assert message.to_body() == raw
    assert messages.decode_message(Frame(kind, 0, 0, raw)) == message


@pytest.mark.parametrize(
    ("request_", "kind", "body"),
    [
        (IdentRequest(), MessageType.IDENT, ""),
        (Read(0x8000, 64), MessageType.READ, "0080 4000"),
        (Write(4, b"\x1c\xa2"), MessageType.WRITE, "0400 0200 1ca2"),
        (Store(), MessageType.STORE, ""),
        (Load(), MessageType.LOAD, ""),
        (Command(CommandId.SET_SOC, 9991), MessageType.COMMAND, "07 07270000"),
        (Command(CommandId.FAN_OVERRIDE, -1), MessageType.COMMAND, "05 ffffffff"),
        (Command(CommandId.CLEAR_FAULTS), MessageType.COMMAND, "06 00000000"),
    ],
)
def test_requests(request_, kind, body):
    raw = bytes.fromhex(body)
    assert messages.encode_request(request_) == (kind, raw)
    assert messages.decode_request(Frame(kind, 0, 0, raw)) == request_


def test_ident_reply():
    ident = Ident((1, 2, 3), reset_cause=1, boots=0x01020304)
    data = ident.to_bytes()
    assert data == bytes([1, 0, 1, 2, 3]) + MAP_HASH + bytes([1, 4, 3, 2, 1])
    assert Ident.from_bytes(data) == ident
    assert Ident.from_bytes(data + b"later") == ident
    with pytest.raises(DecodeError):
        Ident.from_bytes(data[:-1])


@pytest.mark.parametrize(
    ("ident", "compatible"),
    [
        (Ident((9, 9, 9)), True),
        (Ident((1, 0, 0), map_hash=bytes(8)), False),
        (Ident((1, 0, 0), protocol=2), False),
    ],
)
def test_only_the_same_map_and_protocol_may_be_written(ident, compatible):
    assert ident.is_compatible is compatible


@pytest.mark.parametrize(
    ("kind", "body"),
    [
        (MessageType.DATA, "5c07"),
        (MessageType.DATA, "5c07 0400 fbffff"),
        (MessageType.DATA, "a70b 0200 0000"),  # ends one byte beyond the struct
        (MessageType.DATA, "0000 0100 00 5c07 04"),  # a good window before a cut one counts neither
        (MessageType.REPLY, "11 ff 00 ff"),
        (MessageType.EVENT, "03 00 2400 1da40000 10a400"),
        (MessageType.EVENT, "03 00 2400 1da40000 10a4000000"),
        (MessageType.READ, ""),
        (0x7F, ""),
    ],
)
def test_message_that_does_not_fit_its_body_is_refused(kind, body):
    with pytest.raises(DecodeError):
        messages.decode_message(Frame(kind, 0, 0, bytes.fromhex(body)))


@pytest.mark.parametrize(
    ("kind", "body"),
    [
        (MessageType.IDENT, "00"),
        (MessageType.STORE, "00"),
        (MessageType.READ, "000040"),
        (MessageType.READ, "0000400000"),
        (MessageType.WRITE, "000001"),
        (MessageType.WRITE, "0000 0200 01"),
        (MessageType.WRITE, "0000 0100 0102"),
        (MessageType.COMMAND, "06000000"),
        (MessageType.DATA, ""),
        (0x21, ""),
    ],
)
def test_request_that_does_not_fit_its_body_is_refused(kind, body):
    with pytest.raises(DecodeError):
        messages.decode_request(Frame(kind, 0, 0, bytes.fromhex(body)))


@pytest.mark.parametrize(
    "request_",
    [
        Read(0, 0),
        Read(0, MAX_READ + 1),
        Read(-1, 1),
        Read(0x10000, 1),
        Write(CONFIG_SIZE - 1, b"ab"),
        Write(0, b""),
        Write(-1, b"a"),
    ],
)
def test_request_that_cannot_be_sent_is_refused(request_):
    with pytest.raises(EncodeError):
        messages.encode_request(request_)


def test_the_whole_configuration_fits_one_write_and_one_read():
    assert len(messages.encode_request(Write(0, bytes(CONFIG_SIZE)))[1]) <= MAX_BODY
    assert CONFIG_SIZE <= MAX_READ


@pytest.mark.parametrize(
    "data",
    [
        Data((Window(MASTER_SIZE - 1, b"ab"),)),
        Data((Window(-1, b"a"),)),
        Data((Window(0, bytes(300)), Window(300, bytes(300)))),
    ],
)
def test_data_that_cannot_be_sent_is_refused(data):
    with pytest.raises(EncodeError):
        data.to_body()


@pytest.mark.parametrize(
    "message",
    [
        Reply(0x11, 256, Result.DONE),
        Reply(0x11, 0, Result.DONE, -1),
        Event(1, 0, 0x10000, 0, 0),
        Event(1, 0, 0, 1 << 31, 0),
    ],
)
def test_message_with_a_number_that_does_not_fit_is_refused(message):
    with pytest.raises(EncodeError):
        message.to_body()


def test_ident_with_a_number_that_does_not_fit_is_refused():
    with pytest.raises(EncodeError):
        Ident((1, 0, 256)).to_bytes()


@pytest.mark.parametrize("command", [Command(256), Command(-1), Command(1, 1 << 31)])
def test_command_that_does_not_fit_is_refused(command):
    with pytest.raises(EncodeError):
        messages.encode_request(command)
