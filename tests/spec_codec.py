"""The master's protocol a second time, from the text of SPEC.md alone: nothing of ours is imported.

Its tables are read out of it. Whoever cannot write this file from the page has found a hole in the page.
"""

import hashlib
import math
import re
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

TEXT = (Path(__file__).parents[1] / "firmware_protocol" / "SPEC.md").read_text(encoding="utf-8")
CODES = {"u8": "B", "i8": "b", "u16": "H", "i16": "h", "u32": "I", "i32": "i"}
MAX_CHUNK, MAX_PAYLOAD, NONE = 523, 520, 0xFFFF
EXACT = {0.00392156863: 1 / 255}  # what section 6 says of the scale that is cut


class Field(NamedTuple):
    """A row of section 11, at its place in the whole struct."""

    name: str
    offset: int
    code: str
    shape: tuple[int, ...]
    scale: float
    limits: tuple[int, int] | None = None
    default: str = ""

    @property
    def count(self) -> int:
        return math.prod(self.shape)

    def values(self, image: bytes) -> tuple[int, ...]:
        return struct.unpack_from(f"<{self.count}{self.code}", image, self.offset)

    @property
    def size(self) -> int:
        return struct.calcsize(self.code)


def table(marker: str) -> list[list[str]]:
    """Return the cells of the rows of the table behind a marker."""
    lines = TEXT.split(f"<!-- {marker} -->\n")[1].split("<!-- end -->")[0].splitlines()
    return [[cell.strip(" `") for cell in line.strip("|").split(" | ")] for line in lines[2:]]


def fields(marker: str, prefix: str = "", base: int = 0) -> Iterator[Field]:
    """Yield the fields of a table of section 11."""
    for offset, name, code, one_count, *rest in table(marker):
        shape = tuple(map(int, re.findall(r"\[(\d+)\]", name)))
        scale = one_count.split()[0]
        limits, default = None, ""
        if marker == "config":
            low, high = rest[0].split(" ")[0].split("..")
            limits, default = (int(low), int(high)), rest[1]
        plain = name.split("[")[0]
        yield Field(prefix + plain, base + int(offset), CODES[code], shape, float(scale), limits, default)


PARTS = {"conf": "config", "status": "status", "charger": "charger"}


def whole_struct() -> list[Field]:
    """Return every field of the struct in order of offset, every slave spelt out."""
    found: list[Field] = []
    for field in fields("map"):
        if field.name == "slave":
            for i in range(8):
                found += fields("slave", f"slave[{i}].", field.offset + 180 * i)
        elif field.name in PARTS:
            found += fields(PARTS[field.name], f"{field.name}.", field.offset)
        else:
            found.append(field)
    return found


FIELDS = whole_struct()
CONFIG = {field.name.removeprefix("conf."): field for field in FIELDS if field.name.startswith("conf.")}


def map_hash() -> bytes:
    """Return what section 6 says of the memory map's hash."""
    lines = [f"{f.name} {f.offset} {f.code} {f.count} {f.scale:.9g}\n" for f in FIELDS]
    return hashlib.sha256("".join(lines).encode()).digest()[:8]


# Sections 3 and 4: frames and decoders


def crc16(data: bytes) -> int:
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


def cobs(payload: bytes) -> bytes:
    out = b""
    for i, run in enumerate(runs := payload.split(b"\0")):
        while len(run) >= 254:
            out, run = out + b"\xff" + run[:254], run[254:]
            if not run and i == len(runs) - 1:
                return out
        out += bytes([len(run) + 1]) + run
    return out


def uncobs(chunk: bytes) -> bytes | None:
    out, at = b"", 0
    while at < len(chunk):
        code = chunk[at]
        if code == 0 or at + code > len(chunk) or 0 in chunk[at + 1 : at + code]:
            return None
        out += chunk[at + 1 : at + code]
        at += code
        if code < 255 and at < len(chunk):
            out += b"\0"
    return out


class Frame(NamedTuple):
    type: int
    sequence: int
    uptime_ms: int
    body: bytes


def encode(type_: int, sequence: int, uptime_ms: int, body: bytes) -> bytes:
    payload = struct.pack("<BBI", type_, sequence, uptime_ms) + body
    return b"\0" + cobs(payload + struct.pack("<H", crc16(payload))) + b"\0"


def decode_chunk(chunk: bytes, too_long: bool = False) -> Frame | str:
    """Return the frame, or the word of section 4 for what is wrong."""
    if too_long or len(chunk) > MAX_CHUNK:
        return "long"
    payload = uncobs(chunk)
    if payload is None:
        return "cobs"
    if not 8 <= len(payload) <= MAX_PAYLOAD:
        return "short" if len(payload) < 8 else "long"
    if struct.pack("<H", crc16(payload[:-2])) != payload[-2:]:
        return "crc"
    return Frame(*struct.unpack_from("<BBI", payload), payload[6:-2])


