"""Writes the vectors of whole frames and images with their meaning: `python -m tests.vectors.make_frames`.

As in `make_vectors`, nothing here uses the code under test. Offsets, types and scales are those of the 2021 master's
documentation, written down a second time; bytes are laid down one by one. What the rows say is judged by three readers
that were written apart: Python, the C reference and, for the struct, TypeScript.

Vectors are flat. `windows` are `OFFSET:HEX`, `counts` are `OFFSET:BYTES:COUNT`, `meaning` is `NAME=VALUE` in the
field's unit, each separated by blanks.
"""

import json

from tests.vectors.make_vectors import CONFIG, HERE, crc32, default_image, le, wire

SPEC = "SPEC.md, laid down by hand; CRC bit by bit, COBS by its definition"
DOCUMENTS = "the 2021 master's debugger view and SPEC.md section 6, laid down by hand"
NO_OFFSET = 65535

# name, offset, type (lower case: signed), elements, unit of one count
STRUCT = (
    ("status.flags", 420, "I", 1, 1), ("status.can_tx_msg_en", 424, "B", 1, 1),
    ("status.can_rx_msg_en", 425, "B", 1, 1), ("status.can_rx_msg_active", 426, "B", 1, 1),
    ("status.charger_status", 427, "B", 1, 1), ("charger.v_set", 428, "H", 1, 0.1),
    ("charger.i_set", 430, "H", 1, 0.1), ("charger.v_out", 432, "H", 1, 0.1), ("charger.i_out", 434, "H", 1, 0.1),
    ("charger.control", 436, "B", 1, 1), ("charger.flags", 437, "B", 1, 1), ("charger.state", 438, "B", 1, 1),
    ("charger.fan_duty", 439, "B", 1, 1 / 255), ("n_slaves", 440, "B", 1, 1), ("slave[7].status", 1704, "B", 1, 1),
    ("slave[7].time", 1708, "I", 18, 1), ("slave[7].cfgr", 1780, "B", 6, 1), ("slave[7].cvr", 1786, "H", 12, 0.0001),
    ("slave[7].avr", 1810, "H", 3, 0.0001), ("slave[7].str", 1816, "H", 6, 1), ("slave[7].com", 1828, "H", 3, 1),
    ("slave[7].temp", 1834, "H", 24, 0.0001), ("i_fs", 1884, "i", 1, 0.01), ("i_fc", 1888, "i", 1, 0.01),
    ("i_fc_hp", 1892, "i", 1, 0.01), ("v", 1896, "H", 96, 0.0001), ("ocv", 2088, "H", 96, 0.0001),
    ("v_min", 2280, "H", 1, 0.0001), ("v_max", 2282, "H", 1, 0.0001), ("v_avg", 2284, "H", 1, 0.0001),
    ("v_min_id", 2286, "B", 1, 1), ("v_max_id", 2287, "B", 1, 1), ("v_tot", 2288, "H", 1, 0.01),
    ("t", 2290, "b", 96, 1), ("t_min", 2386, "b", 1, 1), ("t_max", 2387, "b", 1, 1), ("t_avg", 2388, "b", 1, 1),
    ("t_min_id", 2389, "B", 1, 1), ("t_max_id", 2390, "B", 1, 1), ("dod", 2392, "I", 1, 1e-06),
    ("c", 2396, "H", 96, 0.01), ("c_min", 2588, "H", 1, 0.01), ("c_max", 2590, "H", 1, 0.01),
    ("c_avg", 2592, "H", 1, 0.01), ("c_min_id", 2594, "H", 1, 1), ("c_max_id", 2596, "H", 1, 1),
    ("r_fs", 2598, "H", 96, 1e-05), ("r_fc", 2790, "H", 96, 1e-05), ("soc", 2982, "H", 1, 0.0001),
)  # fmt: skip
SIZES = {"B": 1, "H": 2, "I": 4}

