"""Writes `meanings.json`: frames on the line and what they say, as JSON: `python -m tests.vectors.make_meanings`.

The same frames as in `whole_frames.json`, and broken ones; nothing here uses the code under test. Section 13 of SPEC.md
says what the names mean.
"""

import json

from tests.vectors.make_frames import COMMANDS, EVENTS, NO_OFFSET, RESULTS, frames
from tests.vectors.make_vectors import HERE, cobs, le, payload, wire

MESSAGES = {1: "DATA", 2: "REPLY", 3: "EVENT", 16: "IDENT", 17: "READ", 18: "WRITE", 19: "STORE", 20: "LOAD",
            32: "COMMAND"}  # fmt: skip


def name_of(words):
    return words.upper().replace(" ", "_")


COMMAND_NAMES = {number: name_of(name) for name, number, *_ in COMMANDS if number != 200}
EVENT_NAMES = {code: name_of(name) for code, name in enumerate(EVENTS, 1)}
RESULT_NAMES = {result: name_of(name) for result, name in enumerate(RESULTS)}


def or_null(number):
    return None if number == NO_OFFSET else number


def of_data(row):
    windows = [part.split(":") for part in row["windows"].split()]
    counts = [int(part.split(":")[2]) for part in row["counts"].split()]
    named = [part.split("=") for part in row["meaning"].split()]
    yield "windows", [{"offset": int(offset), "data": data} for offset, data in windows]
    yield "values", {name: {"count": n, "value": float(value)} for n, (name, value) in zip(counts, named, strict=True)}


def of_reply(row):
    yield "request", MESSAGES[row["request_type"]]
    yield "request_sequence", row["request_sequence"]
    yield "result", RESULT_NAMES[row.get("result", 0)]
    yield "offset", or_null(row.get("offset", NO_OFFSET))
    yield "data", row["data"]
    for name in ("protocol", "firmware", "map_hash", "reset_cause", "boots"):
        if name in row:
            yield name, row[name]


def of_event(row):
    yield "event", EVENT_NAMES.get(row["code"], row["code"])
    yield "cell", or_null(row["cell"])
    for name in ("argument", "value", "limit"):
        yield name, row[name]


def of_request(row):
    if "command" in row:
        yield "command", COMMAND_NAMES.get(row["command"], row["command"])
    if row["kind"] == "write":
        yield "length", len(row["data"]) // 2
    for name in ("offset", "length", "data", "argument"):
        if name in row:
            yield name, row[name]


OF = {"DATA": of_data, "REPLY": of_reply, "EVENT": of_event}


def meaning(row):
    message, raw = MESSAGES[row["type"]], decoded_body(row["wire"])
    head = {"message": message, "sequence": row["sequence"], "uptime_ms": row["uptime_ms"], "body": raw.hex()}
    return head | dict(OF.get(message, of_request)(row))


def decoded_body(text):
    """The body of a frame on the line: COBS back, by its definition."""
    rest, out = bytes.fromhex(text)[1:-1], b""
    while rest:
        out += rest[1 : rest[0]] + (b"\0" if rest[0] < 255 else b"")
        rest = rest[rest[0] :]
    return (out[:-1] if out.endswith(b"\0") else out)[6:-2]


def broken():
    good = payload(17, 7, 0, le(0, 2) + le(2, 2))
    yield "a damaged bit", "crc", cobs(good[:-1] + bytes([good[-1] ^ 1]))
    yield "the check sum in the wrong order", "crc", cobs(good[:-2] + good[:-3:-1])
    yield "cut in its body", "crc", cobs(good[:8])
    yield "seven bytes", "short", cobs(good[:7])
    yield "nothing but a length", "short", b"\x01"
    yield "a length beyond the end", "cobs", cobs(good)[:-1]
    yield "a body of 513 bytes", "long", cobs(payload(2, 0, 0, bytes([9]) * 513))
    yield "524 bytes on the line", "long", b"\x01" * 524


def file_text():
    rows = [{"name": row["name"], "wire": row["wire"]} | meaning(row) for row in frames()]
    flat = {"type": 1, "sequence": 30, "uptime_ms": 90600, "windows": "420: 440:08", "counts": "440:1:8",
            "meaning": "n_slaves=8"}  # fmt: skip
    flat["wire"] = wire(1, 30, 90600, bytes.fromhex("a4010000b801010008")).hex()
    rows.append({"name": "data: a window of length 0", "wire": flat["wire"]} | meaning(flat))
    rows += [
        {"name": f"no frame: {name}", "wire": (b"\0" + chunk + b"\0").hex(), "error": error}
        for name, error, chunk in broken()
    ]
    text = ",\n".join("  " + json.dumps(row, separators=(",", ":")) for row in rows)
    return (
        f'{{\n "about": "Frames on the line and what they say; SPEC.md, section 13.",\n "vectors": [\n{text}\n ]\n}}\n'
    )


if __name__ == "__main__":
    (HERE / "meanings.json").write_text(file_text(), encoding="utf-8", newline="\n")
