"""Tables of SPEC.md that come from the memory map; `python -m firmware_protocol.spec_tables` writes them into it."""

import argparse
import hashlib
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

from firmware_protocol import can_tables
from firmware_protocol import memory_map as mm
from firmware_protocol.config_image import default_image, limit_text
from firmware_protocol.eeprom import crc32
from firmware_protocol.framing import encode_frame
from firmware_protocol.memory_map import FIELDS, MAP_HASH
from firmware_protocol.messages import (
    EEPROM_READ_BASE,
    NO_OFFSET,
    Command,
    CommandId,
    Data,
    EventCode,
    EventMessage,
    FromMaster,
    Ident,
    IdentRequest,
    Load,
    MessageType,
    Read,
    Reply,
    Request,
    Result,
    Store,
    Window,
    Write,
    encode_request,
)

SPEC = Path(__file__).parent / "SPEC.md"
_TYPES = {"b": "i8", "B": "u8", "h": "i16", "H": "u16", "i": "i32", "I": "u32"}


def tables() -> dict[str, str]:
    """Return {marker: Markdown table}."""
    parts = (
        mm.Field("conf", mm.CONFIG_OFFSET, "B", (mm.CONFIG_SIZE,), meaning="the active configuration, below"),
        mm.Field("status", mm.STATUS_OFFSET, "B", (mm.STATUS_SIZE,), meaning="below"),
        mm.Field("charger", mm.CHARGER_OFFSET, "B", (mm.CHARGER_SIZE,), meaning="below"),
        mm.Field("slave", mm.SLAVE_OFFSET, "B", (mm.N_PACKS, mm.SLAVE_SIZE), meaning="one for each pack, below"),
    )
    top = sorted((*parts, *mm.TOP_FIELDS), key=lambda field: field.offset)
    return {
        "hash": _hash(),
        "map": _table(top),
        "status": _table(mm.STATUS_FIELDS),
        "charger": _table(mm.CHARGER_FIELDS),
        "slave": _table(mm.SLAVE_FIELDS),
        "config": _config_table(),
        "tx": _tx_table(),
        "rx": _rx_table(),
        "image": _image(),
        "examples": _examples(),
    }


def with_tables(text: str) -> str:
    """Return the document with the text between its markers replaced.

    Raises:
        ValueError: a marker is missing.
    """
    for name, table in tables().items():
        before, mark, rest = text.partition(f"<!-- {name} -->\n")
        _, end, after = rest.partition("<!-- end -->")
        if not (mark and end):
            raise ValueError(f"no place for the table {name!r}")
        text = f"{before}{mark}{table}\n{end}{after}"
    return text


def _table(fields: Iterable[mm.Field]) -> str:
    rows = (f"| {f.offset} | `{f.name}{_shape(f)}` | {_TYPES[f.fmt]} | {_count(f)} | {f.meaning} |" for f in fields)
    return _markdown("offset | field | type | one count | meaning", rows)


def _config_table() -> str:
    def rows() -> Iterator[str]:
        for field in mm.CONFIG_FIELDS:
            default = field.default if isinstance(field.default, int) else "section 7" if "can" in field.name else ""
            yield (
                f"| {field.offset} | `{field.name}{_shape(field)}` | {_TYPES[field.fmt]} | {_count(field)} "
                f"| {field.minimum}..{field.maximum} ({limit_text(field)}) | {default} | {field.meaning} |"
            )

    return _markdown("offset | field | type | one count | counts (range) | default | meaning", rows())


def _markdown(head: str, rows: Iterable[str]) -> str:
    return "\n".join([f"| {head} |", "| --- " * (head.count("|") + 1) + "|", *rows])


def _hash() -> str:
    lines, digest = mm.MAP_TEXT.splitlines(), hashlib.sha256(mm.MAP_TEXT.encode()).hexdigest()
    shown = [*lines[:2], "...", *lines[-2:]]
    return "\n".join(
        [
            "```",
            *shown,
            "```",
            f"{len(lines)} lines, {len(mm.MAP_TEXT)} bytes; SHA-256 `{digest}`;",
            f"the map hash is `{mm.MAP_HASH.hex(' ')}`.",
        ]
    )


