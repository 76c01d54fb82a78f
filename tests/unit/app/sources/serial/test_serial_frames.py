"""Frames that public documents and other projects print, and any damage around them."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.battery.serial import SerialMapping
from app.sources.loaded_battery import LoadedBattery, load_battery
from app.sources.serial.checksums import checksum_of
from app.sources.serial.decoder import SerialDecoder
from app.sources.serial.framing import IDLE_NS, StreamReader
from tests.thesis_streams import DEGC, arrays, current_a, volts

# JBD's own document of the protocol
JBD_BASIC = bytes.fromhex("DD03001B1700000002D003E8000020780000000000001048030F020B760B82FBFF77")
JBD_CELLS = bytes.fromhex("DD04001E0F660F630F630F640F3E0F630F370F5B0F650F3B0F630F630F3C0F660F3DF9F977")
# a bridge to MQTT: demonstration of a car battery of eight cells
DALY = [
    bytes.fromhex(each)
    for each in (
        "a501900800f80000753001815d",
        "a5019508010b6b0c420c433289",
        "a5019508020c3c0c520c43326c",
        "a5019508030c000c480c433227",
        "a5019608013d000000000032b4",
    )
]
READ = {
    "jbd": {
        "voltage": [3.942, 3.939, 3.939, 3.940, 3.902, 3.939, 3.895, 3.931, 3.941, 3.899, 3.939, 3.939, 3.900, 3.942, 3.901],  # noqa: E501
        "pack_voltage": [58.88], "current": [0.0], "soc": [0.72], "temperature": [20.3, 21.5],
    },
    "daly": {
        "voltage": [2.923, 3.138, 3.139, 3.132, 3.154, 3.139, 3.072, 3.144, 3.139],
        "pack_voltage": [24.8], "current": [0.0], "soc": [0.385], "temperature": [21.0],
    },
}  # fmt: skip
CAPTURES = {"jbd": [JBD_BASIC, JBD_CELLS], "daly": DALY}


def decoded(battery: LoadedBattery, pieces: list[bytes], *, gap_ns: int = 1_000_000) -> tuple[dict, StreamReader]:
    """Values by kind of what is read piece by piece, and the reader."""
    mapping = battery.serial
    assert mapping is not None
    reader, decoder = StreamReader(mapping), SerialDecoder(battery.battery, mapping)
    frames = [frame for k, piece in enumerate(pieces) for frame in reader.feed(piece, k * gap_ns)]
    return decoder.decode([*frames, *reader.idle(len(pieces) * gap_ns + IDLE_NS)]), reader


@pytest.mark.parametrize("name", CAPTURES)
@pytest.mark.parametrize("size", [1, 3, 7, 1000])
def test_frames_of_public_documents_read_what_the_documents_say(name, size):
    stream = b"".join(CAPTURES[name])
    pieces = [stream[k : k + size] for k in range(0, len(stream), size)]
    values, reader = decoded(load_battery(name), pieces)
    assert {kind: values[kind].value.tolist() for kind in READ[name]} == {
        kind: pytest.approx(expected) for kind, expected in READ[name].items()
    }
    assert (reader.frames, reader.bad_frames, reader.skipped_bytes) == (len(CAPTURES[name]), 0, 0)


@pytest.mark.parametrize("name", CAPTURES)
@given(junk=st.lists(st.binary(max_size=60), min_size=6, max_size=6), cut=st.integers(1, 12), data=st.data())
def test_no_damage_around_a_frame_changes_or_loses_it(name, junk, cut, data):
    frames = CAPTURES[name]
    stream = b"".join(itertools.chain.from_iterable(zip(junk, [*frames, frames[0][:cut]], strict=False)))
    sizes = data.draw(st.lists(st.integers(1, 40), min_size=1, max_size=5))
    ends = itertools.accumulate(itertools.cycle(sizes))
    starts = [0, *itertools.takewhile(lambda end: end < len(stream), ends), len(stream)]
    _, reader = decoded(load_battery(name), [stream[a:b] for a, b in itertools.pairwise(starts)])
    assert reader.frames >= len(frames)


@given(stream=st.binary(max_size=3000))
def test_bytes_that_are_no_frame_give_no_value_behind_a_checksum(stream):
    values, reader = decoded(load_battery("jbd"), [stream])
    assert (values, reader.frames) == ({}, 0)
    assert reader.skipped_bytes <= len(stream)


@given(
    stream=st.binary(max_size=2000),
    name=st.sampled_from(["thesis-arrays", "thesis-struct", "thesis-hex", "ascii-line", "vesc-bms"]),
)
def test_any_bytes_are_read_without_an_error(stream, name):
    _, reader = decoded(load_battery(name), [stream[:700], stream[700:]])
    assert len(reader.last) <= 64


def test_each_flipped_bit_of_a_frame_is_noticed():
    for frame in (JBD_CELLS, DALY[1]):
        battery = load_battery("jbd" if frame is JBD_CELLS else "daly")
        for bit in range(8 * len(frame)):
            damaged = bytearray(frame)
            damaged[bit // 8] ^= 1 << bit % 8
            assert decoded(battery, [bytes(damaged)])[0] == {}


def test_a_stream_without_a_header_is_framed_by_its_silence():
    t_ns = 0
    battery = load_battery("thesis-arrays")
    reader, decoder = StreamReader(battery.serial), SerialDecoder(battery.battery, battery.serial)
    found = []
    for k in range(5):
        raw = arrays(k)
        for part in (raw[:100], raw[100:]):
            t_ns += 20_000_000
            found += reader.feed(part, t_ns)
        t_ns += 1_000_000_000
        found += reader.idle(t_ns)
    values = decoder.decode(found)
    assert len(found) == 5  # the first waits for a second that is like it
    assert values["voltage"].value[-96:] == pytest.approx(volts(4))
    assert values["current"].value.tolist() == [current_a(k) for k in range(5)]
    assert values["temperature"].value[:5].tolist() == DEGC[:5]


@pytest.mark.parametrize(
    ("kind", "data", "expected"),
    [
        ("crc-16/modbus", b"123456789", 0x4B37),
        ("crc-16/xmodem", b"123456789", 0x31C3),
        ("crc-32", b"123456789", 0xCBF43926),
        ("sum16-complement", bytes.fromhex("0300"), 0xFFFD),
        ("xor8", b"\x01\x02\x04", 7),
    ],
)
def test_checksums_have_the_published_check_values(kind, data, expected):
    found = checksum_of(kind)
    assert found is not None
    assert found[1](data) == expected


def test_a_mapping_without_frames_reads_nothing():
    assert StreamReader(SerialMapping()).feed(b"abc" * 100, 1) == []
