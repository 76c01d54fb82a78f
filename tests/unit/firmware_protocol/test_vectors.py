"""The shared vectors, which the C and TypeScript tests read as well."""

import importlib.util
import json
from pathlib import Path

import pytest

from firmware_protocol import can_tables, config_image, eeprom, framing, ltc6804, messages
from firmware_protocol.framing import BadFrame, CommandDecoder, Frame, FrameDecoder, StreamCommand
from firmware_protocol.memory_map import CONFIG, MASTER_SIZE, N_CAN_MESSAGES
from firmware_protocol.messages import Command, Data, Event, IdentRequest, Load, Read, Reply, Store, Window, Write

FOLDER = Path(__file__).parents[2] / "vectors"
DEFAULT = config_image.default_image()


def vectors(name):
    return [
        pytest.param(vector, id=f"{i} {vector['name']}")
        for i, vector in enumerate(json.loads((FOLDER / name).read_text(encoding="utf-8"))["vectors"])
    ]


def maker():
    spec = importlib.util.spec_from_file_location("make_vectors", FOLDER / "make_vectors.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


MAKER = maker()


@pytest.mark.parametrize("name", sorted(path.name for path in FOLDER.glob("*.json")))
def test_file_is_current(name):
    assert (FOLDER / name).read_text(encoding="utf-8") == MAKER.file_text(name)


def test_no_file_is_missing():
    assert {path.name for path in FOLDER.glob("*.json")} == set(MAKER.FILES)


@pytest.mark.parametrize("name", sorted(MAKER.FILES))
def test_every_vector_names_its_source(name):
    for vector in MAKER.FILES[name][1]():
        assert vector["source"]
        assert all(isinstance(value, str | int) for value in vector.values())


@pytest.mark.parametrize("vector", vectors("checksums.json"))
def test_checksums(vector):
    data = bytes.fromhex(vector["data"])
    reference = {"crc16": (framing.crc16, MAKER.crc16), "crc32": (eeprom.crc32, MAKER.crc32)}[vector["name"]]
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
        case StreamCommand():
            return "start" if item.start else "stop"


@pytest.mark.parametrize("vector", vectors("streams.json"))
def test_streams(vector):
    decoder = FrameDecoder() if vector["side"] == "host" else CommandDecoder()
    items = decoder.feed(bytes.fromhex(vector["wire"]))
    if vector["idle"]:
        items += decoder.idle()
    assert " ".join(map(item_text, items)) == vector["items"]


def expected_message(vector):
    match vector["kind"]:
        case "data":
            pairs = [window.split(":") for window in vector["windows"].split()]
            return Data(tuple(Window(int(offset), bytes.fromhex(data)) for offset, data in pairs))
        case "reply":
            data = bytes.fromhex(vector["data"])
            request = vector["request_type"], vector["request_sequence"]
            return Reply(*request, vector["result"], vector["offset"], data)
        case "event":
            return Event(*(vector[name] for name in ("code", "argument", "cell", "value", "limit")))
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
    if isinstance(message, Data | Reply | Event):
        assert message.to_body() == body
        assert messages.decode_message(frame) == message
    else:
        assert messages.encode_request(message) == (vector["type"], body)
        assert messages.decode_request(frame) == message


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
        image = bytearray(MASTER_SIZE)
        can_tables.apply_received(can_tables.RxMessage(0, True, 1, False, 0, len(data), offsets, None), data, image)
        assert image == expected


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
