"""The C header that the firmware compiles, generated from the memory map.

Structs without packing (ARM's and every desktop's alignment give the map's offsets, which the header asserts), offsets,
enums, and the configuration's ranges and defaults as an X-macro.
"""

import enum
from collections.abc import Iterable, Iterator

from firmware_protocol import eeprom, framing, messages, older_maps, schedule
from firmware_protocol import memory_map as mm

_C_TYPES = {"b": "int8_t", "B": "uint8_t", "h": "int16_t", "H": "uint16_t", "i": "int32_t", "I": "uint32_t"}
_STRUCTS: tuple[tuple[str, tuple[mm.Field, ...], int], ...] = (
    ("config", mm.CONFIG_FIELDS, mm.CONFIG_SIZE),
    ("status", mm.STATUS_FIELDS, mm.STATUS_SIZE),
    ("charger", mm.CHARGER_FIELDS, mm.CHARGER_SIZE),
    ("slave", mm.SLAVE_FIELDS, mm.SLAVE_SIZE),
)
_PARTS = (
    ("conf", "config", 0, mm.CONFIG_OFFSET),
    ("status", "status", 0, mm.STATUS_OFFSET),
    ("charger", "charger", 0, mm.CHARGER_OFFSET),
    ("slave", "slave", mm.N_PACKS, mm.SLAVE_OFFSET),
)


def header_text() -> str:
    """Return the whole header."""
    return "\n".join(
        [
            "/* Generated from the memory map: do not edit. */",
            "#ifndef VOLTWALL_PROTOCOL_H",
            "#define VOLTWALL_PROTOCOL_H",
            "",
            "#include <stddef.h>",
            "#include <stdint.h>",
            "",
            *_constants(),
            "",
            *_enums(),
            *_struct_types(),
            *_assertions(),
            "",
            *_config_macro(),
            "",
            *_command_macro(),
            "",
            "#endif",
            "",
        ]
    )