def _offsets(offsets: Iterable[int]) -> str:
    return " ".join(map(str, offsets))


def _tx_table() -> str:
    rows = (
        f"| {m.index} | {int(m.enabled)} | {_can_id(m)} | {m.period_ms} | {m.length} | {_offsets(m.data_offsets)} |"
        for m in can_tables.tx_messages(default_image())
    )
    return _markdown("tx | bit in startup | id, as stored | timing | len | data", rows)


def _rx_table() -> str:
    rows = (
        f"| {m.index} | {int(m.enabled)} | {_can_id(m)} | {m.timeout_ms} | {m.length} "
        f"| {mm.NO_RESPONSE if m.response is None else m.response} | {_offsets(m.data_offsets)} |"
        for m in can_tables.rx_messages(default_image())
    )
    return _markdown("rx | bit in startup | id, as stored | timeout | len | response | data", rows)


def _can_id(message: can_tables.TxMessage | can_tables.RxMessage) -> str:
    return f"0x{message.can_id | mm.CAN_ID_EXTENDED * message.is_extended:X}"


def _image() -> str:
    image = default_image()
    lines = [image[at : at + 32].hex(" ") for at in range(0, 96, 32)]
    return "\n".join(["```", *lines, "...", "```", f"420 bytes, their CRC-32 (section 9) is `{crc32(image):08x}`."])


def _examples() -> str:
    rows = (
        f"| {what} | {kind} | {sequence} | {uptime_ms} | `{body.hex(' ') or '-'}` | `{wire.hex(' ')}` |"
        for what, kind, sequence, uptime_ms, body, wire in example_rows()
    )
    return _markdown("what | message | sequence | uptime_ms | body | on the line", rows)


def _shape(field: mm.Field) -> str:
    return "".join(f"[{n}]" for n in field.shape)


def _count(field: mm.Field) -> str:
    scale = f"{field.scale:.9g}"  # as in the text of the map hash
    return f"{scale} {field.unit}" if field.unit not in ("", "1") else scale


def main(argv: list[str] | None = None) -> int:
    """Write the tables into SPEC.md, or with --check return whether they are current."""
    parser = argparse.ArgumentParser(prog="python -m firmware_protocol.spec_tables", description=__doc__)
    parser.add_argument("--check", action="store_true", help="write nothing; exit status 1 if a table is not current")
    arguments = parser.parse_args(argv)
    text = SPEC.read_text(encoding="utf-8")
    current = with_tables(text)
    if arguments.check:
        return 0 if text == current else 1
    SPEC.write_text(current, encoding="utf-8", newline="\n")
    return 0


_MESSAGE_TYPES: dict[type, MessageType] = {
    Data: MessageType.DATA,
    Reply: MessageType.REPLY,
    EventMessage: MessageType.EVENT,
}
_ARGUMENTS = {  # arguments of commands
    CommandId.FAN_OVERRIDE: 128 + 256 * 60,
    CommandId.SET_SOC: 9991,
    CommandId.CAN_TX_ENABLE: 0b110,
    CommandId.CAN_SEND: 2,
    CommandId.BALANCE_CELLS: 2 * 4096 + 0b1000_0000_0001,
}
_EVENTS: dict[EventCode, tuple[int, int, int]] = {  # cell, value, limit
    EventCode.BOOT: (NO_OFFSET, 1, 0),
    EventCode.TRIP_V_MIN: (95, 24_987, 25_000),
    EventCode.TRIP_V_MAX: (36, 42_013, 42_000),
    EventCode.TRIP_T_MIN: (0, -16, -15),
    EventCode.TRIP_T_MAX: (54, 46, 45),
    EventCode.TRIP_I_DISC: (NO_OFFSET, 20_150, 20_000),
    EventCode.TRIP_I_CHRG: (NO_OFFSET, 1_310, 1_200),
    EventCode.TRIP_SLAVE_LOST: (24, 0, 0),
    EventCode.TRIP_SENSOR_LOST: (NO_OFFSET, 0, 0),
    EventCode.FAULTS_CLEARED: (NO_OFFSET, 0, 0),
    EventCode.CHARGER_STATE: (NO_OFFSET, 2, 0),
    EventCode.CONFIG_WRITTEN: (NO_OFFSET, 4, 2),
    EventCode.CONFIG_STORED: (NO_OFFSET, 7, 0),
    EventCode.CAN_RX_TIMEOUT: (NO_OFFSET, 0, 5_000),
    EventCode.EEPROM_INVALID: (NO_OFFSET, 0, 0),
    EventCode.SOC_SET: (NO_OFFSET, 9_991, 0),
}


