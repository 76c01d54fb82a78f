"""What is wrong in the CAN tables as a whole: ids, lengths, bus load, periods and timeouts, what they overwrite."""

from collections.abc import Iterator, Mapping, Sequence

from app.configuration.finding import Finding, finding
from firmware_protocol import elcon
from firmware_protocol.can_tables import RxMessage, TxMessage, bit_rate, bus_load, rx_messages, tx_messages
from firmware_protocol.dbc import signals
from firmware_protocol.memory_map import (
    BYTE_UNUSED,
    CAN_DATA_BYTES,
    CAN_ID_EXTENDED,
    CHARGER_OFFSET,
    CHARGER_SIZE,
    CONFIG,
    locate,
)

MAX_LOAD = 0.7
WATCH_LOAD = 0.5
CHARGER_BIT_RATES = (250_000, 500_000)
CHARGER_STATUS_MS = 1000
CHARGER_PATIENCE_MS = 5000

Message = TxMessage | RxMessage


def can_findings(image: bytes, measured_period_s: Mapping[int, float]) -> list[Finding]:
    """Return what is wrong in the tables of an image; `measured_period_s` is what the bus monitor measured, by id."""
    tx, rx = tx_messages(image), rx_messages(image)
    answers = {message.response for message in rx if message.enabled}
    return [
        *_ids(image, [*tx, *rx]),
        *_lengths(image, [*tx, *rx], answers),
        *_charger(image, tx, rx),
        *_timing(image, tx, rx, answers, measured_period_s),
        *_content(image, tx, rx),
        *_load(image),
    ]


def wire_id(message: Message) -> int:
    """The id as it is told apart on the bus: bit 31 for 29 bits."""
    return message.can_id | (CAN_ID_EXTENDED if message.is_extended else 0)


def _table(message: Message) -> str:
    return "tx" if isinstance(message, TxMessage) else "rx"


def _name(message: Message) -> str:
    return f"{_table(message)} {message.index + 1}"


def _about(message: Message, part: str) -> str:
    return f"can_{_table(message)}_msg_{part}"


def _ids(image: bytes, messages: Sequence[Message]) -> Iterator[Finding]:
    first: dict[int, Message] = {}
    for message in messages:
        if not message.length:
            continue
        other = first.setdefault(wire_id(message), message)
        if other is not message:
            why = f"{_name(other)} has this id: two messages with one id destroy each other on the bus"
            yield finding("error", "id-taken", image, _about(message, "id"), message.index, "an id of its own", why)


def _lengths(image: bytes, messages: Sequence[Message], answers: set[int | None]) -> Iterator[Finding]:
    for message in messages:
        is_answer = isinstance(message, TxMessage) and message.index in answers
        if not message.length and (message.enabled or is_answer):
            why = "it is sent as an answer" if is_answer else "it is on from the start"
            yield finding("error", "empty", image, _about(message, "len"), message.index, "1..8 byte", f"{why}, empty")
        picked = [i for i, offset in enumerate(message.data_offsets) if offset != BYTE_UNUSED]
        if picked and picked[-1] >= message.length and message.length:
            limit = f"at least {picked[-1] + 1} byte"
            why = f"byte {picked[-1]} is picked and would not be {'sent' if _table(message) == 'tx' else 'taken'}"
            yield finding("error", "length", image, _about(message, "len"), message.index, limit, why)


def _charger(image: bytes, tx: Sequence[TxMessage], rx: Sequence[RxMessage]) -> Iterator[Finding]:
    known = {elcon.COMMAND_ID | CAN_ID_EXTENDED: "command", elcon.STATUS_ID | CAN_ID_EXTENDED: "status"}
    messages: list[Message] = [*tx, *rx]
    used = [m for m in messages if m.length and wire_id(m) in known]
    for message in used:
        if message.length != CAN_DATA_BYTES:
            why = f"an ElCon charger's {known[wire_id(message)]} has 8 bytes"
            yield finding("error", "length", image, _about(message, "len"), message.index, "8 byte", why)
    if used and (rate := bit_rate(CONFIG["can_brp"].unpack(image)[0])) not in CHARGER_BIT_RATES:
        why = f"{rate / 1000:g} kbit/s: an ElCon charger speaks 250 or 500 kbit/s"
        yield finding("warning", "charger-rate", image, "can_brp", 0, "15 (250 kbit/s) or 7 (500 kbit/s)", why)