# name, offset, bytes, signed, lowest, highest count: the configuration's ranges in SPEC.md section 6
RANGES = (
    ("ts", 0, 2, False, 1, 200), ("v_cell_min", 2, 2, False, 15000, 40000),
    ("v_cell_max", 4, 2, False, 30000, 45000), ("v_cell_chrg", 6, 2, False, 30000, 45000),
    ("t_cell_min", 8, 1, True, -40, 40), ("t_cell_max", 9, 1, True, 0, 100), ("i_offset", 10, 2, False, 0, 40950),
    ("i_gain", 12, 2, False, 1, 65535), ("i_disc_min", 14, 2, True, -32767, 0), ("i_disc_max", 16, 2, True, 0, 32767),
    ("i_chrg_min", 18, 2, True, -32767, 32767), ("i_chrg_max", 20, 2, True, 0, 32767),
    ("c_avg", 22, 2, True, 10, 32767), ("r_fs_avg", 24, 2, True, 0, 32767), ("r_fc_avg", 26, 2, True, 0, 32767),
    ("fc_avg", 28, 2, True, 0, 1000), ("fan_ramp_start", 30, 1, True, -40, 100),
    ("fan_ramp_stop", 31, 1, True, -40, 100), ("fan_ramp_min", 32, 1, False, 0, 255),
    ("fan_ramp_max", 33, 1, False, 0, 255), ("balance_threshold", 34, 2, False, 10, 5000),
    ("v_alpha", 36, 2, False, 1, 1000), ("can_brp", 38, 1, False, 3, 255),
    ("can_tx_msg_timing", 86, 2, False, 0, 60000), ("can_tx_msg_len", 95, 1, False, 0, 8),
    ("can_tx_msg_data", 222, 2, False, 0, 65535), ("telemetry_period", 226, 2, False, 20, 10000),
    ("can_rx_msg_timeout", 274, 2, False, 0, 60000),
    ("can_rx_msg_len", 283, 1, False, 0, 8), ("can_rx_msg_response", 291, 1, False, 0, 255),
)  # fmt: skip

COMMANDS = (  # name, id, lowest and highest argument of SPEC.md section 5
    ("charge start", 1, 0, 0), ("charge stop", 2, 0, 0), ("balance start", 3, 0, 0), ("balance stop", 4, 0, 0),
    ("fan override", 5, -1, 921855), ("clear faults", 6, 0, 0), ("set soc", 7, 0, 10000), ("can tx enable", 8, 0, 255),
    ("can send", 9, 0, 7), ("reset", 10, 0, 0), ("balance cells", 11, 0, 32767), ("soc from ocv", 12, 0, 0),
    ("unknown", 200, -2147483648, 2147483647),
)  # fmt: skip
RESULTS = ("done", "unknown request", "bad length", "out of bounds", "out of range", "not now", "eeprom failed",
           "nothing stored")  # fmt: skip
EVENTS = ("boot", "trip v_min", "trip v_max", "trip t_min", "trip t_max", "trip i_disc", "trip i_chrg",
          "trip slave lost", "trip sensor lost", "faults cleared", "charger state", "config written", "config stored",
          "can rx timeout", "eeprom invalid", "soc set")  # fmt: skip


def size_of(kind):
    return SIZES[kind.upper()]


def counts_of(kind, offset, element):
    """A count that no neighbour has; the signed ones are negative."""
    count = (offset * 37 + element * 101 + 0x9A5) % (1 << 8 * size_of(kind) - 1)
    return -1 - count if kind.islower() else count


def unit_text(count, scale):
    return f"{count * scale:.10g}"


def frame(name, kind, number, body, sequence, uptime_ms, **meaning):
    return {"name": name, "source": SPEC, "wire": wire(number, sequence, uptime_ms, body).hex(), "type": number,
            "sequence": sequence, "uptime_ms": uptime_ms, "kind": kind, **meaning}  # fmt: skip


def requests():
    yield frame("who are you", "ident", 16, b"", 0, 0)
    yield frame("store", "store", 19, b"", 254, 0)
    yield frame("load", "load", 20, b"", 255, 0)
    for n, (offset, length) in enumerate(((0, 420), (420, 20), (2982, 2), (0, 507), (65535, 1), (32768, 507),
                                          (33280, 64), (33792, 16))):  # fmt: skip
        body = le(offset, 2) + le(length, 2)
        yield frame(f"read {offset}+{length}", "read", 17, body, n, 0, offset=offset, length=length)
    for n, (name, offset, size, values) in enumerate(CONFIG):
        data = b"".join(le(value, size) for value in values)
        body = le(offset, 2) + le(len(data), 2) + data
        yield frame(f"write the default of {name}", "write", 18, body, n, 0, offset=offset, data=data.hex())
    image = default_image()
    yield frame("write the whole configuration", "write", 18, le(0, 2) + le(420, 2) + image, 120, 0, offset=0,
                data=image.hex())  # fmt: skip
    for n, (name, number, *arguments) in enumerate(COMMANDS):
        for argument in sorted(set(arguments)):
            yield frame(f"command {name}, {argument}", "command", 32, bytes([number]) + le(argument, 4), 60 + n, 0,
                        command=number, argument=argument)  # fmt: skip


