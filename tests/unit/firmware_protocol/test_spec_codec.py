"""A codec written from SPEC.md alone passes the vectors, and agrees with ours where no vector is."""

import ast
import json
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_protocol import config_image, framing, memory_map, spec_tables
from firmware_protocol.framing import BadFrame, FrameDecoder
from tests import spec_codec
from tests.vectors import make_meanings

FOLDER = Path(__file__).parents[2] / "vectors"
DEFAULT = spec_codec.default_image()


def vectors(name):
    return json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))["vectors"]


def changed(image, vector):
    data = bytes.fromhex(vector["data"])
    return image[: vector["offset"]] + data + image[vector["offset"] + len(data) :]


def struct_with(text):
    image = bytearray(DEFAULT + bytes(memory_map.MASTER_SIZE - len(DEFAULT)))
    for window in text.split():
        offset, _, data = window.partition(":")
        image[int(offset) : int(offset) + len(data) // 2] = bytes.fromhex(data)
    return image


def test_it_imports_nothing_of_ours():
    tree = ast.parse(Path(spec_codec.__file__).read_text(encoding="utf-8"))
    plain = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    modules = plain | {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert {name.partition(".")[0] for name in modules} <= sys.stdlib_module_names


def test_the_map_hash_comes_out_of_the_tables():
    assert spec_codec.map_hash() == memory_map.MAP_HASH


def test_the_default_configuration_comes_out_of_the_tables():
    [expected] = [vector["image"] for vector in vectors("config_image") if "image" in vector]
    assert DEFAULT.hex() == expected


def test_meanings_are_current_and_at_least_a_hundred():
    assert (FOLDER / "meanings.json").read_text(encoding="utf-8") == make_meanings.file_text()
    assert len(vectors("meanings")) >= 100


@pytest.mark.parametrize("vector", vectors("meanings"), ids=lambda vector: vector["name"])
def test_what_frames_mean(vector):
    expected = {key: value for key, value in vector.items() if key not in ("name", "wire")}
    wire = bytes.fromhex(vector["wire"])
    [found] = spec_codec.host_decoder(wire)
    if isinstance(found, str):
        assert {"error": found} == expected
        assert [item.reason.value for item in FrameDecoder().feed(wire)] == [found]
    else:
        assert spec_codec.meaning(found) == expected
        assert spec_codec.encode(*found) == wire


def item_text(item):
    match item:
        case str():
            return item if item in ("start", "stop") else f"bad:{item}"
        case BadFrame():
            return f"bad:{item.reason}"
    return f"frame:{item.type:02x}:{item.sequence:02x}:{item.uptime_ms:08x}:{item.body.hex() or '-'}"


@pytest.mark.parametrize("vector", vectors("streams"), ids=lambda vector: vector["name"])
def test_both_decoders(vector):
    wire = bytes.fromhex(vector["wire"])
    is_host = vector["side"] == "host"
    items = spec_codec.host_decoder(wire) if is_host else spec_codec.master_decoder(wire, bool(vector["idle"]))
    assert " ".join(map(item_text, items)) == vector["items"]


@pytest.mark.parametrize("name", ["config_limits", "config_image"])
def test_what_a_write_may_hold(name):
    for vector in vectors(name):
        if "data" in vector:
            found = spec_codec.refused(changed(DEFAULT, vector))
            assert found == vector.get("refused", vector["offset"]), vector["name"]


def test_eeprom():
    for vector in vectors("eeprom_images"):
        newest = spec_codec.newest_slot(bytes.fromhex(vector["slot_0"] + vector["slot_1"]))
        found = (-1, 0, b"") if newest is None else newest
        assert found == (vector["newest"], vector["counter"], bytes.fromhex(vector["image"])), vector["name"]
    for vector in vectors("eeprom_journal"):
        numbers, data = (vector["counter"], vector["dod"], vector["soc"]), bytes.fromhex(vector["data"])
        assert spec_codec.journal_meaning(data) == numbers, vector["name"]
        if vector["layout"] == 2:
            assert spec_codec.journal_entry(*numbers) == (vector["offset"], data)


def test_can_messages_of_the_default_tables():
    for vector in vectors("can_frames"):
        stored, data = vector["id"] | vector["is_extended"] << 31, bytes.fromhex(vector["data"])
        told = struct_with(vector["struct"])
        if vector["direction"] == "tx":
            assert spec_codec.can_message(bytes(told), vector["index"]) == (stored, data)
        else:
            image = struct_with("")
            spec_codec.can_received(image, stored, data)
            assert image == told


def test_every_worked_example_of_the_text():
    rows = spec_codec.table("examples")
    for what, message, sequence, uptime_ms, body, wire in rows:
        [frame] = spec_codec.host_decoder(bytes.fromhex(wire))
        said = spec_codec.meaning(frame)
        assert (said["message"], said["sequence"], said["uptime_ms"]) == (message, int(sequence), int(uptime_ms))
        assert said["body"] == body.replace(" ", "").replace("-", "")
        if message in ("COMMAND", "EVENT"):
            assert said[message.lower()] == what
    shown = {row[1] for row in rows} | {row[0] for row in rows}
    named = (spec_codec.TYPES, spec_codec.COMMANDS, spec_codec.EVENTS)
    assert {name for names in named for name in names.values()} <= shown


@given(st.lists(st.one_of(st.binary(max_size=8), st.sampled_from([b"x", b"y", b"\0"]), st.binary(max_size=600))))
def test_noise_is_the_same_to_both(parts):
    wire = b"".join(parts)
    assert list(map(item_text, spec_codec.host_decoder(wire))) == list(map(item_text, FrameDecoder().feed(wire)))


@given(st.integers(0, 255), st.integers(0, 255), st.integers(0, 2**32 - 1), st.binary(max_size=512))
def test_frames_are_the_same_to_both(type_, sequence, uptime_ms, body):
    wire = framing.encode_frame(type_, sequence, uptime_ms, body)
    assert spec_codec.encode(type_, sequence, uptime_ms, body) == wire
    assert spec_codec.host_decoder(wire) == [(type_, sequence, uptime_ms, body)]


@given(st.lists(st.tuples(st.integers(0, 419), st.integers(0, 255)), max_size=4))
def test_what_is_refused_is_the_same_to_both(changes):
    image = bytearray(DEFAULT)
    for offset, byte in changes:
        image[offset] = byte
    errors = config_image.check(bytes(image))
    assert spec_codec.refused(bytes(image)) == (errors[0].offset if errors else 0xFFFF)


def test_the_text_is_the_one_with_current_tables():
    assert spec_tables.with_tables(spec_codec.TEXT) == spec_codec.TEXT
