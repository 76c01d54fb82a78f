"""A DBC file for the configured CAN tables, so that any CAN tool shows the master's messages in names and units.

Bytes of one number that stand next to each other, in either order, become one signal with the field's scale and unit;
known flags become one signal a bit; any other byte becomes a signal of its own.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace

from firmware_protocol import elcon
from firmware_protocol.can_tables import RxMessage, TxMessage, bit_rate, response_code, rx_messages, tx_messages
from firmware_protocol.config_image import Image
from firmware_protocol.memory_map import (
    CAN_ID_EXTENDED,
    CONFIG,
    FLAGS,
    N_CAN_MESSAGES,
    RESPONSE_CHARGES,
    VALUES,
    Field,
    element_name,
    locate,
)

MASTER_NODE = "MASTER"
CHARGER_NODE = "CHARGER"
_NOBODY = "Vector__XXX"
CYCLE_TIME = "GenMsgCycleTime"
TABLE_INDEX = "VoltwallIndex"  # what a DBC has no word for, so that importing our own gives the same tables
ENABLED = "VoltwallEnabled"
TIMEOUT = "VoltwallTimeout"
ANSWER = "VoltwallAnswer"
_ATTRIBUTES = (
    f'BA_DEF_ BO_ "{CYCLE_TIME}" INT 0 65535;',
    'BA_DEF_ "Baudrate" INT 0 1000000;',
    f'BA_DEF_ BO_ "{TABLE_INDEX}" INT -1 7;',
    f'BA_DEF_ BO_ "{ENABLED}" INT 0 1;',
    f'BA_DEF_ BO_ "{TIMEOUT}" INT 0 65535;',
    f'BA_DEF_ BO_ "{ANSWER}" INT -1 {RESPONSE_CHARGES + N_CAN_MESSAGES - 1};',
    f'BA_DEF_DEF_ "{CYCLE_TIME}" 0;',
    'BA_DEF_DEF_ "Baudrate" 500000;',
    f'BA_DEF_DEF_ "{TABLE_INDEX}" -1;',
    f'BA_DEF_DEF_ "{ENABLED}" 0;',
    f'BA_DEF_DEF_ "{TIMEOUT}" 0;',
    f'BA_DEF_DEF_ "{ANSWER}" -1;',
)


@dataclass(frozen=True, slots=True)
class MapSignal:
    """A value in a message: `n_bits` from bit `first_bit` of byte `start_byte` on, over whole bytes unless a flag."""

    name: str
    start_byte: int
    n_bits: int
    is_big_endian: bool
    is_signed: bool
    scale: float
    unit: str
    meaning: str
    first_bit: int = 0  # least significant, for flags
    values: tuple[tuple[int, str], ...] = ()
    is_cut: bool = False  # a byte of a number whose others are elsewhere

    @property
    def length(self) -> int:
        """Bytes that it touches."""
        return -(-self.n_bits // 8)

    @property
    def byte_order(self) -> str:
        """`little` or `big`."""
        return "big" if self.is_big_endian else "little"


def signals(message: TxMessage | RxMessage) -> tuple[MapSignal, ...]:
    """Return the signals of a message in order of their bytes; unused entries and padding have none."""
    offsets = message.data_offsets[: message.length]
    named_signals: list[MapSignal] = []
    position = 0
    while position < len(offsets):
        located = locate(offsets[position])
        if located is None:
            position += 1
            continue
        field, element, byte = located
        if (flags := FLAGS.get(field.name)) is not None:
            named = list(_flag_signals(field, flags, byte, position))
            named_signals += named or [_signal(field, element, position, 1, False, byte)]
            position += 1
            continue
        n_bytes, is_big_endian = _run(offsets, position, field, offsets[position] - byte)
        named_signals.append(_signal(field, element, position, n_bytes, is_big_endian, byte))
        position += n_bytes
    return tuple(_distinct(named_signals))


def decode(signal: MapSignal, data: bytes) -> tuple[float, str | None] | None:
    """Return a signal's value in its unit, and its name where the value has one; None if the data is too short."""
    raw_bytes = data[signal.start_byte : signal.start_byte + signal.length]
    if len(raw_bytes) < signal.length:
        return None
    if signal.n_bits < 8:
        raw = raw_bytes[0] >> signal.first_bit & (1 << signal.n_bits) - 1
    else:
        raw = int.from_bytes(raw_bytes, "big" if signal.is_big_endian else "little", signed=signal.is_signed)
    return float(f"{raw * signal.scale:.10g}"), dict(signal.values).get(raw)


def message_name(message: TxMessage | RxMessage) -> str:
    """Return the message's name: by its id where that is known, else by its index in the tables."""
    if isinstance(message, TxMessage):
        is_command = message.is_extended and message.can_id == elcon.COMMAND_ID
        return "CHARGER_COMMAND" if is_command else f"MASTER_TX_{message.index}"
    is_status = message.is_extended and message.can_id == elcon.STATUS_ID
    return "CHARGER_STATUS" if is_status else f"MASTER_RX_{message.index}"


