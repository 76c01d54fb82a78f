"""The shared vectors, which the C and TypeScript tests read as well."""

import json
from pathlib import Path

import pytest

from firmware_protocol import can_tables, config_image, dbc, eeprom, framing, ltc6804, messages
from firmware_protocol.framing import BadFrame, Frame, FrameDecoder
from firmware_protocol.memory_map import (
    CAN_ID_EXTENDED,
    CONFIG,
    FIELDS,
    MASTER_SIZE,
    N_CAN_MESSAGES,
    all_fields,
    element_name,
    locate,
)
from firmware_protocol.messages import (
    NO_OFFSET,
    Command,
    Data,
    EventMessage,
    Ident,
    IdentRequest,
    Load,
    Read,
    Reply,
    Store,
    Window,
    Write,
)
from tests.host_requests import decode_request
from tests.vectors import make_frames, make_vectors

FOLDER = Path(__file__).parents[2] / "vectors"
DEFAULT = config_image.default_image()


def vectors(name):
    return [
        pytest.param(vector, id=f"{i} {vector['name']}")
        for i, vector in enumerate(json.loads((FOLDER / name).read_text(encoding="utf-8"))["vectors"])
    ]


MAKERS = {name: maker for maker in (make_vectors, make_frames) for name in maker.FILES}


@pytest.mark.parametrize("name", sorted(MAKERS))
def test_file_is_current(name):
    assert (FOLDER / name).read_text(encoding="utf-8") == MAKERS[name].file_text(name)


@pytest.mark.parametrize("name", sorted(MAKERS))
def test_every_vector_names_its_source(name):
    for vector in MAKERS[name].FILES[name][1]():
        assert vector["source"]
        assert all(isinstance(value, str | int) for value in vector.values())


@pytest.mark.parametrize("vector", vectors("checksums.json"))
def test_checksums(vector):
    data = bytes.fromhex(vector["data"])
    reference = {"crc16": (framing.crc16, make_vectors.crc16), "crc32": (eeprom.crc32, make_vectors.crc32)}[
        vector["name"]
    ]
    assert [function(data) for function in reference] == [vector["crc"]] * 2


@pytest.mark.parametrize("vector", vectors("frames.json"))
def test_frames(vector):
    body, wire = bytes.fromhex(vector["body"]), bytes.fromhex(vector["wire"])
    assert framing.encode_frame(vector["type"], vector["sequence"], vector["uptime_ms"], body) == wire
    assert FrameDecoder().feed(wire) == [Frame(vector["type"], vector["sequence"], vector["uptime_ms"], body)]


def item_text(item):
    match item:
        case Frame():
            return f"frame:{item.type:02x}:{item.sequence:02x}:{item.uptime_ms:08x}:{item.body.hex() or '-'}"
        case BadFrame():
            return f"bad:{item.reason}"


@pytest.mark.parametrize("vector", [v for v in vectors("streams.json") if v.values[0]["side"] == "host"])
def test_streams_to_the_host(vector):
    items = FrameDecoder().feed(bytes.fromhex(vector["wire"]))
    assert " ".join(map(item_text, items)) == vector["items"]


def windows(text):
    pairs = [window.split(":") for window in text.split()]
    return tuple(Window(int(offset), bytes.fromhex(data)) for offset, data in pairs)


def expected_message(vector):
    match vector["kind"]:
        case "data":
            return Data(windows(vector["windows"]))
        case "reply" | "ident reply" if "result" not in vector:
            return Reply(vector["request_type"], vector["request_sequence"], 0, data=bytes.fromhex(vector["data"]))
        case "reply":
            data = bytes.fromhex(vector["data"])
            request = vector["request_type"], vector["request_sequence"]
            return Reply(*request, vector["result"], vector["offset"], data)
        case "event":
            return EventMessage(*(vector[name] for name in ("code", "argument", "cell", "value", "limit")))
        case "read":
            return Read(vector["offset"], vector["length"])
        case "write":
            return Write(vector["offset"], bytes.fromhex(vector["data"]))
        case "command":
            return Command(vector["command"], vector["argument"])
        case kind:
            return {"ident": IdentRequest(), "store": Store(), "load": Load()}[kind]


