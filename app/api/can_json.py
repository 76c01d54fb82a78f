"""CAN tables and traced frames as JSON; offsets get the names of what lies there."""

from dataclasses import asdict
from typing import Any

from app.telemetry import CanItem
from app.trace import CanTrace, TracedId
from firmware_protocol.can_tables import RxMessage, TxMessage, bit_rate, bus_load, rx_messages, tx_messages
from firmware_protocol.dbc import Signal, message_name, signals
from firmware_protocol.memory_map import CAN_ID_EXTENDED, CONFIG


def _signal_json(signal: Signal) -> dict[str, Any]:
    body = asdict(signal)
    del body["values"]
    return body | {"length": signal.length, "byte_order": signal.byte_order}


def _message_json(message: TxMessage | RxMessage) -> dict[str, Any]:
    return {
        "index": message.index,
        "enabled": message.enabled,
        "id": message.can_id,
        "extended": message.is_extended,
        "length": message.length,
        "bytes": list(message.data_offsets),
        "name": message_name(message),
        "signals": [_signal_json(signal) for signal in signals(message)],
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
    tables: tuple[TxMessage | RxMessage, ...] = (*tx_messages(image), *rx_messages(image))
    for message in tables:
        if message.length:
            names[message.can_id | (CAN_ID_EXTENDED if message.is_extended else 0)] = message_name(message)

    def entry(known: TracedId) -> dict[str, Any]:
        frame = _frame_json(known.latest, names.get(known.latest.can_id))
        return frame | {"count": known.count, "period_s": known.period_s, "changed": known.changed}

    return {
        "frames": [_frame_json(item, names.get(item.can_id)) for item in trace.latest(limit)],
        "by_id": [entry(known) for _, known in sorted(trace.by_id().items())],
    }
