"""Writes the shared vectors: `python tests/vectors/make_vectors.py`.

Nothing here uses the code under test. Checksums are worked bit by bit, COBS by its definition, numbers are laid down
byte by byte, and each vector says where its expected bytes come from. Vectors are flat: text, numbers and hex only, so
that a few lines read them in any language. Items of a stream are separated by blanks: `start`, `stop`, `bad:REASON`,
`frame:TYPE:SEQUENCE:UPTIME:BODY`, all in hex but the reason, an empty body as `-`.
"""

import json
from pathlib import Path

HERE = Path(__file__).parent
WORKED = "laid down by hand; CRC bit by bit, COBS by its definition"


def le(value, size):
    return (value % (1 << 8 * size)).to_bytes(size, "little")


def crc16(data):
    """CRC-16/IBM-3740, one bit at a time."""
    register = 0xFFFF
    for byte in data:
        for bit in range(7, -1, -1):
            top = (register >> 15) ^ (byte >> bit & 1)
            register = register << 1 & 0xFFFF
            if top:
                register ^= 0x1021
    return register


def crc32(data):
    """CRC-32/ISO-HDLC, one bit at a time."""
    register = 0xFFFFFFFF
    for byte in data:
        for bit in range(8):
            low = (register ^ byte >> bit) & 1
            register >>= 1
            if low:
                register ^= 0xEDB88320
    return register ^ 0xFFFFFFFF


def cobs(data):
    """Cut into runs without a zero: a run of up to 253 bytes stands for itself and one zero, one of 254 for itself."""
    rest, out = data + b"\0", b""  # the zero that COBS takes as following the data
    while rest:
        run = rest[:254].partition(b"\0")[0]
        out += bytes([len(run) + 1]) + run
        rest = rest[len(run) :] if len(run) == 254 else rest[len(run) + 1 :]
        if len(run) == 254 and rest == b"\0":
            break
    return out


def payload(kind, sequence, uptime_ms, body):
    head = bytes([kind, sequence]) + le(uptime_ms, 4) + body
    return head + le(crc16(head), 2)


def wire(kind, sequence, uptime_ms, body):
    return b"\0" + cobs(payload(kind, sequence, uptime_ms, body)) + b"\0"


def frame_item(kind, sequence, uptime_ms, body):
    return f"frame:{kind:02x}:{sequence:02x}:{uptime_ms:08x}:{body.hex() or '-'}"


FRAMES = (
    ("ident request", 0x10, 0, 0, ""),
    ("read of ts", 0x11, 7, 0, "00000200"),
    ("write of v_cell_max 4.15 V", 0x12, 8, 0, "040002001ca2"),
    ("store", 0x13, 255, 0, ""),
    ("command set soc 99.91 %", 0x20, 1, 0, "0707270000"),
    ("data: current of -0.05 A", 0x01, 200, 3600000, "5c070400fbffffff"),
    ("reply: v_cell_max out of range", 0x02, 3, 90000, "1208040400"),
    ("event: cell 36 above 4.2 V", 0x03, 4, 4294967295, "030024001da4000010a40000"),
    ("body of x and y", 0x78, 0x79, 0x78797879, "7879" * 20),
    ("no zero for 254 bytes", 0x01, 1, 0x01010101, "ab" * 246),
    ("no zero for 255 bytes", 0x01, 1, 0x01010101, "ab" * 247),
    ("no zero in the longest body", 0xFF, 0xFF, 0xFFFFFFFF, "ff" * 512),
    ("only zeros in the longest body", 0x00, 0x00, 0, "00" * 512),
)


def frames():
    for name, kind, sequence, uptime_ms, body in FRAMES:
        raw = bytes.fromhex(body)
        yield {
            "name": name,
            "source": WORKED,
            "type": kind,
            "sequence": sequence,
            "uptime_ms": uptime_ms,
            "body": body,
            "wire": wire(kind, sequence, uptime_ms, raw).hex(),
        }