def _constants() -> Iterator[str]:
    hash_bytes = ", ".join(f"0x{byte:02x}u" for byte in mm.MAP_HASH)
    values: tuple[tuple[str, object], ...] = (
        ("PROTOCOL_VERSION", messages.PROTOCOL_VERSION),
        ("MAP_HASH", f"{{ {hash_bytes} }}"),
        ("MASTER_SIZE", mm.MASTER_SIZE),
        ("CONFIG_SIZE", mm.CONFIG_SIZE),
        ("N_PACKS", mm.N_PACKS),
        ("CELLS_PER_PACK", mm.CELLS_PER_PACK),
        ("N_CELLS", mm.N_CELLS),
        ("N_CAN_MESSAGES", mm.N_CAN_MESSAGES),
        ("CAN_DATA_BYTES", mm.CAN_DATA_BYTES),
        ("CAN_ID_EXTENDED", f"0x{mm.CAN_ID_EXTENDED:08x}u"),
        ("BYTE_UNUSED", f"0x{mm.BYTE_UNUSED:04x}u"),
        ("NO_RESPONSE", f"0x{mm.NO_RESPONSE:02x}u"),
        ("RESPONSE_CHARGES", f"0x{mm.RESPONSE_CHARGES:02x}u"),
        ("NO_OFFSET", f"0x{messages.NO_OFFSET:04x}u"),
        ("V_MISSING", mm.V_MISSING),
        ("T_MISSING", f"({mm.T_MISSING})"),
        ("CHIP_MISSING", f"0x{mm.CHIP_MISSING:04x}u"),
        ("START_STREAM", f"0x{framing.START_STREAM:02x}u"),
        ("STOP_STREAM", f"0x{framing.STOP_STREAM:02x}u"),
        ("HEADER_SIZE", framing.HEADER_SIZE),
        ("MAX_BODY", framing.MAX_BODY),
        ("MAX_PAYLOAD", framing.MAX_PAYLOAD),
        ("MAX_ENCODED", framing.MAX_ENCODED),
        ("MAX_READ", messages.MAX_READ),
        ("EEPROM_READ_BASE", f"0x{messages.EEPROM_READ_BASE:04x}u"),
        ("EEPROM_SIZE", eeprom.EEPROM_SIZE),
        ("EEPROM_PAGE_SIZE", eeprom.PAGE_SIZE),
        ("EEPROM_SLOT_SIZE", eeprom.SLOT_SIZE),
        ("EEPROM_LAYOUT_VERSION", eeprom.LAYOUT_VERSION),
        ("EEPROM_FIRST_LAYOUT", older_maps.FIRST_LAYOUT),
        ("EEPROM_JOURNAL_OFFSET", eeprom.JOURNAL_OFFSET),
        ("EEPROM_JOURNAL_PAGES", eeprom.JOURNAL_PAGES),
        ("STREAM_SLOW_LENGTH", schedule.SLOW_LENGTH),
        ("STREAM_SLOW_WORTHWHILE", schedule.SLOW_LENGTH_WORTHWHILE),
        ("STREAM_ALIGNMENT", schedule.ALIGNMENT),
        ("STREAM_TURN_MS", round(schedule.SLOW_TURN_S * 1000)),
        ("STREAM_FAST_PER_SLOW", schedule.FAST_PER_SLOW),
        ("BAUD_RATE", framing.BAUD_RATE),
        ("BITS_PER_BYTE", framing.BITS_PER_BYTE),
        ("LINE_SILENCE_MS", round(framing.LINE_SILENCE_S * 1000)),
        ("REPEAT_WINDOW_MS", round(messages.REPEAT_WINDOW_S * 1000)),
    )
    for name, value in values:
        yield f"#define VW_{name} {value}{'u' if isinstance(value, int) and value >= 0 else ''}"
    for name, spans in (("FAST_WINDOWS", schedule.FAST_WINDOWS), ("SLOW_RANGES", schedule.SLOW_RANGES)):
        pairs = ", ".join(f"{{ {offset}u, {length}u }}" for offset, length in spans)
        yield f"#define VW_STREAM_{name} {{ {pairs} }}  /* offset, length */"


def _enums() -> Iterator[str]:
    kinds: tuple[tuple[str, str, type[enum.IntEnum]], ...] = (
        ("message", "MSG", messages.MessageType),
        ("result", "RESULT", messages.Result),
        ("command", "COMMAND", messages.CommandId),
        ("event", "EVENT", messages.EventCode),
    )
    for name, prefix, members in kinds:
        yield from _enum(name, ((f"VW_{prefix}_{m.name}", f"0x{m.value:02x}u") for m in members))
    for name, flags in mm.FLAGS.items():
        word = name.partition(".")[0]
        yield from _enum(f"{word}_flag", ((f"VW_{word}_{f}".upper(), f"0x{1 << bit:x}") for bit, f in enumerate(flags)))
    for name, values in mm.VALUES.items():
        word = name.replace(".", "_")
        yield from _enum(word, ((f"VW_{word}_{text}".upper(), str(value)) for value, text in values.items()))


def _enum(name: str, members: Iterable[tuple[str, str]]) -> Iterator[str]:
    yield f"enum vw_{name} {{"
    yield from (f"    {member} = {value}," for member, value in members)
    yield "};"
    yield ""


def _struct_types() -> Iterator[str]:
    for name, fields, size in _STRUCTS:
        yield f"typedef struct {{  /* {size} bytes */"
        yield from map(_declaration, fields)
        yield f"}} vw_{name}_t;"
        yield ""
    yield f"typedef struct {{  /* {mm.MASTER_SIZE} bytes */"
    members = [(offset, _part(part, kind, count)) for part, kind, count, offset in _PARTS]
    members += [(field.offset, _declaration(field)) for field in mm.TOP_FIELDS]
    yield from (line for _, line in sorted(members))
    yield "} vw_master_t;"
    yield ""


