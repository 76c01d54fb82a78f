"""The C reference against the Python side of the line, on the same bytes."""

import subprocess

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_protocol.framing import BadFrame, Frame, FrameDecoder, encode_frame
from tests import spec_codec
from tests.c_programs import build_program
from tests.campaign import examples


@pytest.fixture(scope="module")
def driver():
    """Ask host_test one line at a time."""
    program = build_program("host_test")
    with subprocess.Popen([program, "driver"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:

        def ask(line):
            process.stdin.write(line + "\n")
            process.stdin.flush()
            return process.stdout.readline().split()

        yield ask
        process.stdin.close()


BODIES = st.binary(max_size=60) | st.lists(st.sampled_from(b"\0xy\x01\xff"), max_size=300).map(bytes)
PARTS = st.one_of(
    st.builds(encode_frame, st.integers(0, 255), st.integers(0, 255), st.integers(0, 0xFFFFFFFF), BODIES),
    st.sampled_from((b"x", b"y", b"\0", b"\0\0", b"\xff" * 530)),
    st.lists(st.sampled_from(b"\0xy\x01\x02\xff\x55") | st.integers(0, 255), max_size=80).map(bytes),
)


def damaged(raw, hits):
    out = bytearray(raw)
    for at, bit in hits:
        if out:
            out[at % len(out)] ^= 1 << bit
    return bytes(out)


STREAMS = st.builds(
    damaged,
    st.lists(PARTS, max_size=6).map(b"".join),
    st.lists(st.tuples(st.integers(0, 4000), st.integers(0, 7)), max_size=3),
)


def in_words(item):
    match item:
        case str():
            return item if item in ("start", "stop") else f"bad:{item}"
        case Frame() | spec_codec.Frame():
            return f"frame:{item.type:02x}:{item.sequence:02x}:{item.uptime_ms:08x}:{item.body.hex() or '-'}"
        case BadFrame():
            return f"bad:{item.reason}"


@given(raw=STREAMS, size=st.sampled_from((1, 3, 64, 5000)), silent=st.booleans())
@settings(max_examples=examples(150))
def test_decoders_understand_what_the_hosts_and_that_of_the_text_do(driver, raw, size, silent):
    expected = {"host": FrameDecoder().feed(raw), "master": spec_codec.master_decoder(raw, silent)}
    for side, items in expected.items():
        *words, _ = driver(f"feed {side} {int(silent)} {size} {raw.hex() or '-'}")
        assert words == [in_words(item) for item in items]


def test_noise_is_counted_in_bytes_once(driver):
    frame = encode_frame(0x11, 7, 0, b"\0\0\4\0")
    wire = b"\0abc\0" + frame + b"\0abcde"
    assert driver(f"feed master 1 1 {wire.hex()}")[-1] == "dropped:8"
    assert driver(f"feed master 1 1 {frame[:-1].hex()}")[-1] == f"dropped:{len(frame) - 2}", "it never closed"