def streams():
    read = (0x11, 7, 0, bytes.fromhex("00000200"))
    text = (0x12, 9, 0, b"\x04\x00\x04\x00xyxy")
    good, also, item, item_also = wire(*read), wire(*text), frame_item(*read), frame_item(*text)
    damaged = bytearray(good)
    damaged[3] ^= 0x01
    long = b"\0" + b"\x7e" * 600 + b"\0"
    short = b"\0" + cobs(b"seven__") + b"\0"
    table = (
        ("commands at once", "master", b"xyx", 0, "start stop start"),
        ("commands between frames", "master", good + b"y" + also + b"x", 0, f"{item} stop {item_also} start"),
        ("x and y inside a frame are data", "master", also, 0, item_also),
        ("first delimiter lost", "master", also[1:], 0, item_also),
        ("stray delimiter, then x, then a frame", "master", b"\0x" + good, 0, f"start {item}"),
        ("stray delimiter, then x, then silence", "master", b"\0x", 1, "start"),
        ("frame that never closed, then silence", "master", good[:6], 1, "bad:short"),
        ("frame without its last delimiter, then silence", "master", good[:-1], 1, ""),
        ("damaged frame, then a frame", "master", bytes(damaged) + good, 0, f"bad:crc {item}"),
        ("damaged frame shares its delimiter", "master", bytes(damaged) + good[1:], 0, f"bad:crc {item}"),
        ("damaged frame, then x in step only after silence", "master", bytes(damaged) + b"x", 1, "bad:crc start"),
        ("too long", "master", long + good, 0, f"bad:long {item}"),
        ("too short", "master", short + good, 0, f"bad:short {item}"),
        ("x without a frame is a bad one", "host", b"\0x\0" + good, 0, f"bad:cobs {item}"),
        ("tail of a frame, then frames", "host", good[5:] + good + also, 0, f"{item} {item_also}"),
        ("one delimiter between frames", "host", good + also[1:], 0, f"{item} {item_also}"),
        ("damaged, short, long, then a frame", "host", bytes(damaged) + short + long + good, 0,
         f"bad:crc bad:short bad:long {item}"),
        ("delimiters only", "host", b"\0\0\0", 0, ""),
        ("empty payload", "host", b"\0\x01\0", 0, "bad:short"),
    )  # fmt: skip
    for name, side, raw, idle, items in table:
        yield {"name": name, "source": WORKED, "side": side, "wire": raw.hex(), "idle": idle, "items": items}


MESSAGES = (
    {"kind": "data", "type": 1, "body": "5c070400fbffffff", "windows": "1884:fbffffff"},
    {"kind": "data", "type": 1, "body": "a60b02000727b801010008", "windows": "2982:0727 440:08"},
    {"kind": "reply", "type": 2, "body": "1209040400", "request_type": 18, "request_sequence": 9, "result": 4,
     "offset": 4, "data": ""},
    {"kind": "reply", "type": 2, "body": "11ff00ffff6400", "request_type": 17, "request_sequence": 255, "result": 0,
     "offset": 65535, "data": "6400"},
    {"kind": "event", "type": 3, "body": "030024001da4000010a40000", "code": 3, "argument": 0, "cell": 36,
     "value": 42013, "limit": 42000},
    {"kind": "event", "type": 3, "body": "0b00ffffffffffff00000000", "code": 11, "argument": 0, "cell": 65535,
     "value": -1, "limit": 0},
    {"kind": "ident", "type": 16, "body": ""},
    {"kind": "read", "type": 17, "body": "00804000", "offset": 32768, "length": 64},
    {"kind": "read", "type": 17, "body": "6807ff00", "offset": 1896, "length": 255},
    {"kind": "write", "type": 18, "body": "040002001ca2", "offset": 4, "data": "1ca2"},
    {"kind": "store", "type": 19, "body": ""},
    {"kind": "load", "type": 20, "body": ""},
    {"kind": "command", "type": 32, "body": "0707270000", "command": 7, "argument": 9991},
    {"kind": "command", "type": 32, "body": "05ffffffff", "command": 5, "argument": -1},
)  # fmt: skip