def _field(name: str, count: int) -> Window:
    field = FIELDS[name]
    return Window(field.offset, count.to_bytes(field.item_size, "little", signed=field.fmt.islower()))


def _exchanges() -> Iterator[tuple[str, Request | FromMaster]]:
    yield "who are you", IdentRequest()
    yield "1.2.3, power on, start 41", Reply(16, 0, 0, data=Ident((1, 2, 3), MAP_HASH, 1, 0, 41).to_bytes())
    yield "`ts`", Read(0, 2)
    yield "100 ms; no offset", Reply(17, 2, 0, data=(100).to_bytes(2, "little"))
    yield "the first 16 bytes of the EEPROM", Read(EEPROM_READ_BASE, 16)
    yield "a store is under way", Reply(17, 4, Result.NOT_NOW)
    yield "`v_cell_max` 4.15 V", Write(4, (41_500).to_bytes(2, "little"))
    yield "done", Reply(18, 6, 0)
    yield "`v_cell_max` 4.51 V", Write(4, (45_100).to_bytes(2, "little"))
    yield "above its range, at offset 4", Reply(18, 8, Result.OUT_OF_RANGE, 4)
    yield "STORE", Store()
    yield "the EEPROM does not answer", Reply(19, 10, Result.EEPROM_FAILED)
    yield "LOAD", Load()
    yield "no slot is valid", Reply(20, 12, Result.NOTHING_STORED)


def _data() -> Iterator[tuple[str, Data]]:
    yield "`i_fs` -0.05 A", Data((_field("i_fs", -5),))
    yield "`soc` 99.91 %, `n_slaves` 8: two windows", Data((_field("soc", 9991), _field("n_slaves", 8)))
    yield "`status` and `charger` at rest: fit, usart1, can1", Data((Window(420, _status_and_charger()),))
    yield "no window", Data(())
    yield "a window of length 0 at 420, and `n_slaves` 8", Data((Window(420, b""), _field("n_slaves", 8)))


def _status_and_charger() -> bytes:
    masks = default_image()[39], default_image()[224]
    return (0b11001).to_bytes(4, "little") + bytes((*masks, 0, 255)) + bytes(8) + bytes((1, 0, 0, 32))


def example_rows() -> Iterator[tuple[str, str, int, int, bytes, bytes]]:
    """Yield (what it says, message, sequence, uptime_ms, body, bytes on the line) of each example."""
    messages: list[tuple[str, Request | FromMaster]] = [*_exchanges()]
    messages += [(command.name, Command(command, _ARGUMENTS.get(command, 0))) for command in CommandId]
    messages += _data()
    messages += [(code.name, EventMessage(code, 0, *event)) for code, event in _EVENTS.items()]
    for n, (what, message) in enumerate(messages):
        if isinstance(message, Data | Reply | EventMessage):
            kind, body, uptime_ms = _MESSAGE_TYPES[type(message)], message.to_body(), 90_000 + 20 * n
        else:
            kind, body = encode_request(message)
            uptime_ms = 0
        yield what, kind.name, n, uptime_ms, body, encode_frame(kind, n, uptime_ms, body)


if __name__ == "__main__":
    sys.exit(main())