def replies():
    for result, name in enumerate(RESULTS):
        for n, request in enumerate((18, 20, 32)):
            offset = 4 + 16 * n if result in (3, 4) else NO_OFFSET
            body = bytes([request, 200 + n, result]) + le(offset, 2)
            yield frame(f"reply to {request}: {name}", "reply", 2, body, n, 1000 * result, request_type=request,
                        request_sequence=200 + n, result=result, offset=offset, data="")  # fmt: skip
    for n, data in enumerate((default_image(), b"\0", b"\xff" * 507, b"xy\0yx")):
        body = bytes([17, n, 0]) + le(NO_OFFSET, 2) + data
        yield frame(f"reply to a read of {len(data)}", "reply", 2, body, 9, 86_400_000, request_type=17,
                    request_sequence=n, result=0, offset=NO_OFFSET, data=data.hex())  # fmt: skip
    for n, (protocol, firmware, cause, boots) in enumerate(((1, "1.0.0", 0, 1), (1, "255.128.7", 3, 4294967295),
                                                            (2, "0.0.1", 1, 65536))):  # fmt: skip
        version = bytes(map(int, firmware.split(".")))
        data = le(protocol, 2) + version + bytes(range(n, n + 8)) + bytes([cause]) + le(boots, 4)
        body = bytes([16, n, 0]) + le(NO_OFFSET, 2) + data
        yield frame(f"reply to ident: {firmware}", "ident reply", 2, body, 1, 12345, request_type=16,
                    request_sequence=n, protocol=protocol, firmware=firmware, map_hash=data[5:13].hex(),
                    reset_cause=cause, boots=boots, data=data.hex())  # fmt: skip


def events():
    for code, name in enumerate(EVENTS, 1):
        cell = (12 * code) % 96 if 2 <= code <= 9 else NO_OFFSET
        argument, value, limit = 3 * code, 42013 - 5000 * code, (-1) ** code * 1000 * code
        body = bytes([code, argument]) + le(cell, 2) + le(value, 4) + le(limit, 4)
        yield frame(f"event {name}", "event", 3, body, 10 * code, 100_000 * code, code=code, argument=argument,
                    cell=cell, value=value, limit=limit)  # fmt: skip
    ends = bytes([255, 255]) + le(NO_OFFSET, 2) + le(-(1 << 31), 4) + le((1 << 31) - 1, 4)
    yield frame("event that nobody knows yet, numbers at their ends", "event", 3, ends, 255, 4294967295, code=255,
                argument=255, cell=NO_OFFSET, value=-(1 << 31), limit=(1 << 31) - 1)  # fmt: skip


def data_frame(name, sequence, values):
    """A DATA frame of (field, offset, type, element, scale, count); what stands side by side is one window."""
    windows, counts, meaning = [], [], []
    for field, offset, kind, element, scale, count in values:
        raw = le(count, size_of(kind))
        if windows and windows[-1][0] + len(windows[-1][1]) == offset:
            windows[-1][1] += raw
        else:
            windows.append([offset, raw])
        counts.append(f"{offset}:{size_of(kind)}:{count}")
        meaning.append(f"{field if element is None else f'{field}[{element}]'}={unit_text(count, scale)}")
    body = b"".join(le(offset, 2) + le(len(raw), 2) + raw for offset, raw in windows)
    return frame(name, "data", 1, body, sequence, 50 * sequence,
                 windows=" ".join(f"{offset}:{raw.hex()}" for offset, raw in windows), counts=" ".join(counts),
                 meaning=" ".join(meaning)) | {"source": DOCUMENTS}  # fmt: skip


def element_values(field, offset, kind, n, scale, elements):
    for element in elements:
        at = offset + element * size_of(kind)
        yield field, at, kind, None if n == 1 else element, scale, counts_of(kind, at, element)


