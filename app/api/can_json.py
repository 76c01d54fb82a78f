"""CAN tables and traced frames as JSON; offsets get the names of what lies there."""

from typing import Any

from app.telemetry import CanItem
from app.trace import CanTrace, TracedId
from firmware_protocol.can_tables import RxMessage, TxMessage, bit_rate, bus_load, rx_messages, tx_messages
from firmware_protocol.memory_map import BYTE_UNUSED, CAN_ID_EXTENDED, CONFIG, Field, element_name, locate


def signals_of(offsets: tuple[int, ...], length: int) -> list[dict[str, Any]]:
    """Name what a message carries: runs of bytes that belong to one element, in ascending or descending order."""
    signals: list[dict[str, Any]] = []
    position = 0
    while position < length:
        place = None if offsets[position] == BYTE_UNUSED else locate(offsets[position])
        if place is None:
            position += 1
            continue
        field, element, first = place
        count = 1
        step = 1 if field.item_size == 1 or first == 0 else -1
        while (
            position + count < length
            and count < field.item_size
            and locate_byte(offsets[position + count]) == (field.name, element, first + step * count)
        ):
            count += 1
        signals.append(
            {
                "name": _signal_name(field, element, first, count),
                "start_byte": position,
                "length": count,
                "byte_order": "little" if step == 1 else "big",
                "unit": field.unit,
                "scale": field.scale,
                "type": field.fmt,
                "complete": count == field.item_size,
            }
        )
        position += count
    return signals


def locate_byte(offset: int) -> tuple[str, int, int] | None:
    """(field, element, byte) at an offset of the struct."""
    place = None if offset == BYTE_UNUSED else locate(offset)
    return None if place is None else (place[0].name, place[1], place[2])


def _signal_name(field: Field, element: int, first: int, count: int) -> str:
    name = element_name(field, element)
    return name if count == field.item_size else f"{name}.byte{first}"


def _message_json(message: TxMessage | RxMessage) -> dict[str, Any]:
    return {
        "index": message.index,
        "enabled": message.enabled,
        "id": message.can_id,
        "extended": message.is_extended,
        "length": message.length,
        "bytes": list(message.data_offsets),
        "signals": signals_of(message.data_offsets, message.length),
    }


def tables_json(image: bytes, rx_active: int | None) -> dict[str, Any]:
    """Both tables."""
    return {
        "bit_rate": bit_rate(CONFIG["can_brp"].unpack(image)[0]),
        "bus_load": bus_load(image),
        "tx": [_message_json(m) | {"period_ms": m.period_ms} for m in tx_messages(image)],
        "rx": [
            _message_json(m)
            | {
                "timeout_ms": m.timeout_ms,
                "response": m.response,
                "active": None if rx_active is None else bool(rx_active >> m.index & 1),
            }
            for m in rx_messages(image)
        ],
    }


def _frame_json(item: CanItem, name: str | None) -> dict[str, Any]:
    return {
        "time": item.t_wall_ns / 1e9,
        "id": item.can_id & ~CAN_ID_EXTENDED,
        "extended": bool(item.can_id & CAN_ID_EXTENDED),
        "direction": "tx" if item.sent else "rx",
        "data": item.data.hex(),
        "name": name,
    }


def traced_json(trace: CanTrace, limit: int, image: bytes) -> dict[str, Any]:
    """The newest frames and one entry an id, named by the tables."""
    names: dict[int, str] = {}
    for prefix, messages in (("tx", tx_messages(image)), ("rx", rx_messages(image))):
        for message in messages:
            if message.length:
                names[message.can_id | (CAN_ID_EXTENDED if message.is_extended else 0)] = f"{prefix} {message.index}"

    def entry(known: TracedId) -> dict[str, Any]:
        frame = _frame_json(known.latest, names.get(known.latest.can_id))
        return frame | {"count": known.count, "period_s": known.period_s, "changed": known.changed}

    return {
        "frames": [_frame_json(item, names.get(item.can_id)) for item in trace.latest(limit)],
        "by_id": [entry(known) for _, known in sorted(trace.by_id().items())],
    }
