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
    EventCode,
    EventMessage,
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
        (EventMessage(EventCode.TRIP_V_MAX, 0, 36, 42013, 42000), MessageType.EVENT, "03 00 2400 1da40000 10a40000"),
        (EventMessage(200, 1, 0xFFFF, -1, 0), MessageType.EVENT, "c8 01 ffff ffffffff 00000000"),
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


def test_ident_reply():
    ident = Ident((1, 2, 3), reset_cause=1, boots=0x01020304)
    data = ident.to_bytes()
    assert data == bytes([1, 0, 1, 2, 3]) + MAP_HASH + bytes([1, 4, 3, 2, 1])
    assert Ident.from_bytes(data) == ident
    assert Ident.from_bytes(data + b"later") == ident
    with pytest.raises(DecodeError) as refused:
        Ident.from_bytes(data[:-1])
    assert (refused.value.what, refused.value.reason) == ("IDENT", "17 bytes, at least 18")


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
    ("kind", "body", "what", "reason", "offset"),
    [
        (MessageType.DATA, "5c07", "DATA", "window header cut", 0),
        (MessageType.DATA, "0000 0100 00 5c07 04", "DATA", "window header cut", 5),
        (MessageType.DATA, "5c07 0400 fbffff", "DATA", "window of 4 bytes cut", 4),
        (MessageType.DATA, "a70b 0200 0000", "DATA", "window 2983+2 ends beyond 2984", 4),
        (MessageType.REPLY, "11 ff 00 ff", "REPLY", "4 bytes, at least 5", None),
        (MessageType.EVENT, "03 00 2400 1da40000 10a400", "EVENT", "11 bytes, not 12", None),
        (MessageType.EVENT, "03 00 2400 1da40000 10a4000000", "EVENT", "13 bytes, not 12", None),
        (MessageType.READ, "", "message", "unknown type 0x11", None),
        (0x7F, "", "message", "unknown type 0x7f", None),
    ],
)
def test_message_that_does_not_fit_its_body_is_refused(kind, body, what, reason, offset):
    with pytest.raises(DecodeError) as refused:
        messages.decode_message(Frame(kind, 0, 0, bytes.fromhex(body)))
    assert (refused.value.what, refused.value.reason, refused.value.offset) == (what, reason, offset)


@pytest.mark.parametrize(
    ("request_", "field", "value", "limit"),
    [
        (Read(0, 0), "length", 0, "1..507"),
        (Read(0, MAX_READ + 1), "length", 508, "1..507"),
        (Read(-1, 1), "offset", -1, "0..65535"),
        (Read(0x10000, 1), "offset", 65536, "0..65535"),
        (Write(CONFIG_SIZE - 1, b"ab"), "window", "419+2", "within the configuration, 0..420"),
        (Write(0, b""), "window", "0+0", "within the configuration, 0..420"),
        (Write(-1, b"a"), "window", "-1+1", "within the configuration, 0..420"),
    ],
)
def test_request_that_cannot_be_sent_names_the_limit(request_, field, value, limit):
    with pytest.raises(EncodeError) as refused:
        messages.encode_request(request_)
    assert (refused.value.field, refused.value.value, refused.value.limit) == (field, value, limit)


@pytest.mark.parametrize(
    ("request_", "body"),
    [
        (Read(0xFFFF, 1), "ffff 0100"),
        (Read(0, MAX_READ), "0000 fb01"),
        (Write(CONFIG_SIZE - 1, b"a"), "a301 0100 61"),
    ],
)
def test_requests_at_their_limits_are_sent(request_, body):
    assert messages.encode_request(request_)[1] == bytes.fromhex(body)


def test_the_whole_configuration_fits_one_write_and_one_read():
    assert len(messages.encode_request(Write(0, bytes(CONFIG_SIZE)))[1]) <= MAX_BODY
    assert CONFIG_SIZE <= MAX_READ


@pytest.mark.parametrize(
    ("data", "field", "value", "limit"),
    [
        (Data((Window(MASTER_SIZE - 1, b"ab"),)), "window", "2983+2", "within 2984 bytes"),
        (Data((Window(-1, b"a"),)), "window", "-1+1", "within 2984 bytes"),
        (Data((Window(0, bytes(300)), Window(300, bytes(205)))), "body", "513 bytes", "at most 512 bytes"),
    ],
)
def test_data_that_cannot_be_sent_names_the_limit(data, field, value, limit):
    with pytest.raises(EncodeError) as refused:
        data.to_body()
    assert (refused.value.field, refused.value.value, refused.value.limit) == (field, value, limit)


@pytest.mark.parametrize(
    "windows", [(Window(MASTER_SIZE - 1, b"a"),), (Window(0, bytes(300)), Window(300, bytes(204))), (Window(5, b""),)]
)
def test_data_at_the_limits_goes_there_and_back(windows):
    assert Data.from_body(Data(windows).to_body()) == Data(windows)


@pytest.mark.parametrize(
    ("message", "field"),
    [
        (Reply(0x11, 256, Result.DONE), "REPLY"),
        (Reply(0x11, 0, Result.DONE, -1), "REPLY"),
        (EventMessage(1, 0, 0x10000, 0, 0), "EVENT"),
        (EventMessage(1, 0, 0, 1 << 31, 0), "EVENT"),
    ],
)
def test_message_with_a_number_that_does_not_fit_is_refused(message, field):
    with pytest.raises(EncodeError) as refused:
        message.to_body()
    assert refused.value.field == field


def test_ident_with_a_number_that_does_not_fit_is_refused():
    with pytest.raises(EncodeError) as refused:
        Ident((1, 0, 256)).to_bytes()
    assert refused.value.field == "IDENT"
    assert refused.value.value == (1, 1, 0, 256, MAP_HASH, 0, 0)


@pytest.mark.parametrize(
    ("command", "limit"), [(Command(256), "ubyte"), (Command(-1), "ubyte"), (Command(1, 1 << 31), "2147483647")]
)
def test_command_that_does_not_fit_names_the_limit(command, limit):
    with pytest.raises(EncodeError, match=limit) as refused:
        messages.encode_request(command)
    assert (refused.value.field, refused.value.value) == ("COMMAND", (command.id, command.argument))