@pytest.mark.parametrize("vector", vectors("messages.json"))
def test_messages(vector):
    message, body = expected_message(vector), bytes.fromhex(vector["body"])
    frame = Frame(vector["type"], 0, 0, body)
    if isinstance(message, Data | Reply | EventMessage):
        assert message.to_body() == body
        assert messages.decode_message(frame) == message
    else:
        assert messages.encode_request(message) == (vector["type"], body)
        assert decode_request(frame) == message


@pytest.mark.parametrize("vector", vectors("config_image.json"))
def test_config_image(vector):
    if "image" in vector:
        assert bytes.fromhex(vector["image"]) == DEFAULT
    elif "data" in vector:
        data = bytes.fromhex(vector["data"])
        changed = DEFAULT[: vector["offset"]] + data + DEFAULT[vector["offset"] + len(data) :]
        [error] = config_image.check(changed)
        assert (error.field, error.offset) == (vector["field"], vector["offset"])
    else:
        field = CONFIG[vector["field"]]
        assert field.unpack(DEFAULT)[vector["element"]] == vector["raw"]
        assert field.offset + vector["element"] * field.item_size == vector["offset"]


@pytest.mark.parametrize("vector", vectors("can_messages.json"))
def test_can_messages(vector):
    offsets = tuple(map(int, vector["offsets"].split()))
    data = bytes.fromhex(vector["data"])
    expected = bytearray(MASTER_SIZE)
    for window in vector["struct"].split():
        offset, _, content = window.partition(":")
        expected[int(offset) : int(offset) + len(content) // 2] = bytes.fromhex(content)
    if vector["direction"] == "tx":
        tx = can_tables.TxMessage(0, True, 1, False, 100, len(data), offsets)
        assert can_tables.message_bytes(tx, expected) == data
    else:
        rx = can_tables.RxMessage(0, True, 1, False, 0, len(data), offsets, None)
        found = can_tables.TableReader(can_tables.with_rx_messages(DEFAULT, [rx])).windows(1, data)
        assert written([(window.offset, window.data) for window in found])[0] == expected


def test_default_tables_are_those_of_the_vectors():
    rows = [" ".join(map(str, m.data_offsets)) for m in can_tables.tx_messages(DEFAULT)]
    rows += [" ".join(map(str, m.data_offsets)) for m in can_tables.rx_messages(DEFAULT)]
    assert len(rows) == 2 * N_CAN_MESSAGES
    assert {vector.values[0]["offsets"] for vector in vectors("can_messages.json")} <= set(rows)


@pytest.mark.parametrize("vector", vectors("pec15.json"))
def test_pec15(vector):
    assert ltc6804.pec15(bytes.fromhex(vector["data"])) == vector["pec"]


@pytest.mark.parametrize("vector", vectors("eeprom_slots.json"))
def test_eeprom_slots(vector):
    image, slot = bytes.fromhex(vector["image"]), bytes.fromhex(vector["slot"])
    assert eeprom.encode_slot(image, vector["counter"]) == slot
    assert eeprom.decode_slot(slot, 0) == eeprom.StoredConfig(image, vector["counter"], 0)


def written(windows):
    """The master's struct after the windows, and which of its bytes they told."""
    image, told = bytearray(MASTER_SIZE), set()
    for offset, data in windows:
        image[offset : offset + len(data)] = data
        told.update(range(offset, offset + len(data)))
    return image, told


def elements(windows):
    """{name: value in its unit} of every element of which a byte was told."""
    image, told = written(windows)
    places = [place for offset in sorted(told) if (place := locate(offset)) is not None]
    return {
        element_name(field, element): float(f"{field.unpack(image)[element] * field.scale:.10g}")
        for field, element, byte in places
        if byte == 0
    }


def meaning(vector):
    return {name: float(value) for name, _, value in (part.partition("=") for part in vector["meaning"].split())}


@pytest.mark.parametrize("vector", vectors("whole_frames.json"))
def test_whole_frames(vector):
    wire = bytes.fromhex(vector["wire"])
    [frame] = FrameDecoder().feed(wire)
    assert (frame.type, frame.sequence, frame.uptime_ms) == (vector["type"], vector["sequence"], vector["uptime_ms"])
    message = expected_message(vector)
    if isinstance(message, Data | Reply | EventMessage):
        assert messages.decode_message(frame) == message
        body = message.to_body()
    else:
        assert decode_request(frame) == message
        _, body = messages.encode_request(message)
    assert framing.encode_frame(frame.type, frame.sequence, frame.uptime_ms, body) == wire
    if vector["kind"] == "data":
        assert elements(message.windows) == meaning(vector)
    if vector["kind"] == "ident reply":
        firmware = tuple(map(int, vector["firmware"].split(".")))
        map_hash = bytes.fromhex(vector["map_hash"])
        ident = Ident(firmware, map_hash, vector["protocol"], vector["reset_cause"], vector["boots"])
        assert Ident.from_bytes(message.data) == ident
        assert ident.to_bytes() == message.data


def test_every_field_of_the_struct_has_its_own_vector():
    """The rows of the memory map against those of the documents, which the vectors were made of."""
    documented = {name: (offset, kind, count, scale) for name, offset, kind, count, scale in make_frames.STRUCT}
    fields = [
        field for field in all_fields() if not field.name.startswith(("conf.", *(f"slave[{i}]" for i in range(7))))
    ]
    assert {f.name: (f.offset, f.fmt, f.count, pytest.approx(f.scale)) for f in fields} == documented


def test_the_other_slaves_stand_before_the_last_one():
    for slave in range(7):
        for name, offset, *_ in make_frames.STRUCT:
            if name.startswith("slave[7]"):
                assert FIELDS[name.replace("[7]", f"[{slave}]")].offset == offset - 180 * (7 - slave)


@pytest.mark.parametrize("vector", vectors("can_frames.json"))
def test_can_frames(vector):
    can_id = vector["id"] | (CAN_ID_EXTENDED if vector["is_extended"] else 0)
    data = bytes.fromhex(vector["data"])
    assert can_tables.TableReader(DEFAULT).windows(can_id, data) == windows(vector["struct"])
    tables = {"tx": can_tables.tx_messages, "rx": can_tables.rx_messages}
    message = tables[vector["direction"]](DEFAULT)[vector["index"]]
    if vector["direction"] == "tx":
        assert can_tables.message_bytes(message, written(windows(vector["struct"]))[0]) == data
    decoded = {signal.name: dbc.decode(signal, data) for signal in dbc.signals(message)}
    assert {name: value[0] for name, value in decoded.items() if value is not None} == meaning(vector)


@pytest.mark.parametrize("vector", vectors("config_limits.json"))
def test_config_limits(vector):
    data, offset = bytes.fromhex(vector["data"]), vector["offset"]
    errors = config_image.check(DEFAULT[:offset] + data + DEFAULT[offset + len(data) :])
    assert (errors[0].offset if errors else NO_OFFSET) == vector["refused"]


@pytest.mark.parametrize("vector", vectors("eeprom_images.json"))
def test_eeprom_images(vector):
    memory = bytes.fromhex(vector["slot_0"] + vector["slot_1"])
    newest = eeprom.newest(memory)
    assert (-1 if newest is None else newest.slot) == vector["newest"]
    if newest is not None:
        assert newest.counter == vector["counter"]
        assert newest.image.hex() == vector["image"]
