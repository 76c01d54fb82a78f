"""CAN tables out of a DBC file: its signals are looked up in the memory map by the names that our own DBC gives them.

What cannot be placed is noted, never guessed: its bytes stay unused.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

from firmware_protocol.can_tables import (
    RxMessage,
    TxMessage,
    offsets_of,
    response_of,
    rx_messages,
    tx_messages,
    with_rx_messages,
    with_tx_messages,
)
from firmware_protocol.config_image import Image
from firmware_protocol.dbc import ANSWER, CYCLE_TIME, ENABLED, MASTER_NODE, TABLE_INDEX, TIMEOUT, identifier
from firmware_protocol.errors import DecodeError
from firmware_protocol.memory_map import (
    BYTE_UNUSED,
    CAN_DATA_BYTES,
    CAN_ID_EXTENDED,
    CONFIG,
    FIELDS,
    FLAGS,
    N_CAN_MESSAGES,
    Field,
    element_name,
)

MAX_CHARACTERS = 1_000_000
_MESSAGE = re.compile(r"\s*+BO_\s++(\d{1,10})\s++(\w++)\s*+:\s*+(\d{1,4})\s++(\w++)")
_SIGNAL = re.compile(
    r"\s*+SG_\s++(\w++)\s*+(?:(m\d*+M?|M)\s*+)?:\s*+(\d{1,4})\|(\d{1,4})@([01])([+-])"
    r"\s*+\(\s*+([^,()]{1,40}),\s*+([^,()]{1,40})\)"
)
_ATTRIBUTE = re.compile(r'\s*+BA_\s++"(\w++)"\s++BO_\s++(\d{1,10})\s++(-?\d{1,10})\s*+;')
M = TypeVar("M", TxMessage, RxMessage)
_INDEPENDENT = "VECTOR__INDEPENDENT_SIG_MSG"


@dataclass
class _Message:
    dbc_id: int
    name: str
    length: int
    sender: str
    signals: list[tuple[str, int, int, bool, bool, float]] = field(default_factory=list)
    attributes: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Imported:
    """Messages for the tables, and notes on the parts of the file that are not in them."""

    tx: tuple[TxMessage, ...]
    rx: tuple[RxMessage, ...]
    notes: tuple[str, ...]


def from_dbc(text: str, master_node: str = MASTER_NODE) -> Imported:
    """Return the tables that a DBC describes: messages sent by `master_node` are tx, all others rx.

    Raises:
        DecodeError: it has no message at all, or is too long.
    """
    if len(text) > MAX_CHARACTERS:
        raise DecodeError("DBC", f"{len(text)} characters, at most {MAX_CHARACTERS}")
    notes: list[str] = []
    parsed = _parse(text, notes)
    if not parsed:
        raise DecodeError("DBC", "no message (BO_) in it")
    messages = [message for message in parsed if _has_place(message, notes)]
    tx = [_tx(m, notes) for m in messages if m.sender == master_node]
    rx = [_rx(m, notes) for m in messages if m.sender != master_node]
    return Imported(tuple(_placed(tx, "sent", notes)), tuple(_placed(rx, "received", notes)), tuple(notes))


def into_tables(config: Image, imported: Imported) -> tuple[bytes, tuple[str, ...]]:
    """Return the image with imported messages in its tables, and notes.

    One of the same id is replaced, else a free place is taken, its own where that is free. The others stay.
    """
    notes = list(imported.notes)
    tx = _merged(tx_messages(config), imported.tx, "sent", notes)
    rx = _merged(rx_messages(config), imported.rx, "received", notes)
    image = with_tx_messages(config, tx.values())
    image = with_rx_messages(image, [_answering(message, tx, notes) for message in rx.values()])
    sent = {(m.can_id, m.is_extended) for m in tx_messages(image) if m.length}
    notes += [
        f"id {m.can_id:#x}: now both sent and received, which no write allows: remove one of them"
        for m in rx_messages(image)
        if m.length and (m.can_id, m.is_extended) in sent
    ]
    return image, tuple(notes)


def _answering(message: RxMessage, tx: Mapping[int, TxMessage], notes: list[str]) -> RxMessage:
    """The received message, its answer where the file's own message of that index has come to stand."""
    if message.response is None:
        return message
    answer = tx.get(message.response)
    if answer is None:
        notes.append(f"id {message.can_id:#x}: its answer, message {message.response + 1} sent, is not in the file")
    charges = message.charges and answer is not None
    return replace(message, response=None if answer is None else answer.index, charges=charges)


