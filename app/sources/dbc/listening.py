"""Frames that are heard on a bus for some time, for learning and checking."""

import time

from app.errors import LinkLost, message_of
from app.sources.dbc.frames import Frames, TimedFrame, frames_of
from app.sources.links.can import parse_bus
from app.sources.links.python_can import can
from app.words import Message
from firmware_protocol.memory_map import CAN_ID_EXTENDED

_POLL_S = 0.2


def bus_frames(url: str, duration_s: float) -> Frames:
    """Listen to a bus and return what was heard; what was heard until then where Ctrl+C ends it.

    Raises:
        ConfigError: the bus is not INTERFACE:CHANNEL.
        LinkLost: the bus cannot be opened.
    """
    arguments = parse_bus(url)
    try:
        bus = can.Bus(**arguments)  # type: ignore[arg-type]
    except Exception as error:  # every driver raises its own
        raise LinkLost(Message("of-source", source=url, reason=message_of(error))) from error
    found: list[TimedFrame] = []
    end_s = time.monotonic() + duration_s
    try:
        while time.monotonic() < end_s:
            message = bus.recv(_POLL_S)
            if message is not None and not (message.is_error_frame or message.is_remote_frame):
                can_id = message.arbitration_id | (CAN_ID_EXTENDED if message.is_extended_id else 0)
                found.append((time.monotonic_ns(), can_id, bytes(message.data)))
    except KeyboardInterrupt:
        pass
    finally:
        bus.shutdown()
    return frames_of(found)
