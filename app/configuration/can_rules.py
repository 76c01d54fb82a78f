"""Rules of the CAN tables as a whole: ids, lengths, bus load, periods and timeouts, overwritten bytes."""

from collections.abc import Iterator, Mapping, Sequence

from app.configuration.issue import ConfigIssue, finding
from app.words import Message, Quantity
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

CanMessage = TxMessage | RxMessage


def can_findings(image: bytes, measured_period_s: Mapping[int, float]) -> list[ConfigIssue]:
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


def wire_id(message: CanMessage) -> int:
    """The id as it stands on the bus: bit 31 for 29 bits."""
    return message.can_id | (CAN_ID_EXTENDED if message.is_extended else 0)


def _table(message: CanMessage) -> str:
    return "tx" if isinstance(message, TxMessage) else "rx"


def _name(message: CanMessage) -> str:
    return f"{_table(message)} {message.index + 1}"


def _about(message: CanMessage, part: str) -> str:
    return f"can_{_table(message)}_msg_{part}"


def _ids(image: bytes, messages: Sequence[CanMessage]) -> Iterator[ConfigIssue]:
    first: dict[int, CanMessage] = {}
    for message in messages:
        if not message.length:
            continue
        other = first.setdefault(wire_id(message), message)
        if other is not message:
            why = Message("id-taken", other=_name(other))
            yield finding("error", "id-taken", image, _about(message, "id"), message.index, Message("own-id"), why)


def _lengths(image: bytes, messages: Sequence[CanMessage], answers: set[int | None]) -> Iterator[ConfigIssue]:
    for message in messages:
        is_answer = isinstance(message, TxMessage) and message.index in answers
        if not message.length and (message.enabled or is_answer):
            why = Message("empty-answer") if is_answer else Message("empty-from-start")
            yield finding("error", "empty", image, _about(message, "len"), message.index, "1..8 byte", why)
        picked = [i for i, offset in enumerate(message.data_offsets) if offset != BYTE_UNUSED]
        if picked and picked[-1] >= message.length and message.length:
            limit = Message("at-least", value=Quantity(picked[-1] + 1, "byte"))
            byte = picked[-1]
            is_sent = isinstance(message, TxMessage)
            why = Message("byte-not-sent", byte=byte) if is_sent else Message("byte-not-taken", byte=byte)
            yield finding("error", "length", image, _about(message, "len"), message.index, limit, why)


def _charger(image: bytes, tx: Sequence[TxMessage], rx: Sequence[RxMessage]) -> Iterator[ConfigIssue]:
    reason_of = {
        elcon.COMMAND_ID | CAN_ID_EXTENDED: Message("charger-command-length"),
        elcon.STATUS_ID | CAN_ID_EXTENDED: Message("charger-status-length"),
    }
    messages: list[CanMessage] = [*tx, *rx]
    used = [m for m in messages if m.length and wire_id(m) in reason_of]
    for message in used:
        if message.length != CAN_DATA_BYTES:
            why = reason_of[wire_id(message)]
            yield finding("error", "length", image, _about(message, "len"), message.index, "8 byte", why)
    if used and (rate := bit_rate(CONFIG["can_brp"].unpack(image)[0])) not in CHARGER_BIT_RATES:
        why = Message("charger-bit-rates", rate=Quantity(rate / 1000, "kbit/s"))
        yield finding("warning", "charger-rate", image, "can_brp", 0, Message("charger-rates"), why)


def _timing(
    image: bytes,
    tx: Sequence[TxMessage],
    rx: Sequence[RxMessage],
    answers: set[int | None],
    measured_period_s: Mapping[int, float],
) -> Iterator[ConfigIssue]:
    for message in tx:
        if message.enabled and message.length and not message.period_ms:
            why = Message("on-demand-only")
            yield finding("warning", "no-period", image, "can_tx_msg_timing", message.index, "1..60000 ms", why)
        commands_charger = wire_id(message) == elcon.COMMAND_ID | CAN_ID_EXTENDED
        is_used = message.enabled or message.index in answers
        if is_used and commands_charger and not 0 < message.period_ms < CHARGER_PATIENCE_MS:
            why = Message("charger-stops")
            yield finding("error", "charger-period", image, "can_tx_msg_timing", message.index, "1..4999 ms", why)
    for received in rx:
        if not received.length or not received.timeout_ms:
            continue
        yield from _timeout(image, received, measured_period_s)
        answer = None if received.response is None else tx[received.response]
        if answer is not None and answer.period_ms >= received.timeout_ms:
            limit = Message("more-than-answers", period=Quantity(answer.period_ms, "ms"), number=answer.index + 1)
            why = Message("answer-switched-off")
            yield finding("error", "timeout", image, "can_rx_msg_timeout", received.index, limit, why)


def _timeout(image: bytes, received: RxMessage, measured_period_s: Mapping[int, float]) -> Iterator[ConfigIssue]:
    period_ms, source = measured_period_s.get(wire_id(received), 0.0) * 1000, Message("received-on-bus")
    if wire_id(received) == elcon.STATUS_ID | CAN_ID_EXTENDED:
        period_ms, source = CHARGER_STATUS_MS, Message("of-charger")
    if period_ms and received.timeout_ms <= period_ms:
        limit = Message("more-than-period", period=Quantity(period_ms, "ms", 0), source=source)
        why = Message("lost-between-frames")
        yield finding("error", "timeout", image, "can_rx_msg_timeout", received.index, limit, why)


def _content(image: bytes, tx: Sequence[TxMessage], rx: Sequence[RxMessage]) -> Iterator[ConfigIssue]:
    for message in tx:
        for signal in signals(message):
            if signal.is_cut:
                at = message.index * CAN_DATA_BYTES + signal.start_byte
                limit = Message("all-bytes")
                yield finding(
                    "warning", "cut", image, "can_tx_msg_data", at, limit, Message("only-sent", signal=signal.meaning)
                )
    charger = range(CHARGER_OFFSET, CHARGER_OFFSET + CHARGER_SIZE)
    for received in rx:
        for position, offset in enumerate(received.data_offsets[: received.length]):
            place = None if offset == BYTE_UNUSED or offset in charger else locate(offset)
            if place is not None:
                at = received.index * CAN_DATA_BYTES + position
                why = Message("master-protects-by", field=place[0].name)
                limit = Message("charger-reported-range", low=charger.start, high=charger.stop - 1)
                yield finding("warning", "overwrites", image, "can_rx_msg_data", at, limit, why)


def _load(image: bytes) -> Iterator[ConfigIssue]:
    load, rate = bus_load(image), bit_rate(CONFIG["can_brp"].unpack(image)[0])
    if load > WATCH_LOAD:
        taken, most = Quantity(load * 100, "%", 0), MAX_LOAD if load >= MAX_LOAD else WATCH_LOAD
        why = Message("others-need-share", load=taken, rate=Quantity(rate / 1000, "kbit/s"))
        limit = Message("load-below", load=Quantity(most * 100, "%", 0))
        yield finding("error" if load >= MAX_LOAD else "warning", "load", image, "can_tx_msg_timing", 0, limit, why)
