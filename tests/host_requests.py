"""Requests of the host as a master reads them, for tests that play one."""

from firmware_protocol.errors import DecodeError
from firmware_protocol.framing import Frame
from firmware_protocol.messages import Command, IdentRequest, Load, MessageType, Read, Request, Store, Write

EMPTY = {MessageType.IDENT: IdentRequest, MessageType.STORE: Store, MessageType.LOAD: Load}


def decode_request(frame: Frame) -> Request:
    """The request in a frame; DecodeError where its type is unknown or its body does not fit it."""
    kind, body = frame.type, frame.body
    numbers = [int.from_bytes(body[at : at + 2], "little") for at in (0, 2)]
    if kind in EMPTY and not body:
        return EMPTY[kind]()
    if kind == MessageType.READ and len(body) == 4:
        return Read(*numbers)
    if kind == MessageType.WRITE and len(body) >= 4 and numbers[1] == len(body) - 4:
        return Write(numbers[0], body[4:])
    if kind == MessageType.COMMAND and len(body) == 5:
        return Command(body[0], int.from_bytes(body[1:], "little", signed=True))
    known = kind in {*EMPTY, MessageType.READ, MessageType.WRITE, MessageType.COMMAND}
    raise DecodeError(MessageType(kind).name if known else "request", "length")