# name, offset, bytes of one element, default: from the tables of the 2021 master and the CAN defaults of SPEC.md
CONFIG = (
    ("ts", 0, 2, (100,)), ("v_cell_min", 2, 2, (25000,)), ("v_cell_max", 4, 2, (42000,)),
    ("v_cell_chrg", 6, 2, (41500,)), ("t_cell_min", 8, 1, (-15,)), ("t_cell_max", 9, 1, (45,)),
    ("i_offset", 10, 2, (20490,)), ("i_gain", 12, 2, (12120,)), ("i_disc_min", 14, 2, (-10000,)),
    ("i_disc_max", 16, 2, (20000,)), ("i_chrg_min", 18, 2, (0,)), ("i_chrg_max", 20, 2, (1200,)),
    ("c_avg", 22, 2, (2500,)), ("r_fs_avg", 24, 2, (210,)), ("r_fc_avg", 26, 2, (0,)), ("fc_avg", 28, 2, (10,)),
    ("fan_ramp_start", 30, 1, (20,)), ("fan_ramp_stop", 31, 1, (50,)), ("fan_ramp_min", 32, 1, (32,)),
    ("fan_ramp_max", 33, 1, (224,)), ("balance_threshold", 34, 2, (250,)), ("v_alpha", 36, 2, (500,)),
    ("can_brp", 38, 1, (7,)), ("can_tx_msg_en_startup", 39, 1, (2,)),
    ("can_tx_msg_id", 40, 4, (0x9806E5F4, 0x100, 0x101, 0, 0, 0, 0, 0)),
    ("can_tx_msg_timing", 72, 2, (1000, 100, 100, 0, 0, 0, 0, 0)),
    ("can_tx_msg_len", 88, 1, (8, 8, 8, 0, 0, 0, 0, 0)),
    ("can_tx_msg_data", 96, 2, (429, 428, 431, 430, 436, 65535, 65535, 65535,
                                2982, 2983, 2288, 2289, 1884, 1885, 1886, 1887,
                                2280, 2281, 2282, 2283, 2286, 2287, 2387, 420) + (65535,) * 40),
    ("can_rx_msg_en_startup", 224, 1, (1,)), ("telemetry_period", 226, 2, (100,)),
    ("can_rx_msg_id", 228, 4, (0x98FF50E5, 0, 0, 0, 0, 0, 0, 0)),
    ("can_rx_msg_timeout", 260, 2, (5000, 0, 0, 0, 0, 0, 0, 0)),
    ("can_rx_msg_len", 276, 1, (8, 0, 0, 0, 0, 0, 0, 0)),
    ("can_rx_msg_response", 284, 1, (0, 255, 255, 255, 255, 255, 255, 255)),
    ("can_rx_msg_data", 292, 2, (433, 432, 435, 434, 437, 65535, 65535, 65535) + (65535,) * 56),
)  # fmt: skip


def default_image():
    image = bytearray(420)
    for _, offset, size, values in CONFIG:
        for element, value in enumerate(values):
            at = offset + element * size
            image[at : at + size] = le(value, size)
    return bytes(image)