def _timing(
    image: bytes,
    tx: Sequence[TxMessage],
    rx: Sequence[RxMessage],
    answers: set[int | None],
    measured_period_s: Mapping[int, float],
) -> Iterator[Finding]:
    for message in tx:
        if message.enabled and message.length and not message.period_ms:
            why = "it is on from the start and yet sent on demand only"
            yield finding("warning", "no-period", image, "can_tx_msg_timing", message.index, "1..60000 ms", why)
        commands_charger = wire_id(message) == elcon.COMMAND_ID | CAN_ID_EXTENDED
        is_used = message.enabled or message.index in answers
        if is_used and commands_charger and not 0 < message.period_ms < CHARGER_PATIENCE_MS:
            why = "the charger stops after 5 s without a command"
            yield finding("error", "charger-period", image, "can_tx_msg_timing", message.index, "1..4999 ms", why)
    for received in rx:
        if not received.length or not received.timeout_ms:
            continue
        yield from _timeout(image, received, measured_period_s)
        answer = None if received.response is None else tx[received.response]
        if answer is not None and answer.period_ms >= received.timeout_ms:
            limit = f"more than the {answer.period_ms} ms between two answers, tx {answer.index + 1}"
            why = "the answer would be switched off before it was sent again"
            yield finding("error", "timeout", image, "can_rx_msg_timeout", received.index, limit, why)


def _timeout(image: bytes, received: RxMessage, measured_period_s: Mapping[int, float]) -> Iterator[Finding]:
    period_ms, known = measured_period_s.get(wire_id(received), 0.0) * 1000, "heard on the bus"
    if wire_id(received) == elcon.STATUS_ID | CAN_ID_EXTENDED:
        period_ms, known = CHARGER_STATUS_MS, "of an ElCon charger"
    if period_ms and received.timeout_ms <= period_ms:
        limit = f"more than {period_ms:.0f} ms, the period {known}"
        why = "the message would count as lost between two frames"
        yield finding("error", "timeout", image, "can_rx_msg_timeout", received.index, limit, why)


def _content(image: bytes, tx: Sequence[TxMessage], rx: Sequence[RxMessage]) -> Iterator[Finding]:
    for message in tx:
        for signal in signals(message):
            if signal.is_cut:
                at = message.index * CAN_DATA_BYTES + signal.start_byte
                limit = "all bytes of the number, next to each other"
                yield finding("warning", "cut", image, "can_tx_msg_data", at, limit, f"only {signal.meaning} is sent")
    charger = range(CHARGER_OFFSET, CHARGER_OFFSET + CHARGER_SIZE)
    for received in rx:
        for position, offset in enumerate(received.data_offsets[: received.length]):
            place = None if offset == BYTE_UNUSED or offset in charger else locate(offset)
            if place is not None:
                at = received.index * CAN_DATA_BYTES + position
                why = f"{place[0].name} is what the master measures or counts itself, and protects by"
                limit = f"{charger.start}..{charger.stop - 1}, what the charger says"
                yield finding("warning", "overwrites", image, "can_rx_msg_data", at, limit, why)


def _load(image: bytes) -> Iterator[Finding]:
    load, rate = bus_load(image), bit_rate(CONFIG["can_brp"].unpack(image)[0])
    if load > WATCH_LOAD:
        why = f"the master alone would take {load:.0%} of {rate / 1000:g} kbit/s; others need their share"
        limit = f"a load below {MAX_LOAD if load >= MAX_LOAD else WATCH_LOAD:.0%}"
        yield finding("error" if load >= MAX_LOAD else "warning", "load", image, "can_tx_msg_timing", 0, limit, why)