def _part(part: str, kind: str, count: int) -> str:
    return f"    vw_{kind}_t {part}{f'[{count}]' if count else ''};"


def _declaration(field: mm.Field) -> str:
    shape = "".join(f"[{n}]" for n in field.shape)
    scale = "" if field.scale == 1 else f"{field.scale:.9g}"
    unit = f"{scale} {field.unit if field.unit != '1' else ''}".strip()
    return f"    {_C_TYPES[field.fmt]} {field.name}{shape};  /* {field.meaning}{f' [{unit}]' if unit else ''} */"


def _assertions() -> Iterator[str]:
    yield "#if defined(__STDC_VERSION__) && __STDC_VERSION__ >= 201112L"
    yield "#define VW_ASSERT(name, claim) _Static_assert(claim, #name)"
    yield "#else"
    yield "#define VW_ASSERT(name, claim) typedef char vw_assert_##name[(claim) ? 1 : -1]"
    yield "#endif"
    yield ""
    for name, fields, size in _STRUCTS:
        for field in fields:
            yield _offset_assertion(name, field.name, field.offset)
        yield f"VW_ASSERT({name}_size, sizeof(vw_{name}_t) == {size}u);"
    for part, _kind, _count, offset in _PARTS:
        yield _offset_assertion("master", part, offset)
    for field in mm.TOP_FIELDS:
        yield _offset_assertion("master", field.name, field.offset)
    yield f"VW_ASSERT(master_size, sizeof(vw_master_t) == {mm.MASTER_SIZE}u);"


def _offset_assertion(struct: str, member: str, offset: int) -> str:
    return f"VW_ASSERT({struct}_{member}, offsetof(vw_{struct}_t, {member}) == {offset}u);"


def _config_macro() -> Iterator[str]:
    yield "/* X(name, offset, type, count, minimum, maximum, live) for every configuration field, in raw counts;"
    yield " * live: 1 where it may be changed while the car drives or charges\n */"
    yield "#define VW_CONFIG_FIELDS(X) \\"
    rows = [
        f"    X({f.name}, {f.offset}u, {_C_TYPES[f.fmt]}, {f.count}u, {_literal(f.minimum)}, {_literal(f.maximum)},"
        f" {int(f.is_live)})"
        for f in mm.CONFIG_FIELDS
    ]
    yield " \\\n".join(rows)
    yield ""
    yield "/* initializer of vw_config_t */"
    yield "#define VW_CONFIG_DEFAULTS { \\"
    yield from (f"    {_initializer(field)}, /* {field.name} */ \\" for field in mm.CONFIG_FIELDS)
    yield "}"


def _command_macro() -> Iterator[str]:
    yield "/* X(name, code, lowest argument, highest argument) for every command */"
    yield "#define VW_COMMANDS(X) \\"
    yield " \\\n".join(
        f"    X({command.name.lower()}, VW_COMMAND_{command.name}, {_int32(low)}, {_int32(high)})"
        for command in messages.CommandId
        for low, high in [messages.COMMAND_ARGUMENTS.get(command, (-(1 << 31), (1 << 31) - 1))]
    )


def _int32(value: int) -> str:
    return {-(1 << 31): "INT32_MIN", (1 << 31) - 1: "INT32_MAX"}.get(value, str(value))


def _literal(value: int | None) -> str:
    return f"{value}{'u' if value is not None and value > 0x7FFFFFFF else ''}"


def _initializer(field: mm.Field) -> str:
    values = field.default if isinstance(field.default, tuple) else (field.default,)
    if not field.shape:
        return _literal(values[0])
    if len(field.shape) == 1:
        return f"{{ {', '.join(map(_literal, values))} }}"
    step = field.shape[1]
    rows = (values[i : i + step] for i in range(0, len(values), step))
    return "{ " + ", ".join(f"{{ {', '.join(map(_literal, row))} }}" for row in rows) + " }"