def _merged(table: Sequence[M], messages: Sequence[M], words: str, notes: list[str]) -> dict[int, M]:
    """Return the messages in their places, by the index that they had."""
    places = {(m.can_id, m.is_extended): m.index for m in table if m.length}
    free = [m.index for m in table if not m.length]
    merged: dict[int, M] = {}
    for message in messages:
        index = places.get((message.can_id, message.is_extended))
        if index is None and not free:
            notes.append(f"id {message.can_id:#x}: all {N_CAN_MESSAGES} messages {words} are taken; left out")
            continue
        if index is None:
            index = message.index if message.index in free else free[0]
            free.remove(index)
        merged[message.index] = replace(message, index=index)
    return merged


def _parse(text: str, notes: list[str]) -> list[_Message]:
    messages: dict[int, _Message] = {}
    current: _Message | None = None
    for line in text.splitlines():
        if match := _MESSAGE.match(line):
            current = _Message(int(match[1]), match[2], int(match[3]), match[4])
            if current.name == _INDEPENDENT:
                current = None
            elif messages.setdefault(current.dbc_id, current) is not current:
                notes.append(f"{current.name}: {messages[current.dbc_id].name} has its id already; left out")
        elif current is not None and (match := _SIGNAL.match(line)):
            try:
                scale = float(match[7])
            except ValueError:
                scale = float("nan")
            start, bits = int(match[3]), int(match[4])
            current.signals.append((match[1], start, bits, match[5] == "0", match[6] == "-", scale))
        elif (match := _ATTRIBUTE.match(line)) and int(match[2]) in messages:
            messages[int(match[2])].attributes[match[1]] = int(match[3])
    return list(messages.values())


def _has_place(message: _Message, notes: list[str]) -> bool:
    """Whether a table can hold the message; a place without bytes is a free one."""
    can_id, is_extended = _id(message)
    if can_id > (0x1FFFFFFF if is_extended else 0x7FF):
        notes.append(f"{message.name}: id {can_id:#x} is none of {29 if is_extended else 11} bits; left out")
        return False
    if not message.length:
        notes.append(f"{message.name}: it has no bytes; left out")
    return message.length > 0


def _id(message: _Message) -> tuple[int, bool]:
    return message.dbc_id & ~CAN_ID_EXTENDED, bool(message.dbc_id & CAN_ID_EXTENDED)


def _clamped(message: _Message, key: str, highest: int, default: int, notes: list[str]) -> int:
    value = message.attributes.get(key, default)
    if not 0 <= value <= highest:
        notes.append(f"{message.name}: {key} = {value}, allowed: 0..{highest}; {default} taken")
        return default
    return value


def _tx(message: _Message, notes: list[str]) -> TxMessage:
    can_id, is_extended = _id(message)
    longest = CONFIG["can_tx_msg_timing"].maximum or 0
    period_ms = _clamped(message, CYCLE_TIME, longest, 0, notes)
    enabled = message.attributes.get(ENABLED, 1 if period_ms else 0) == 1
    index = message.attributes.get(TABLE_INDEX, -1)
    length, offsets = _offsets(message, notes)
    return TxMessage(index, enabled, can_id, is_extended, period_ms, length, offsets)


def _rx(message: _Message, notes: list[str]) -> RxMessage:
    can_id, is_extended = _id(message)
    longest = CONFIG["can_rx_msg_timeout"].maximum or 0
    silent_ms = min(longest, 5 * message.attributes.get(CYCLE_TIME, 0)) if TIMEOUT not in message.attributes else 0
    timeout_ms = _clamped(message, TIMEOUT, longest, max(0, silent_ms), notes)
    response, charges = response_of(message.attributes.get(ANSWER, -1))
    index = message.attributes.get(TABLE_INDEX, -1)
    length, offsets = _offsets(message, notes)
    enabled = message.attributes.get(ENABLED, 1) == 1
    return RxMessage(index, enabled, can_id, is_extended, timeout_ms, length, offsets, response, charges)


