"""The eight tx and eight rx messages of the configuration as types, and the meaning of their bytes.

The tables are read out of a 420-byte configuration image and put back into one. A table entry is the offset of a byte
in the master struct. No bus here: `data` is what a CAN frame carried.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from firmware_protocol.config_image import Image, with_raw
from firmware_protocol.errors import EncodeError
from firmware_protocol.memory_map import (
    BYTE_UNUSED,
    CAN_DATA_BYTES,
    CAN_ID_EXTENDED,
    CONFIG,
    FIELDS,
    MASTER_SIZE,
    N_CAN_MESSAGES,
    NO_RESPONSE,
    RESPONSE_CHARGES,
    Field,
    element_name,
)
from firmware_protocol.messages import Window

CAN_CLOCK_HZ = 32_000_000
TIME_QUANTA = 8  # time quanta of one bit
INTERFRAME_BITS = 3
_SIGNED = {  # start and size of each signed number of several bytes
    field.offset + element * field.item_size: field.item_size
    for field in FIELDS.values()
    if field.fmt in "hi"
    for element in range(field.count)
}
_BY_NAME = {
    element_name(field, element): (field, element) for field in FIELDS.values() for element in range(field.count)
}


@dataclass(frozen=True, slots=True)
class TxMessage:
    """One message that the master sends; `data_offsets` always has eight entries, of which `length` are sent."""

    index: int
    enabled: bool  # sent from start-up on
    can_id: int
    is_extended: bool
    period_ms: int  # 0 sends on demand only
    length: int
    data_offsets: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class RxMessage:
    """One message that the master listens for.

    `response` is the tx message it activates; with `charges`, charging begins with it and ends with its silence.
    """

    index: int
    enabled: bool
    can_id: int
    is_extended: bool
    timeout_ms: int  # 0 never times out
    length: int
    data_offsets: tuple[int, ...]
    response: int | None
    charges: bool = False


def tx_messages(config: Image) -> tuple[TxMessage, ...]:
    """Return the eight messages that the master sends, out of a configuration image."""
    mask = CONFIG["can_tx_msg_en_startup"].unpack(config)[0]
    ids = CONFIG["can_tx_msg_id"].unpack(config)
    periods = CONFIG["can_tx_msg_timing"].unpack(config)
    lengths = CONFIG["can_tx_msg_len"].unpack(config)
    rows = _rows(CONFIG["can_tx_msg_data"].unpack(config))
    return tuple(
        TxMessage(i, bool(mask >> i & 1), *_split_id(ids[i]), periods[i], min(lengths[i], CAN_DATA_BYTES), rows[i])
        for i in range(N_CAN_MESSAGES)
    )


def ids_of(config: Image) -> set[int]:
    """Return the ids that the master sends or listens to, also switched-off ones; bit 31 marks a 29-bit one."""
    messages: tuple[TxMessage | RxMessage, ...] = (*tx_messages(config), *rx_messages(config))
    return {_join_id(message.can_id, message.is_extended) for message in messages if message.length}


def rx_messages(config: Image) -> tuple[RxMessage, ...]:
    """Return the eight messages that the master listens for, out of a configuration image."""
    mask = CONFIG["can_rx_msg_en_startup"].unpack(config)[0]
    ids = CONFIG["can_rx_msg_id"].unpack(config)
    timeouts = CONFIG["can_rx_msg_timeout"].unpack(config)
    lengths = CONFIG["can_rx_msg_len"].unpack(config)
    responses = CONFIG["can_rx_msg_response"].unpack(config)
    rows = _rows(CONFIG["can_rx_msg_data"].unpack(config))
    return tuple(
        RxMessage(
            i,
            bool(mask >> i & 1),
            *_split_id(ids[i]),
            timeouts[i],
            min(lengths[i], CAN_DATA_BYTES),
            rows[i],
            *response_of(responses[i]),
        )
        for i in range(N_CAN_MESSAGES)
    )


def response_of(code: int) -> tuple[int | None, bool]:
    """Return the tx message that a response names, None for none, and whether charging begins and ends with it."""
    index = code & ~RESPONSE_CHARGES
    return (index, bool(code & RESPONSE_CHARGES)) if 0 <= index < N_CAN_MESSAGES else (None, False)


def response_code(message: RxMessage) -> int:
    """Return it as the configuration holds it.

    Raises:
        EncodeError: charging shall begin with a message that has no response.
    """
    if message.response is None:
        if message.charges:
            raise EncodeError("charges", True, "with a response only: a charger receives commands")
        return NO_RESPONSE
    return message.response | RESPONSE_CHARGES * message.charges


def with_tx_messages(config: Image, messages: Iterable[TxMessage]) -> bytes:
    """Return the image with these messages in the places that their `index` names; the others stay.

    Raises:
        EncodeError: an index outside 0..7, or a value that does not fit its field.
    """
    table = list(tx_messages(config))
    for message in messages:
        _check_message(message)
        table[message.index] = message
    out = with_raw(config, "can_tx_msg_en_startup", _mask(table))
    out = with_raw(out, "can_tx_msg_id", [_join_id(m.can_id, m.is_extended) for m in table])
    out = with_raw(out, "can_tx_msg_timing", [m.period_ms for m in table])
    out = with_raw(out, "can_tx_msg_len", [m.length for m in table])
    return with_raw(out, "can_tx_msg_data", [list(m.data_offsets) for m in table])


def with_rx_messages(config: Image, messages: Iterable[RxMessage]) -> bytes:
    """Return the image with these messages in the places that their `index` names; the others stay.

    Raises:
        EncodeError: an index outside 0..7, or a value that does not fit its field.
    """
    table = list(rx_messages(config))
    for message in messages:
        _check_message(message)
        table[message.index] = message
    out = with_raw(config, "can_rx_msg_en_startup", _mask(table))
    out = with_raw(out, "can_rx_msg_id", [_join_id(m.can_id, m.is_extended) for m in table])
    out = with_raw(out, "can_rx_msg_timeout", [m.timeout_ms for m in table])
    out = with_raw(out, "can_rx_msg_len", [m.length for m in table])
    out = with_raw(out, "can_rx_msg_response", [response_code(m) for m in table])
    return with_raw(out, "can_rx_msg_data", [list(m.data_offsets) for m in table])


def offsets_of(field: Field, element: int, *, is_big_endian: bool) -> tuple[int, ...]:
    """Return the offsets that put one element into a message, first byte sent first."""
    start = field.offset + element * field.item_size
    offsets = tuple(range(start, start + field.item_size))
    return offsets[::-1] if is_big_endian else offsets


def named_element(name: str) -> tuple[Field, int]:
    """Return the field and the element that a name means: `v_tot`, `v[36]`, `slave[3].cvr[5]`.

    Raises:
        EncodeError: the struct has nothing of this name.
    """
    place = _BY_NAME.get(name)
    if place is None:
        raise EncodeError("signal", name[:60], "", "signal")
    return place


def message_bytes(tx: TxMessage, image: Image) -> bytes:
    """Return the data that the master sends, out of its 2984-byte struct; an unused entry sends 0."""
    return bytes(image[offset] if offset < MASTER_SIZE else 0 for offset in tx.data_offsets[: tx.length])


def windows_of_tx(tx: TxMessage, data: bytes) -> tuple[Window, ...]:
    """Return the bytes of the struct that a message of the master carries (host's side), in order of offset.

    A message that carries only the low bytes (two or more) of a signed number means one that fits them: the missing
    high bytes are its sign, and are in the windows. Unsigned numbers are not completed.
    """
    placed = _placed(tx, data)
    for start in [offset for offset in placed if offset in _SIGNED]:
        end = start + _SIGNED[start]
        missing = [offset for offset in range(start, end) if offset not in placed]
        if missing and missing == list(range(max(missing[0], start + 2), end)):
            placed.update(dict.fromkeys(missing, 0xFF if placed[missing[0] - 1] & 0x80 else 0))
    return _windows(placed)


class TableReader:
    """The bytes of the master's struct that CAN frames carry, by the tables of a configuration."""

    def __init__(self, config: Image) -> None:
        self._messages: dict[int, list[TxMessage | RxMessage]] = {}
        messages: tuple[TxMessage | RxMessage, ...] = (*tx_messages(config), *rx_messages(config))
        for message in messages:
            if message.length:
                self._messages.setdefault(_join_id(message.can_id, message.is_extended), []).append(message)

    def windows(self, can_id: int, data: bytes) -> tuple[Window, ...]:
        """Return the windows of a frame, none for an id that no table has; bit 31 of the id marks a 29-bit one."""
        windows: list[Window] = []
        for message in self._messages.get(can_id, ()):
            if isinstance(message, TxMessage):
                windows += windows_of_tx(message, data)
            else:
                windows += _windows(_placed(message, data))
        return tuple(windows)


def bit_rate(can_brp: int) -> int:
    """Return the bus speed that a prescaler gives [bit/s], rounded: 7 gives 500 000."""
    return round(CAN_CLOCK_HZ / ((can_brp + 1) * TIME_QUANTA))


def worst_case_bits(length: int, is_extended: bool) -> int:
    """Return the longest that a data frame can be on the bus [bit], stuffing and the gap after it included.

    Bits under stuffing: 34 + 8 n (standard) or 54 + 8 n (extended); at worst one is added after every four.
    """
    stuffed = (54 if is_extended else 34) + 8 * length
    unstuffed = 10  # CRC delimiter, acknowledge slot and its delimiter, end of frame
    return stuffed + (stuffed - 1) // 4 + unstuffed + INTERFRAME_BITS


def bus_load(config: Image) -> float:
    """Return the share of the bus that the master's own cyclic messages take at worst, 1 = all of it.

    Counted are the messages enabled from start-up and those that an enabled rx message activates.
    """
    activated = {rx.response for rx in rx_messages(config) if rx.enabled}
    bits_per_s = sum(
        worst_case_bits(tx.length, tx.is_extended) * 1000 / tx.period_ms
        for tx in tx_messages(config)
        if tx.period_ms and (tx.enabled or tx.index in activated)
    )
    return bits_per_s / bit_rate(CONFIG["can_brp"].unpack(config)[0])


def _rows(flat: tuple[int, ...]) -> list[tuple[int, ...]]:
    return [flat[i : i + CAN_DATA_BYTES] for i in range(0, len(flat), CAN_DATA_BYTES)]


def _split_id(raw: int) -> tuple[int, bool]:
    return raw & ~CAN_ID_EXTENDED, bool(raw & CAN_ID_EXTENDED)


def _join_id(can_id: int, is_extended: bool) -> int:
    return can_id | CAN_ID_EXTENDED if is_extended else can_id


def _mask(table: Iterable[TxMessage | RxMessage]) -> int:
    return sum(1 << message.index for message in table if message.enabled)


def _check_message(message: TxMessage | RxMessage) -> None:
    if not 0 <= message.index < N_CAN_MESSAGES:
        raise EncodeError("index", message.index, f"0..{N_CAN_MESSAGES - 1}")
    if not 0 <= message.can_id < CAN_ID_EXTENDED:
        raise EncodeError("can_id", message.can_id, "0..0x1fffffff")
    if not 0 <= message.length <= CAN_DATA_BYTES:
        raise EncodeError("length", message.length, f"0..{CAN_DATA_BYTES}")


def _placed(message: TxMessage | RxMessage, data: bytes) -> dict[int, int]:
    """Return {offset in the struct: byte} of the used entries; where an offset appears twice the later byte counts."""
    used = zip(message.data_offsets[: message.length], data, strict=False)
    return {offset: byte for offset, byte in used if offset != BYTE_UNUSED and offset < MASTER_SIZE}


def _windows(placed: dict[int, int]) -> tuple[Window, ...]:
    """Join neighbouring bytes into windows."""
    runs: list[tuple[int, bytearray]] = []
    for offset in sorted(placed):
        if runs and runs[-1][0] + len(runs[-1][1]) == offset:
            runs[-1][1].append(placed[offset])
        else:
            runs.append((offset, bytearray((placed[offset],))))
    return tuple(Window(offset, bytes(data)) for offset, data in runs)
