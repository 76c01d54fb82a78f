"""CAN tables and traced frames as JSON; offsets get the names of what lies there."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict
from types import MappingProxyType
from typing import Any

from app.clock import Clock
from app.configuration.can_rules import wire_id
from app.live.can_trace import CanTrace, TracedId
from app.sources.items import CanItem
from app.sources.links.can_bus import DEFAULT_BIT_RATE
from app.telemetry import Snapshot
from firmware_protocol.can_latency import Cyclic, cyclic_messages, worst_latencies_s
from firmware_protocol.can_tables import (
    RxMessage,
    TxMessage,
    bit_rate,
    bus_load,
    rx_messages,
    tx_messages,
    worst_case_bits,
)
from firmware_protocol.dbc import MapSignal, decode, message_name, signals
from firmware_protocol.memory_map import CAN_ID_EXTENDED, CONFIG

RECENT_NS = 2_000_000_000
LATE_PERIODS = 3


def _signal_json(signal: MapSignal) -> dict[str, Any]:
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


def _ms(seconds: float | None) -> float | None:
    return None if seconds is None else round(seconds * 1000, 3)


def tables_json(image: bytes, rx_active: int | None, others: Iterable[Cyclic] = ()) -> dict[str, Any]:
    """Both tables; the master's messages may have to wait for those of `others`."""
    rate = bit_rate(CONFIG["can_brp"].unpack(image)[0])
    latencies = worst_latencies_s(image, others)
    loads = {
        index: worst_case_bits(m.length, m.is_extended) / m.period_s / rate
        for index, m in cyclic_messages(image).items()
    }
    return {
        "bit_rate": bit_rate(CONFIG["can_brp"].unpack(image)[0]),
        "bus_load": bus_load(image),
        "tx": [
            _message_json(m)
            | {"period_ms": m.period_ms, "latency_ms": _ms(latencies.get(m.index)), "load": loads.get(m.index, 0.0)}
            for m in tx_messages(image)
        ],
        "rx": [
            _message_json(m)
            | {
                "timeout_ms": m.timeout_ms,
                "response": m.response,
                "charges": m.charges,
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


def measured_messages(trace: CanTrace) -> list[Cyclic]:
    """Return the bus monitor's measurement of every id, as periodic messages."""
    return [
        Cyclic(can_id & ~CAN_ID_EXTENDED, bool(can_id & CAN_ID_EXTENDED), len(traced.latest.data), traced.period_s)
        for can_id, traced in trace.by_id().items()
        if traced.period_s
    ]


def bus_json(
    trace: CanTrace,
    image: bytes | None,
    snapshot: Snapshot | None,
    clock: Clock,
    names: Mapping[int, str] = MappingProxyType({}),
    known_bit_rate: int | None = None,
) -> dict[str, Any]:
    """The bus monitor; `image` is the configuration in force.

    Without a master it is None; then `names` are those of messages, `known_bit_rate` is that of the bus, or None.
    """
    now_ns, wall_ns = clock.monotonic_ns(), clock.wall_ns()
    messages: list[TxMessage | RxMessage] = [] if image is None else [*rx_messages(image), *tx_messages(image)]
    tables = {wire_id(m): m for m in messages if m.length}
    cyclic = {} if image is None else {wire_id(tx_messages(image)[i]): m for i, m in cyclic_messages(image).items()}
    seen = trace.by_id()
    if image is not None:
        known_bit_rate = bit_rate(CONFIG["can_brp"].unpack(image)[0])
    rate = known_bit_rate or DEFAULT_BIT_RATE
    ids = [
        {"name": names.get(can_id)} | _id_json(can_id, seen.get(can_id), tables.get(can_id), cyclic.get(can_id), now_ns)
        for can_id in sorted(seen.keys() | tables.keys())
    ]
    load = sum(
        worst_case_bits(len(traced.latest.data), bool(can_id & CAN_ID_EXTENDED)) / traced.period_s / rate
        for can_id, traced in seen.items()
        if traced.period_s and now_ns - traced.latest.t_mono_ns < RECENT_NS
    )
    can = None if snapshot is None else snapshot.links.can
    return {
        "ids": ids,
        "bit_rate": rate,
        "bit_rate_known": known_bit_rate is not None,
        "load": load,
        "errors": None if can is None else can.errors,
        "tx_errors": None if can is None else can.tx_errors,
        "rx_errors": None if can is None else can.rx_errors,
        "bus_state": None if can is None else can.bus_state,
        "rs232_live": snapshot is not None and snapshot.links.rs232.state == "live",
        "disagreements": [
            {
                "name": d.name,
                "rs232": d.rs232,
                "can": d.can,
                "unit": d.unit,
                "since": (wall_ns - (now_ns - d.since_ns)) / 1e9,
            }
            for d in (() if snapshot is None else snapshot.disagreements)
        ],
    }


def _id_json(
    can_id: int, traced: TracedId | None, message: TxMessage | RxMessage | None, cyclic: Cyclic | None, now_ns: int
) -> dict[str, Any]:
    item = None if traced is None else traced.latest
    age_s = None if item is None else (now_ns - item.t_mono_ns) / 1e9
    period_s = None if traced is None else traced.period_s
    configured_s = None if cyclic is None else cyclic.period_s
    sender = "voltwall" if item is not None and item.sent else "master" if isinstance(message, TxMessage) else "other"
    is_late = False
    if isinstance(message, TxMessage) and message.enabled and configured_s is not None:
        is_late = age_s is None or age_s > LATE_PERIODS * configured_s
    elif isinstance(message, RxMessage) and message.enabled and message.timeout_ms and age_s is not None:
        is_late = age_s > message.timeout_ms / 1000  # a node that was never there is not late
    return {
        "id": can_id & ~CAN_ID_EXTENDED,
        "extended": bool(can_id & CAN_ID_EXTENDED),
        **({} if message is None else {"name": message_name(message)}),
        "direction": None if item is None else "tx" if item.sent else "rx",
        "sender": sender,
        "count": 0 if traced is None else traced.count,
        "age_s": age_s,
        "period_ms": _ms(period_s),
        "configured_ms": _ms(configured_s),
        "late": is_late,
        "data": None if item is None else item.data.hex(),
        "changed": 0 if traced is None else traced.changed,
        "values": [] if item is None or message is None else _values(message, item.data),
    }


def _values(message: TxMessage | RxMessage, data: bytes) -> list[dict[str, Any]]:
    decoded = ((signal, decode(signal, data)) for signal in signals(message))
    return [
        {"name": signal.name, "value": value[0], "unit": signal.unit, "text": value[1]}
        for signal, value in decoded
        if value is not None
    ]


def message_names(image: bytes) -> dict[int, str]:
    """Names of the messages in the tables of a configuration, by id."""
    names: dict[int, str] = {}
    tables: tuple[TxMessage | RxMessage, ...] = (*tx_messages(image), *rx_messages(image))
    for message in tables:
        if message.length:
            names[message.can_id | (CAN_ID_EXTENDED if message.is_extended else 0)] = message_name(message)
    return names


def traced_json(trace: CanTrace, limit: int, names: Mapping[int, str]) -> dict[str, Any]:
    """The newest frames and one entry an id, with their names by id."""

    def entry(traced: TracedId) -> dict[str, Any]:
        frame = _frame_json(traced.latest, names.get(traced.latest.can_id))
        return frame | {"count": traced.count, "period_s": traced.period_s, "changed": traced.changed}

    return {
        "frames": [_frame_json(item, names.get(item.can_id)) for item in trace.latest(limit)],
        "by_id": [entry(traced) for _, traced in sorted(trace.by_id().items())],
    }