def host_decoder(wire: bytes) -> list[Frame | str]:
    """Return frames and the words for bad frames; what comes before the first delimiter is dropped."""
    return [decode_chunk(chunk) for chunk in wire.split(b"\0")[1:-1] if chunk]


def master_decoder(wire: bytes, silence: bool) -> list[Frame | str]:
    """Return frames, "start", "stop" and the words for bad frames, as the table of the master's states has it."""
    found: list[Frame | str] = []
    inside, chunk = False, b""
    say = {ord("x"): "start", ord("y"): "stop"}
    for byte in wire:
        if not inside and byte in say:
            found.append(say[byte])
        elif byte:
            inside, chunk = True, chunk + bytes([byte])
        elif not inside:
            inside = True
        elif chunk:
            if set(chunk) <= set(say):
                found += [say[one] for one in chunk]
            else:
                found.append(decode_chunk(chunk))
                inside = not isinstance(found[-1], Frame)
            chunk = b""
    if silence and chunk:
        ended = [say[one] for one in chunk] if set(chunk) <= set(say) else [decode_chunk(chunk)]
        found += [item for item in ended if not isinstance(item, Frame)]
    return found


# Sections 5 and 6: what frames mean, as section 13 has it


def names(head: str) -> dict[int, str]:
    """Return {number: name} of the table whose first two columns are called so."""
    rows = TEXT.split(f"\n| {head}")[1].split("\n\n")[0].splitlines()[2:]
    return {int(row.split("|")[1], 0): row.split("|")[2].strip() for row in rows}


TYPES = names("type | name | body") | names("type | name | body | may be sent")
RESULTS, EVENTS, COMMANDS = names("result | name"), names("code | name"), names("command | name")


def or_none(number: int) -> int | None:
    return None if number == NONE else number


def elements(offset: int, data: bytes) -> Iterator[tuple[str, dict[str, float]]]:
    """Yield the elements of the struct that lie wholly in these bytes."""
    for field in FIELDS:
        for i in range(field.count):
            at = field.offset + i * field.size - offset
            if at >= 0 and at + field.size <= len(data):
                (count,) = struct.unpack_from(f"<{field.code}", data, at)
                indices = []
                for n in reversed(field.shape):
                    i, index = divmod(i, n)
                    indices.insert(0, f"[{index}]")
                scale = EXACT.get(field.scale, field.scale)
                yield field.name + "".join(indices), {"count": count, "value": float(f"{count * scale:.10g}")}


def windows(body: bytes) -> list[tuple[int, bytes]] | None:
    """Return the windows of a DATA frame, None where one of them is wrong."""
    found, at = [], 0
    while at < len(body):
        if at + 4 > len(body):
            return None
        offset, length = struct.unpack_from("<HH", body, at)
        at += 4 + length
        if at > len(body) or offset + length > 2984:
            return None
        found.append((offset, body[at - length : at]))
    return found


def meaning(frame: Frame) -> dict[str, Any]:
    """Return what a frame says, as in meanings.json."""
    name, body = TYPES.get(frame.type, frame.type), frame.body
    said: dict[str, Any] = {"message": name, "sequence": frame.sequence, "uptime_ms": frame.uptime_ms}
    said["body"] = body.hex()
    if name == "DATA":
        found = windows(body)
        assert found is not None
        said["windows"] = [{"offset": offset, "data": data.hex()} for offset, data in found]
        said["values"] = {key: value for window in found for key, value in elements(*window)}
    elif name == "REPLY":
        request, said["request_sequence"], result, offset = struct.unpack_from("<BBBH", body)
        said |= {"request": TYPES.get(request, request), "result": RESULTS.get(result, result)}
        said |= {"offset": or_none(offset), "data": body[5:].hex()}
        if (said["request"], said["result"]) == ("IDENT", "DONE"):
            protocol, major, minor, patch, map_hash, cause, boots = struct.unpack_from("<HBBB8sBI", body, 5)
            said |= {"protocol": protocol, "firmware": f"{major}.{minor}.{patch}", "map_hash": map_hash.hex()}
            said |= {"reset_cause": cause, "boots": boots}
    elif name == "EVENT":
        code, said["argument"], cell, said["value"], said["limit"] = struct.unpack("<BBHii", body)
        said |= {"event": EVENTS.get(code, code), "cell": or_none(cell)}
    elif name in ("READ", "WRITE"):
        said["offset"], said["length"] = struct.unpack_from("<HH", body)
        said |= {"data": body[4:].hex()} if name == "WRITE" else {}
    elif name == "COMMAND":
        command, said["argument"] = struct.unpack("<Bi", body)
        said["command"] = COMMANDS.get(command, command)
    return said