def to_dbc(config: Image, comment: str = "") -> str:
    """Return the DBC text for a configuration image: every message with at least one byte, each id once.

    The comment is the file's own: where its tables come from. It holds no double quote.
    """
    messages: dict[int, TxMessage | RxMessage] = {}
    configured: list[TxMessage | RxMessage] = [*tx_messages(config), *rx_messages(config)]
    for message in configured:
        if message.length:
            messages.setdefault(_dbc_id(message), message)
    lines = ['VERSION ""', "", "NS_ :", "", "BS_:", "", f"BU_: {MASTER_NODE} {CHARGER_NODE}", ""]
    for dbc_id, message in messages.items():
        lines += _message_lines(dbc_id, message)
    if comment:
        lines.append(f'CM_ "{comment}";')
    for dbc_id, message in messages.items():
        lines += [f'CM_ SG_ {dbc_id} {s.name} "{s.meaning}";' for s in signals(message) if s.meaning]
    lines += _ATTRIBUTES
    lines.append(f'BA_ "Baudrate" {bit_rate(CONFIG["can_brp"].unpack(config)[0])};')
    for dbc_id, message in messages.items():
        lines += [f'BA_ "{key}" BO_ {dbc_id} {value};' for key, value in _attributes(message).items()]
    for dbc_id, message in messages.items():
        for signal in signals(message):
            if signal.values:
                table = " ".join(f'{value} "{text}"' for value, text in signal.values)
                lines.append(f"VAL_ {dbc_id} {signal.name} {table} ;")
    return "\n".join([*lines, ""])


def _attributes(message: TxMessage | RxMessage) -> dict[str, int]:
    shared = {TABLE_INDEX: message.index, ENABLED: int(message.enabled)}
    if isinstance(message, TxMessage):
        return {CYCLE_TIME: message.period_ms} | shared
    answer = {} if message.response is None else {ANSWER: response_code(message)}
    return shared | {TIMEOUT: message.timeout_ms} | answer


def _run(offsets: tuple[int, ...], position: int, field: Field, start: int) -> tuple[int, bool]:
    """Return (bytes, is big endian) of the signal that begins at a position: 1 where its bytes form no number.

    Besides whole numbers, the low bytes of a signed one count, which then means a value that fits them.
    """
    size = field.item_size
    little = 0
    while little < size and offsets[position + little : position + little + 1] == (start + little,):
        little += 1
    if little == size or (little > 1 and field.fmt.islower()):
        return little, False
    big = 0
    while big < size and offsets[position + big : position + big + 1] == (offsets[position] - big,):
        big += 1
        if offsets[position + big - 1] == start:
            break
    reaches_start = offsets[position + big - 1] == start
    if big > 1 and reaches_start and (big == size or field.fmt.islower()):
        return big, True
    return 1, False


def _signal(field: Field, element: int, position: int, n_bytes: int, is_big_endian: bool, byte: int) -> MapSignal:
    name = identifier(element_name(field, element))
    is_number = n_bytes == field.item_size or n_bytes > 1
    if not is_number:
        meaning = f"byte {byte} of {field.name}"
        return MapSignal(f"{name}_byte{byte}", position, 8, False, False, 1.0, "", meaning, is_cut=True)
    values = VALUES.get(re.sub(r"\[\d+\]", "", field.name), {})
    return MapSignal(
        name,
        position,
        8 * n_bytes,
        is_big_endian,
        field.fmt.islower(),
        field.scale,
        field.unit,
        field.meaning,
        values=tuple(values.items()),
    )


def _flag_signals(field: Field, flags: tuple[str, ...], byte: int, position: int) -> Iterator[MapSignal]:
    for bit, flag in enumerate(flags[8 * byte : 8 * byte + 8]):
        name = identifier(f"{field.name.partition('.')[0]}_{flag}")
        yield MapSignal(name, position, 1, False, False, 1.0, "", f"{flag} flag in {field.name}", first_bit=bit)


def identifier(name: str) -> str:
    """Return a name of the struct as a DBC can spell it: `v[36]` is `v_36`."""
    return re.sub(r"\W+", "_", name).strip("_")


def _distinct(signals: list[MapSignal]) -> Iterator[MapSignal]:
    """Number the second and later signals of the same name."""
    seen: dict[str, int] = {}
    for signal in signals:
        seen[signal.name] = seen.get(signal.name, 0) + 1
        n = seen[signal.name]
        yield signal if n == 1 else replace(signal, name=f"{signal.name}_{n}")


def _dbc_id(message: TxMessage | RxMessage) -> int:
    return message.can_id | (CAN_ID_EXTENDED if message.is_extended else 0)


def _message_lines(dbc_id: int, message: TxMessage | RxMessage) -> list[str]:
    name = message_name(message)
    sender = CHARGER_NODE if name == "CHARGER_STATUS" else MASTER_NODE if isinstance(message, TxMessage) else _NOBODY
    receiver = CHARGER_NODE if name == "CHARGER_COMMAND" else MASTER_NODE if isinstance(message, RxMessage) else _NOBODY
    lines = [f"BO_ {dbc_id} {name}: {message.length} {sender}"]
    for s in signals(message):
        start_bit = 8 * s.start_byte + (7 if s.is_big_endian else s.first_bit)
        low, high = (-(1 << s.n_bits - 1), (1 << s.n_bits - 1) - 1) if s.is_signed else (0, (1 << s.n_bits) - 1)
        lines.append(
            f" SG_ {s.name} : {start_bit}|{s.n_bits}@{0 if s.is_big_endian else 1}{'-' if s.is_signed else '+'}"
            f" ({s.scale:.12g},0) [{low * s.scale:.12g}|{high * s.scale:.12g}]"
            f' "{s.unit if s.unit != "1" else ""}" {receiver}'
        )
    return [*lines, ""]
