"""Message definitions from a file that cantools reads: DBC, SYM, KCD, ARXML. DBCs are repaired first."""

import contextlib
import logging
import re
from importlib import import_module
from math import isfinite
from pathlib import Path
from typing import Any

from app.errors import ExtraMissing, ImportFailed
from app.sources.dbc.definitions import (
    FLOAT_BITS,
    BitLayout,
    Definitions,
    MessageDefinition,
    MultiplexCondition,
    Oddity,
    SignalDefinition,
)
from app.sources.dbc.repair import repaired
from app.words import Message
from firmware_protocol.memory_map import CAN_ID_EXTENDED

DEFINITION_ENDINGS = (".dbc", ".sym", ".kcd", ".arxml")
_FORMATS = ", ".join(DEFINITION_ENDINGS)
_MOST_LEFT_OUT = 40  # lines; a file with more of them is something else
MOST_CYCLE_MS = 1e9
LONGEST_NAME = 200  # characters of a message's or a signal's name
_LENGTHS_FD = (12, 16, 20, 24, 32, 48, 64)


def load_definitions(path: Path) -> Definitions:
    """Return the messages of a file, and what was odd about it.

    Raises:
        ExtraMissing: cantools is not installed.
        ImportFailed: the file cannot be read as what its name says.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ImportFailed(path.name, Message("cannot-be-read", error=error.strerror or str(error))) from error
    return parse_definitions(data, path.name)


def parse_definitions(data: bytes, name: str) -> Definitions:
    """Return the messages of a file's bytes; `name` tells its format.

    Raises:
        ExtraMissing: cantools is not installed.
        ImportFailed: the bytes cannot be read as what the name says.
    """
    try:
        database = import_module("cantools.database")
    except ImportError as error:
        raise ExtraMissing("a DBC", "cantools", "dbc") from error
    try:
        return _parsed(database, data, name)
    except (ValueError, OverflowError, RecursionError) as error:  # a number or a name beyond every limit
        raise ImportFailed(name, Message("no-dbc", error=_first_line(error))) from error


def _parsed(database: Any, data: bytes, name: str) -> Definitions:
    ending = Path(name.lower()).suffix
    if b"\0" in data and data[:2] not in (b"\xff\xfe", b"\xfe\xff"):
        raise ImportFailed(name, Message("dbc-no-text", formats=_FORMATS))
    oddities: list[Oddity] = []
    text = _text(data, name, oddities)
    if ending == ".dbc":
        text, repairs = repaired(text, name)
        oddities += repairs
    options = {"database_format": ending[1:]} if ending in DEFINITION_ENDINGS else {}
    logging.getLogger("cantools").setLevel(logging.ERROR)  # its warnings are oddities
    while True:
        try:
            loaded: Any = database.load_string(text, strict=False, sort_signals=None, **options)
            break
        except Exception as error:  # every format raises its own
            shorter = _without_line(text, name, error, oddities) if ending == ".dbc" else None
            if shorter is None:
                # for an unknown format cantools lists every parser's complaint
                unknown = Message("dbc-no-format", formats=_FORMATS)
                why = Message("no-dbc", error=_first_line(error)) if options else unknown
                raise ImportFailed(name, why) from error
            text = shorter
    lines = _lines_of_messages(text)
    messages: list[MessageDefinition] = []
    of_id: dict[int, str] = {}
    for message in getattr(loaded, "messages", []):
        definition = _message(message)
        if of_id.setdefault(definition.can_id, definition.name) != definition.name:  # two buses in one file
            oddities.append(
                Oddity(name, None, Message("dbc-id-twice", name=definition.name, id=f"0x{definition.can_id:X}"))
            )
            continue
        messages.append(definition)
        oddities += [
            Oddity(name, lines.get(definition.name), Message("dbc-float-bits", name=signal.name, bits=signal.length))
            for signal in message.signals
            if signal.is_float and signal.length not in FLOAT_BITS
        ]
        oddities += _issues(definition, name, lines.get(definition.name))
    if not messages:
        raise ImportFailed(name, Message("dbc-no-message"))
    return Definitions(tuple(messages), tuple(oddities))


def _without_line(text: str, name: str, error: Exception, oddities: list[Oddity]) -> str | None:
    """Return the text without the unreadable line, which becomes an oddity; None where that does not help."""
    match = re.search(r"at line (\d+)", str(error))
    lines = text.split("\n")
    number = int(match[1]) if match else 0
    left_out = [
        oddity for oddity in oddities if isinstance(oddity.what, Message) and oddity.what.code == "dbc-line-unreadable"
    ]
    if not 1 <= number <= len(lines) or not lines[number - 1].strip() or len(left_out) >= _MOST_LEFT_OUT:
        return None
    oddities.append(Oddity(name, number, Message("dbc-line-unreadable", text=lines[number - 1].strip()[:60])))
    lines[number - 1] = ""
    return "\n".join(lines)


def _text(data: bytes, name: str, oddities: list[Oddity]) -> str:
    for encoding in ("utf-8-sig", "cp1252", "latin-1"):
        with contextlib.suppress(UnicodeDecodeError):
            text = data.decode(encoding)
            if encoding != "utf-8-sig":
                line = next((n for n, line in enumerate(data.split(b"\n"), 1) if not _is_utf8(line)), None)
                oddities.append(Oddity(name, line, Message("dbc-not-utf-8", encoding=encoding)))
            return text
    return data.decode("latin-1")


def _is_utf8(line: bytes) -> bool:
    try:
        line.decode("utf-8")
    except UnicodeDecodeError:
        return False
    return True


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:200]


def _lines_of_messages(text: str) -> dict[str, int]:
    return {
        match[1]: number
        for number, line in enumerate(text.split("\n"), 1)
        if (match := re.match(r"BO_ \d+ (\w+)\s*:", line))
    }


def _message(message: Any) -> MessageDefinition:
    can_id = int(message.frame_id) | (CAN_ID_EXTENDED if message.is_extended_frame else 0)
    by_name = {signal.name: signal for signal in message.signals}
    senders = list(message.senders or [])
    longest = max(map(len, (str(message.name), *by_name)))
    if longest > LONGEST_NAME:
        raise ValueError(f"a name of {longest} characters; at most {LONGEST_NAME}")
    signals = tuple(_signal(signal, by_name) for signal in message.signals if 1 <= signal.length <= 64)
    sender = senders[0] if senders else ""
    cycle_ms = message.cycle_time  # an attribute of the file: of whatever kind that says
    period_s = cycle_ms / 1000 if isinstance(cycle_ms, int | float) and 0 < cycle_ms < MOST_CYCLE_MS else None
    return MessageDefinition(can_id, str(message.name), int(message.length), signals, sender, period_s)


def _signal(signal: Any, by_name: dict[str, Any]) -> SignalDefinition:
    is_float = bool(signal.is_float) and signal.length in FLOAT_BITS
    layout = BitLayout(
        start=int(signal.start),
        length=int(signal.length),
        is_little_endian=signal.byte_order == "little_endian",
        is_signed=bool(signal.is_signed) and not is_float,
        is_float=is_float,
        scale=float(signal.scale),
        offset=float(signal.offset),
    )
    if not isfinite(layout.scale) or not isfinite(layout.offset):
        raise ValueError(f"{signal.name}: factor {layout.scale} and offset {layout.offset} have to be finite")
    conditions: list[MultiplexCondition] = []
    inner = signal
    while inner.multiplexer_ids is not None and inner.multiplexer_signal in by_name and len(conditions) < 8:
        conditions.append(
            MultiplexCondition(
                inner.multiplexer_signal, tuple(int(multiplexer_id) for multiplexer_id in inner.multiplexer_ids)
            )
        )
        inner = by_name[inner.multiplexer_signal]
    choices = {int(number): str(text) for number, text in (signal.choices or {}).items()}
    low, high = signal.minimum, signal.maximum
    return SignalDefinition(
        name=str(signal.name),
        layout=layout,
        unit=str(signal.unit or "").strip(),
        minimum=None if low is None else float(low),
        maximum=None if high is None else float(high),
        conditions=tuple(conditions),
        is_multiplexer=bool(signal.is_multiplexer),
        choices=choices,
    )


def _issues(message: MessageDefinition, file: str, line: int | None) -> list[Oddity]:
    """A length that no frame has, signals that stand beyond it."""
    oddities = []
    if message.length > 8 and message.length not in _LENGTHS_FD:
        oddities.append(Oddity(file, line, Message("dbc-length", name=message.name, bytes=message.length)))
    beyond = [signal.name for signal in message.signals if signal.layout.end_byte > max(message.length, 0)]
    if beyond:
        oddities.append(
            Oddity(
                file,
                line,
                Message("dbc-signals-beyond", name=message.name, bytes=message.length, names=tuple(beyond[:6])),
            )
        )
    return oddities