# Section 9: EEPROM


def newest_slot(memory: bytes) -> tuple[int, int, bytes] | None:
    """Return (slot, counter, image) of the newest valid slot."""
    found = []
    for slot in (0, 1):
        raw = memory[512 * slot : 512 * slot + 512]
        magic, length, layout, counter, crc = struct.unpack_from("<4sHHII", raw)
        image = raw[64:484]
        right = crc == zlib.crc32(raw[:12] + image) and (magic, length) == (b"VWCF", 420) and layout in (1, 2)
        if layout == 1:
            image = default_image()[:2] + image[2:226] + image[:2] + image[228:]
        if right and counter:
            found.append((slot, counter, image))
    return max(found, key=lambda each: each[1], default=None)  # the first of equal counters


def journal_entry(counter: int, dod: int, soc: int) -> tuple[int, bytes]:
    """Return the address and the bytes of an entry."""
    raw = struct.pack("<IIHHI", counter, dod, soc, 2, 0)
    return 1024 + 64 * ((counter - 1) % 496), raw + struct.pack("<I", zlib.crc32(raw))


def journal_meaning(raw: bytes) -> tuple[int, int, int] | None:
    """Return (counter, dod, soc) of an entry, None where it is none."""
    counter, dod, soc, layout = struct.unpack_from("<IIHH", raw)
    at = {0: 12, 2: 16}.get(layout)
    if at is None or not counter or struct.unpack_from("<I", raw, at)[0] != zlib.crc32(raw[:at]):
        return None
    return counter, dod if layout else (5 * dod + 9) // 18, soc


# Section 11: what a WRITE may hold


def refused(image: bytes) -> int:
    """Return the offset of the first element at fault of a configuration, or 0xFFFF."""
    faults = []
    value = {name: field.values(image) for name, field in CONFIG.items()}
    for name, field in CONFIG.items():
        low, high = field.limits or (0, 0)
        for i, one in enumerate(value[name]):
            wrong = not low <= one <= high
            if name.endswith("msg_id"):
                wrong |= one & 0x7FFFFFFF > (0x1FFFFFFF if one >> 31 else 0x7FF)
            elif name.endswith("msg_data"):
                wrong |= one != NONE and not (0 if "_tx_" in name else 420) <= one <= 2983
            elif name.endswith("response"):
                wrong |= one not in (*range(8), *range(64, 72), 255)
            if wrong:
                faults.append(field.offset + i * field.size)
    for low, sign, high in re.findall(r"`(\w+)` (<=?)\s`(\w+)`", TEXT.split("limits the wrong way round:")[1]):
        (a,), (b,) = value[low], value[high]
        if a > b or (a == b and sign == "<"):
            faults.append(CONFIG[low].offset)
    return min(faults, default=NONE)


def default_image() -> bytes:
    """Return the default configuration: section 11's defaults and section 7's tables."""
    image = bytearray(420)
    for field in CONFIG.values():
        if field.default.lstrip("-").isdigit():
            struct.pack_into(f"<{field.code}", image, field.offset, int(field.default))
    for direction, columns in (("tx", "id timing len data"), ("rx", "id timeout len response data")):
        for index, _, *row in table(direction):
            for column, text in zip(columns.split(), row, strict=True):
                field = CONFIG[f"can_{direction}_msg_{column}"]
                numbers = [int(number, 0) for number in text.split()]
                at = field.offset + int(index) * field.size * len(numbers)
                struct.pack_into(f"<{len(numbers)}{field.code}", image, at, *numbers)
    return bytes(image)


def can_message(image: bytes, index: int) -> tuple[int, bytes]:
    """Return (id as stored, data) of a tx message, by the tables at the start of the struct's image."""
    ids, lengths, data = (CONFIG[f"can_tx_msg_{name}"].values(image) for name in ("id", "len", "data"))
    offsets = data[8 * index : 8 * index + lengths[index]]
    return ids[index], bytes(0 if offset == NONE else image[offset] for offset in offsets)


def can_received(image: bytearray, stored_id: int, content: bytes) -> None:
    """Write a received message's bytes to where the first enabled rx message of this id has them."""
    ids, lengths, data = (CONFIG[f"can_rx_msg_{name}"].values(image) for name in ("id", "len", "data"))
    (enabled,) = CONFIG["can_rx_msg_en_startup"].values(image)
    index = next(i for i in range(8) if enabled >> i & 1 and ids[i] == stored_id)
    for offset, byte in zip(data[8 * index : 8 * index + lengths[index]], content, strict=False):
        if offset != NONE:
            image[offset] = byte