def data():
    for n, (field, offset, kind, count, scale) in enumerate(STRUCT):
        elements = sorted({0, count // 2, count - 1})
        yield data_frame(f"data: {field}", n, element_values(field, offset, kind, count, scale, elements))
    rows = {row[0]: row for row in STRUCT}
    for field in ("v", "ocv", "t", "c", "r_fs", "r_fc"):
        _, offset, kind, count, scale = rows[field]
        yield data_frame(f"data: all of {field}", 100, element_values(field, offset, kind, count, scale, range(count)))
    for field, low, high in (("i_fs", -(1 << 31), (1 << 31) - 1), ("t_min", -128, 127), ("soc", 0, 65535),
                             ("dod", 0, (1 << 32) - 1)):  # fmt: skip
        _, offset, kind, _, scale = rows[field]
        for count in (low, high):
            yield data_frame(f"data: {field} at its end", 200, [(field, offset, kind, None, scale, count)])
    yield data_frame("data without a window", 0, [])


def frames():
    yield from requests()
    yield from replies()
    yield from events()
    yield from data()


# index in the default tables, id, 29 bits, data, windows of the struct, meaning
CAN_FRAMES = (
    ("charger command, the vendor's example", "tx", 0, 0x1806E5F4, 1, "03d400a000000000", "428:d403a000 436:00",
     "charger_v_set=98 charger_i_set=16 charger_control=0"),
    ("charger command: stop", "tx", 0, 0x1806E5F4, 1, "0fc0000001000000", "428:c00f0000 436:01",
     "charger_v_set=403.2 charger_i_set=0 charger_control=1"),
    ("summary for the ECU, regenerating", "tx", 1, 0x100, 0, "0727aa9bfbffffff", "1884:fbffffff 2288:aa9b 2982:0727",
     "soc=0.9991 v_tot=398.5 i_fs=-0.05"),
    ("summary for the ECU, strongest current", "tx", 1, 0x100, 0, "00000000ffffff7f",
     "1884:ffffff7f 2288:0000 2982:0000", "soc=0 v_tot=0 i_fs=21474836.47"),
    ("cell extremes, cold", "tx", 2, 0x101, 0, "929e5a9f065ff841", "420:41 2280:929e5a9f 2286:065f 2387:f8",
     "v_min=4.0594 v_max=4.0794 v_min_id=6 v_max_id=95 t_max=-8 status_fit=1 status_usb=0 status_i2c1=0 "
     "status_usart1=0 status_can1=0 status_charger=0 status_charging=1 status_balancing=0"),
    ("charger status, battery missing", "rx", 0, 0x18FF50E5, 1, "0fc000a008000000", "432:c00fa000 437:08",
     "charger_v_out=403.2 charger_i_out=16 charger_hardware=0 charger_over_temperature=0 charger_input_voltage=0 "
     "charger_battery=1 charger_timeout=0"),
    ("charger status, all flags", "rx", 0, 0x18FF50E5, 1, "ffffffff1f000000", "432:ffffffff 437:1f",
     "charger_v_out=6553.5 charger_i_out=6553.5 charger_hardware=1 charger_over_temperature=1 "
     "charger_input_voltage=1 charger_battery=1 charger_timeout=1"),
    ("charger status that is cut", "rx", 0, 0x18FF50E5, 1, "0fc0", "432:c00f", "charger_v_out=403.2"),
)  # fmt: skip


def can_frames():
    for name, direction, index, can_id, is_extended, content, struct, meaning in CAN_FRAMES:
        yield {"name": name, "source": "the charger vendor's note and SPEC.md section 7, laid down by hand",
               "direction": direction, "index": index, "id": can_id, "is_extended": is_extended, "data": content,
               "struct": struct, "meaning": meaning}  # fmt: skip


def config_limits():
    """Configurations one count inside and outside each limit; `refused` is the offset at fault."""

    def row(name, offset, content, refused, **meaning):
        return {"name": name, "source": "SPEC.md section 6", "offset": offset, "data": content.hex(),
                "refused": refused, **meaning}  # fmt: skip

    ordered = {"v_cell_min", "v_cell_max", "v_cell_chrg", "t_cell_min", "t_cell_max", "i_disc_min", "i_disc_max",
               "i_chrg_min", "i_chrg_max", "fan_ramp_start", "fan_ramp_stop", "fan_ramp_min",
               "fan_ramp_max"}  # fmt: skip
    for field, offset, size, is_signed, low, high in RANGES:
        bits = 8 * size
        first, last = (-(1 << bits - 1), (1 << bits - 1) - 1) if is_signed else (0, (1 << bits) - 1)
        for count in (low, high):
            if field not in ordered and not field.endswith(("_data", "_response")):
                yield row(f"{field} = {count}, allowed", offset, le(count, size), NO_OFFSET)
        for count in (low - 1, high + 1):
            if first <= count <= last and field not in ordered:
                yield row(f"{field} = {count}, refused", offset, le(count, size), offset)
    for field, offset, content, refused in (
        ("v_cell_min", 2, "9739", 2), ("v_cell_min", 2, "983a", NO_OFFSET), ("v_cell_max", 4, "c8af", NO_OFFSET),
        ("v_cell_max", 4, "c9af", 4), ("v_cell_chrg", 6, "10a4", NO_OFFSET), ("v_cell_chrg", 6, "11a4", 6),
        ("v_cell_chrg", 6, "3075", NO_OFFSET), ("v_cell_chrg", 6, "2f75", 6), ("t_cell_min", 8, "d8", NO_OFFSET),
        ("t_cell_min", 8, "d7", 8), ("t_cell_min", 8, "28", NO_OFFSET), ("t_cell_min", 8, "29", 8),
        ("t_cell_max", 9, "64", NO_OFFSET), ("t_cell_max", 9, "65", 9), ("t_cell_max", 9, "f1", 8),
        ("i_disc_min", 14, "0180", NO_OFFSET), ("i_disc_min", 14, "0080", 14), ("i_disc_min", 14, "0000", NO_OFFSET),
        ("i_disc_min", 14, "0100", 14), ("i_disc_max", 16, "ff7f", NO_OFFSET), ("i_disc_max", 16, "ffff", 16),
        ("i_chrg_min", 18, "b004", NO_OFFSET), ("i_chrg_min", 18, "b104", 18), ("i_chrg_max", 20, "ffff", 18),
        ("fan_ramp_start", 30, "31", NO_OFFSET), ("fan_ramp_start", 30, "32", 30), ("fan_ramp_stop", 31, "14", 30),
        ("fan_ramp_stop", 31, "64", NO_OFFSET), ("fan_ramp_stop", 31, "65", 31), ("fan_ramp_min", 32, "e0", NO_OFFSET),
        ("fan_ramp_min", 32, "e1", 32), ("fan_ramp_max", 33, "1f", 32),
        ("can_tx_msg_id", 44, "ff070000", NO_OFFSET), ("can_tx_msg_id", 44, "00080000", 44),
        ("can_tx_msg_id", 68, "ffffff9f", NO_OFFSET), ("can_tx_msg_id", 68, "000000a0", 68),
        ("can_tx_msg_data", 222, "a70b", NO_OFFSET), ("can_tx_msg_data", 222, "a80b", 222),
        ("can_tx_msg_data", 222, "feff", 222), ("can_tx_msg_data", 222, "ffff", NO_OFFSET),
        ("can_rx_msg_id", 256, "ffffff9f", NO_OFFSET), ("can_rx_msg_id", 256, "000000a0", 256),
        ("can_rx_msg_data", 418, "a301", 418), ("can_rx_msg_data", 418, "a401", NO_OFFSET),
        ("can_rx_msg_data", 418, "a70b", NO_OFFSET), ("can_rx_msg_data", 418, "a80b", 418),
        ("can_rx_msg_response", 291, "07", NO_OFFSET), ("can_rx_msg_response", 291, "08", 291),
        ("can_rx_msg_response", 291, "fe", 291), ("padding", 225, "aa", NO_OFFSET),
    ):  # fmt: skip
        yield row(f"{field} with {content} at {offset}", offset, bytes.fromhex(content), refused)


def slot(counter, *, image=None, magic=b"VWCF", length=420, layout=2, damage=None):
    image = default_image() if image is None else image
    header = magic + le(length, 2) + le(layout, 2) + le(counter, 4)
    raw = bytearray((header + le(crc32(header + image), 4)).ljust(64, b"\0") + image + bytes(28))
    if damage is not None:
        raw[damage] ^= 1
    return bytes(raw)


def first_image(ts_ms):
    """The default configuration in layout 1: the telemetry period in front, nothing before the rx ids."""
    return le(ts_ms, 2) + default_image()[2:226] + bytes(2) + default_image()[228:]


def meant(raw):
    """What the image of a slot says in the present layout."""
    image = raw[64:484]
    return image if raw[6] == 2 else default_image()[:2] + image[2:226] + image[:2] + image[228:]


def eeprom_images():
    blank = b"\xff" * 512
    other = b"\x32\x00" + default_image()[2:]
    at_100, at_250, at_10000 = (first_image(ts_ms) for ts_ms in (100, 250, 10000))
    table = (
        ("never written", blank, blank, -1, 0), ("zeros", bytes(512), bytes(512), -1, 0),
        ("first store", slot(1), blank, 0, 1), ("second store", slot(1), slot(2, image=other), 1, 2),
        ("third store", slot(3, image=other), slot(2), 0, 3),
        ("highest counter", slot(7), slot(4294967295), 1, 4294967295),
        ("header of the newer one wiped", slot(8), bytes(64) + slot(9)[64:], 0, 8),
        ("newer header cut after the counter", slot(8), slot(9)[:12] + bytes(4) + slot(9)[16:], 0, 8),
        ("newer header with a damaged bit", slot(8), slot(9, damage=15), 0, 8),
        ("newer image with a damaged bit", slot(8), slot(9, damage=64 + 419), 0, 8),
        ("padding after the image does not count", slot(8), slot(9, damage=64 + 420), 1, 9),
        ("another layout", slot(8), slot(9, layout=3), 0, 8), ("layout 0", slot(8), slot(9, layout=0), 0, 8),
        ("layout 1", slot(4, image=at_100, layout=1), blank, 0, 4),
        ("layout 1, of 250 ms", slot(4, image=at_100, layout=1), slot(5, image=at_250, layout=1), 1, 5),
        ("the first store after layout 1", slot(6), slot(5, image=at_250, layout=1), 0, 6),
        ("layout 1 is the newer one", slot(6), slot(7, image=at_10000, layout=1), 1, 7),
        ("the same counter in both", slot(8), slot(8, image=other), 0, 8),
        ("the same counter, slot 0 damaged", slot(8, damage=15), slot(8, image=other), 1, 8),
        ("another length", slot(8), slot(9, length=419), 0, 8),
        ("another magic", slot(8, magic=b"VWCX"), slot(7), 1, 7), ("counter 0", slot(0), blank, -1, 0),
        ("both damaged", slot(1, damage=0), slot(2, damage=64), -1, 0),
    )  # fmt: skip
    for name, first, second, newest, counter in table:
        yield {"name": name, "source": "SPEC.md section 9, laid down by hand; CRC-32 bit by bit",
               "slot_0": first.hex(), "slot_1": second.hex(), "newest": newest, "counter": counter,
               "image": "" if newest < 0 else meant((first, second)[newest]).hex()}  # fmt: skip


def journal():
    for counter, dod, soc in ((1, 0, 10000), (2, 123456, 9876), (496, 9000000, 1), (497, 1, 2), (993, 7, 7),
                              (4294967295, 4294967295, 65535)):  # fmt: skip
        entry = le(counter, 4) + le(dod, 4) + le(soc, 2) + le(2, 2) + bytes(4)
        yield {
            "name": f"entry {counter}",
            "source": "SPEC.md section 9, laid down by hand; CRC-32 bit by bit",
            "layout": 2,
            "counter": counter,
            "dod": dod,
            "soc": soc,
            "offset": 1024 + (counter - 1) % 496 * 64,
            "data": (entry + le(crc32(entry), 4)).hex(),
        }
    # 1 uAh is 3.6 mA s: 0.5 is rounded up
    for mas, dod in ((0, 0), (1, 0), (2, 1), (9, 3), (90_000_000, 25_000_000), (10_165_135, 2_823_649),
                     (4294967295, 1193046471)):  # fmt: skip
        entry = le(7, 4) + le(mas, 4) + le(9000, 2) + bytes(2)
        yield {"name": f"layout 1, {mas} mA s", "source": "SPEC.md section 9, laid down by hand; CRC-32 bit by bit",
               "layout": 1, "counter": 7, "dod": dod, "soc": 9000, "offset": 1024 + 6 * 64,
               "data": (entry + le(crc32(entry), 4)).hex()}  # fmt: skip


FILES = {
    "whole_frames.json": ("Frames on the line, delimiters included, and what they mean.", frames),
    "can_frames.json": ("CAN frames of the default tables and what they mean.", can_frames),
    "config_limits.json": ("The default configuration with some bytes replaced, and what is refused.", config_limits),
    "eeprom_images.json": ("Both configuration slots and which of them counts.", eeprom_images),
    "eeprom_journal.json": ("Entries of the charge's journal.", journal),
}


def file_text(name):
    about, make = FILES[name]
    rows = ",\n".join("  " + json.dumps(vector) for vector in make())
    return f'{{\n "about": {json.dumps(about)},\n "vectors": [\n{rows}\n ]\n}}\n'


if __name__ == "__main__":
    for file_name in FILES:
        (HERE / file_name).write_text(file_text(file_name), encoding="utf-8", newline="\n")
