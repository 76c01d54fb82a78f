"""Tables of SPEC.md that come from the memory map; `python -m firmware_protocol.spec_tables` writes them into it."""

import argparse
import hashlib
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

from firmware_protocol import can_tables, spec_examples
from firmware_protocol import memory_map as mm
from firmware_protocol.config_image import default_image, limit_text
from firmware_protocol.eeprom import crc32

SPEC = Path(__file__).parent / "SPEC.md"
_TYPES = {"b": "i8", "B": "u8", "h": "i16", "H": "u16", "i": "i32", "I": "u32"}


def tables() -> dict[str, str]:
    """Return {marker: Markdown table}."""
    parts = (
        mm.Field("conf", mm.CONFIG_OFFSET, "B", (mm.CONFIG_SIZE,), meaning="the configuration in force, below"),
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
        for what, kind, sequence, uptime_ms, body, wire in spec_examples.rows()
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


if __name__ == "__main__":
    sys.exit(main())
