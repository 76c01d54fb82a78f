"""Tables of SPEC.md that come from the memory map; `python -m firmware_protocol.spec_tables` writes them into it."""

import argparse
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

from firmware_protocol import memory_map as mm
from firmware_protocol.config_image import limit_text

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
        "hash": f"`{mm.MAP_HASH.hex(' ')}`",
        "map": _table(top),
        "status": _table(mm.STATUS_FIELDS),
        "charger": _table(mm.CHARGER_FIELDS),
        "slave": _table(mm.SLAVE_FIELDS),
        "config": _config_table(),
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
    rows = [f"| {f.offset} | `{f.name}{_shape(f)}` | {_TYPES[f.fmt]} | {_count(f)} | {f.meaning} |" for f in fields]
    return "\n".join(["| offset | field | type | one count | meaning |", "| --- | --- | --- | --- | --- |", *rows])


def _config_table() -> str:
    def rows() -> Iterator[str]:
        for field in mm.CONFIG_FIELDS:
            default = field.default if isinstance(field.default, int) else "section 7" if "can" in field.name else ""
            yield (
                f"| {field.offset} | `{field.name}{_shape(field)}` | {_TYPES[field.fmt]} | {_count(field)} "
                f"| {field.minimum}..{field.maximum} ({limit_text(field)}) | {default} | {field.meaning} |"
            )

    head = ["| offset | field | type | one count | counts (range) | default | meaning |", "| --- " * 7 + "|"]
    return "\n".join([*head, *rows()])


def _shape(field: mm.Field) -> str:
    return "".join(f"[{n}]" for n in field.shape)


def _count(field: mm.Field) -> str:
    scale = "1" if field.scale == 1 else f"{field.scale:.4g}"
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