def _placed(messages: list[M], table: str, notes: list[str]) -> list[M]:
    """Give each message its own place: the one that our own DBC names, else the first free one."""
    free = list(range(N_CAN_MESSAGES))
    placed: dict[int, M] = {}
    waiting: list[M] = []
    for message in messages:
        if message.index in free:
            free.remove(message.index)
            placed[message.index] = message
        else:
            waiting.append(message)
    for message in waiting:
        if not free:
            notes.append(f"id {message.can_id:#x}: all {N_CAN_MESSAGES} messages {table} are taken; left out")
            continue
        index = free.pop(0)
        placed[index] = replace(message, index=index)
    return [placed[index] for index in sorted(placed)]


def _offsets(message: _Message, notes: list[str]) -> tuple[int, tuple[int, ...]]:
    """Return length and the offset of each byte."""
    length = min(message.length, CAN_DATA_BYTES)
    if message.length > CAN_DATA_BYTES:
        notes.append(f"{message.name}: {message.length} bytes; only the first {CAN_DATA_BYTES} fit a CAN frame")
    row = [BYTE_UNUSED] * CAN_DATA_BYTES
    for name, start_bit, n_bits, is_big, is_signed, scale in message.signals:
        placed = _signal_bytes(name, start_bit, n_bits, is_big, is_signed)
        if isinstance(placed, str):
            notes.append(f"{message.name}.{name}: {placed}; its bytes stay unused")
            continue
        start_byte, offsets, known_scale = placed
        if start_byte + len(offsets) > length:
            notes.append(f"{message.name}.{name}: ends beyond the message; its bytes stay unused")
            continue
        if known_scale is not None and not abs(scale - known_scale) <= 1e-9 + 1e-6 * known_scale:
            notes.append(f"{message.name}.{name}: scale {scale:g}, the master's is {known_scale:g}")
        row[start_byte : start_byte + len(offsets)] = offsets
    return length, tuple(row)


def _signal_bytes(
    name: str, start_bit: int, n_bits: int, is_big: bool, is_signed: bool
) -> tuple[int, list[int], float | None] | str:
    """Return (first byte, offsets, scale to compare) of a signal, or why it has no place."""
    first = re.sub(r"_\d+$", "", name)  # what a message carries twice has a number behind its name
    flag = _FLAG_BYTES.get(name) or _FLAG_BYTES.get(first)
    if flag is not None and n_bits == 1:
        return start_bit // 8, [flag], None
    of_map = _ELEMENTS.get(name) or _ELEMENTS.get(first)
    if part := re.fullmatch(r"(\w+)_byte(\d)(_\d+)?", name):
        whole = _ELEMENTS.get(part[1])
        if whole and n_bits == 8 and int(part[2]) < whole[0].item_size:
            return start_bit // 8, [whole[0].offset + whole[1] * whole[0].item_size + int(part[2])], None
    if of_map is None:
        return "no value of the master's has this name"
    struct_field, element = of_map
    if start_bit % 8 != (7 if is_big else 0) or n_bits % 8:
        return "it does not fill whole bytes"
    n_bytes = n_bits // 8
    may_be_cut = struct_field.fmt.islower() and n_bytes > 1
    if not 0 < n_bytes <= struct_field.item_size or (n_bytes < struct_field.item_size and not may_be_cut):
        return f"{n_bits} bits, the master's has {8 * struct_field.item_size}"
    if is_signed != struct_field.fmt.islower():
        return f"it is {'signed' if is_signed else 'unsigned'}, the master's is not"
    offsets = list(offsets_of(struct_field, element, is_big_endian=False))[:n_bytes]
    return start_bit // 8, offsets[::-1] if is_big else offsets, struct_field.scale


def _elements() -> dict[str, tuple[Field, int]]:
    return {
        identifier(element_name(struct_field, element)): (struct_field, element)
        for struct_field in FIELDS.values()
        for element in range(struct_field.count)
    }


_ELEMENTS = _elements()
_FLAG_BYTES = {
    identifier(f"{name.partition('.')[0]}_{flag}"): FIELDS[name].offset + bit // 8
    for name, flags in FLAGS.items()
    for bit, flag in enumerate(flags)
}