def config():
    image = default_image()
    yield {"name": "default image", "source": "the 2021 master's defaults, laid down by hand", "image": image.hex()}
    for name, offset, size, values in CONFIG:
        for element, value in enumerate(values[:4]):
            yield {
                "name": "default value",
                "source": "the 2021 master's defaults",
                "field": name,
                "element": element,
                "offset": offset + element * size,
                "raw": value,
            }
    refused = (
        ("ts", 0, "c900", "201 samples are more than the buffer takes"),
        ("ts", 0, "0000", "no sample has no mean"),
        ("telemetry_period", 226, "1300", "below 20 ms"),
        ("v_cell_max", 4, "c9af", "45001 is above 4.5 V"),
        ("t_cell_min", 8, "29", "41 degC is above 40 degC"),
        ("can_tx_msg_id", 44, "00080000", "0x800 needs 29 bits, bit 31 is not set"),
        ("can_tx_msg_data", 112, "a80b", "2984 is the first byte after the struct"),
        ("can_rx_msg_data", 292, "0400", "a received byte may not land in the configuration"),
        ("can_rx_msg_response", 284, "08", "there is no tx message 8"),
        ("v_cell_chrg", 6, "11a4", "42001 is above v_cell_max"),
    )
    for name, offset, data, why in refused:
        changed = bytearray(image)
        changed[offset : offset + len(data) // 2] = bytes.fromhex(data)
        yield {"name": "refused", "source": why, "field": name, "offset": offset, "data": data}


CAN = (
    ("charger command 98.0 V 16.0 A, charge", "the charger vendor's example", "tx",
     "429 428 431 430 436 65535 65535 65535", "428:d403a000 436:00", "03d400a000000000"),
    ("charger command 403.2 V, stop", "laid down by hand, big endian", "tx",
     "429 428 431 430 436 65535 65535 65535", "428:c00f0000 436:01", "0fc0000001000000"),
    ("soc 99.91 %, v_tot 398.50 V, i_fs -0.05 A", "laid down by hand, little endian", "tx",
     "2982 2983 2288 2289 1884 1885 1886 1887", "2982:0727 2288:aa9b 1884:fbffffff", "0727aa9bfbffffff"),
    ("charger status 403.2 V 16.0 A, battery flag", "laid down by hand, big endian", "rx",
     "433 432 435 434 437 65535 65535 65535", "432:c00fa000 437:08", "0fc000a008000000"),
)  # fmt: skip


def can_messages():
    for name, source, direction, offsets, struct, data in CAN:
        yield {"name": name, "source": source, "direction": direction, "offsets": offsets, "struct": struct,
               "data": data}  # fmt: skip


def pec15():
    published = "worked example of the LTC6804 data sheet"
    own = "table and bit-serial forms agree"
    table = (
        ("WRCFG", published, "0001", 0x3D6E), ("RDCFG", own, "0002", 0x2B0A), ("RDCVA", own, "0004", 0x07C2),
        ("RDCVB", own, "0006", 0x9A94), ("RDCVC", own, "0008", 0x5E52), ("RDCVD", own, "000a", 0xC304),
        ("RDAUXA", own, "000c", 0xEFCC), ("RDSTATB", own, "0012", 0x7024), ("CLRCELL", own, "0711", 0xC9C0),
        ("ADCV 7 kHz", own, "0360", 0xF46C), ("ADCV 7 kHz, discharge permitted", own, "0370", 0xAF42),
        ("ADAX 7 kHz", own, "0560", 0xD3A0), ("RDCVA at address 0", own, "8004", 0x77D6),
        ("RDCVA at address 1", own, "8804", 0x8428), ("RDCVD at address 7", own, "b80a", 0xF5BC),
        ("six zeros", own, "000000000000", 0xC212), ("six ones", own, "ffffffffffff", 0x664C),
        ("three cells at 3.7000 V", own, "889088908890", 0xE5B2),
    )  # fmt: skip
    for name, source, data, pec in table:
        yield {"name": name, "source": source, "data": data, "pec": pec}


def eeprom():
    image = default_image()
    for counter in (1, 0x01020304):
        header = b"VWCF" + le(420, 2) + le(2, 2) + le(counter, 4)
        slot = (header + le(crc32(header + image), 4)).ljust(64, b"\0") + image + bytes(28)
        yield {
            "name": f"default image, store {counter}",
            "source": "laid down by hand; CRC-32 bit by bit",
            "counter": counter,
            "image": image.hex(),
            "slot": slot.hex(),
        }


def checksums():
    data = b"123456789".hex()
    yield {
        "name": "crc16",
        "source": "check value of CRC-16/IBM-3740 in the CRC catalogue",
        "data": data,
        "crc": 0x29B1,
    }
    yield {"name": "crc32", "source": "check value of CRC-32/ISO-HDLC in the CRC catalogue", "data": data,
           "crc": 0xCBF43926}  # fmt: skip


FILES = {
    "checksums.json": ("Check values of both CRCs.", checksums),
    "frames.json": ("Frames and what stands on the line for them, delimiters included.", frames),
    "streams.json": ("Bytes on the line and what each side's decoder makes of them.", streams),
    "messages.json": ("Bodies of messages and their fields.", lambda: ({"name": m["kind"], "source": "SPEC.md, laid "
                      "down by hand", **m} for m in MESSAGES)),
    "config_image.json": ("The default configuration, its values, and what a master refuses.", config),
    "can_messages.json": ("CAN data bytes and the bytes of the struct they stand for.", can_messages),
    "pec15.json": ("LTC6804 packet error codes.", pec15),
    "eeprom_slots.json": ("Configuration slots in the EEPROM.", eeprom),
}  # fmt: skip


def file_text(name):
    about, make = FILES[name]
    rows = ",\n".join("  " + json.dumps(vector) for vector in make())
    return f'{{\n "about": {json.dumps(about)},\n "vectors": [\n{rows}\n ]\n}}\n'


if __name__ == "__main__":
    for file_name in FILES:
        (HERE / file_name).write_text(file_text(file_name), encoding="utf-8", newline="\n")
