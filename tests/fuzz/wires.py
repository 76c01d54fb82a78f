"""Fuzz targets for what comes off a wire: frames, messages, the whole chain behind the master, a fleet's broker."""

import json
import math
import struct
from functools import cache

from app.service.mqtt.cars import TOPICS, Car
from app.sources.items import CanItem, LinkChange, SerialItem
from firmware_protocol.errors import DecodeError
from firmware_protocol.framing import Frame, FrameDecoder, decode_chunk, encode_frame
from firmware_protocol.messages import (
    Data,
    EventMessage,
    Ident,
    MessageType,
    Reply,
    decode_message,
)

WALL_NS = 1_700_000_000_000_000_000
STATES = ("connecting", "open", "lost")


def framing(data: bytes) -> None:
    """In pieces as in whole; a frame that was understood is the only one with these bytes."""
    size, wire = 1 + data[0] if data else 1, data[1:]
    whole, parts = FrameDecoder(), FrameDecoder()
    found = whole.feed(wire)
    pieces = [item for i in range(0, len(wire), size) for item in parts.feed(wire[i : i + size])]
    assert pieces == found, f"{pieces} in pieces of {size}, {found} in whole"
    for item in found:
        if isinstance(item, Frame):
            again = encode_frame(item.type, item.sequence, item.uptime_ms, item.body)
            assert decode_chunk(again[1:-1]) == item


def messages(data: bytes) -> None:
    """A body of any type is refused, or is what encoding its meaning gives."""
    frame = Frame(data[0] if data else 0, 0, 0, data[1:513])
    try:
        message = decode_message(frame)
    except DecodeError:
        pass
    else:
        if isinstance(message, Data | Reply | EventMessage):
            assert message.to_body() == frame.body, message
        if isinstance(message, Reply) and message.request_type == MessageType.IDENT:
            try:
                ident = Ident.from_bytes(message.data)
            except DecodeError:
                pass
            else:
                assert message.data.startswith(ident.to_bytes()), "later versions may append"


@cache
def _honest():
    from tests.property.test_pipeline_fuzz import assert_honest, new_pipeline

    return assert_honest, new_pipeline


def master(data: bytes) -> None:
    """Steps of kind u8, pause u8, length u8 and bytes: the chain behind the master's two links says nothing wrong."""
    assert_honest, new_pipeline = _honest()
    pipeline = new_pipeline(("coulomb", "fused", "ekf")[data[0] % 3] if data else "coulomb")
    t_ns, wall_ns, at = 1_000_000_000, WALL_NS, 1
    for _ in range(40):
        if at + 3 > len(data):
            break
        kind, pause, length = data[at : at + 3]
        what = data[at + 3 : at + 3 + length]
        at += 3 + length
        t_ns += int(1e6 * (0, 1, 100, 2_000, 20_000, 7_200_000)[pause % 6])
        wall_ns += int(1e9 * (0, 0.1, -86_400, 86_400)[(pause >> 4) % 4])
        if kind % 6 == 0 and len(what) >= 6:
            kind_of, sequence, uptime = struct.unpack_from("<BBI", what)
            raw = encode_frame(kind_of, sequence, uptime, what[6:])[1:-1]
            assert_honest(pipeline.feed(SerialItem(t_ns, wall_ns, decode_chunk(raw))))
        elif kind % 6 == 1:
            for found in FrameDecoder().feed(b"\0" + what + b"\0"):
                assert_honest(pipeline.feed(SerialItem(t_ns, wall_ns, found)))
        elif kind % 6 == 2 and len(what) >= 4:
            item = CanItem(t_ns, wall_ns, int.from_bytes(what[:4], "little"), what[4:68], sent=bool(kind & 64))
            assert_honest(pipeline.feed(item))
        elif kind % 6 == 3 and what:
            state = STATES[what[0] % 3]
            link = ("rs232", "can")[what[0] >> 7]
            change = LinkChange(t_ns, wall_ns, link, state, "why" if state == "lost" else None)
            assert_honest(pipeline.feed(change))
        elif kind % 6 == 4 and len(what) >= 2:  # a window of values at a place of the struct
            offset = int.from_bytes(what[:2], "little") % 2984
            body = struct.pack("<HH", offset, len(what) - 2) + what[2:]
            raw = encode_frame(MessageType.DATA, 0, t_ns // 1_000_000 & 0xFFFFFFFF, body)[1:-1]
            assert_honest(pipeline.feed(SerialItem(t_ns, wall_ns, decode_chunk(raw))))
        else:
            assert_honest(pipeline.tick(t_ns, wall_ns))


def mqtt(data: bytes) -> None:
    """Steps of topic u8, pause u8, length u16 and a body: a car is shown in JSON, old values never as live."""
    car, now_s, at, topics = Car("red"), 100.0, 0, sorted(TOPICS)
    for _ in range(30):
        if at + 4 > len(data):
            break
        topic, pause, length = struct.unpack_from("<BBH", data, at)
        body = data[at + 4 : at + 4 + length]
        at += 4 + length
        now_s += (0.0, 0.2, 1.0, 5.0, 60.0)[pause % 5]
        car.take(topics[topic % len(topics)], body, now_s, is_retained=bool(topic & 0x80))
        shown = car.shown(now_s, 1.7e9)
        json.loads(json.dumps(shown, allow_nan=False))
        age_s = car.age_s("voltage", now_s)
        assert age_s is None or (age_s >= 0 and math.isfinite(age_s)), age_s
        assert shown["state"] in ("live", "late", "silent", "vanished")
        later = car.shown(now_s + 60.0, 1.7e9)
        assert later["state"] != "live", "what was heard a minute ago is live"
