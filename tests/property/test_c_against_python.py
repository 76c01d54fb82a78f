"""The C reference against the Python side, on the same bytes and the same requests."""

import socket
import struct
import subprocess

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_protocol import schedule
from firmware_protocol.can_tables import RxMessage, TxMessage, with_rx_messages, with_tx_messages
from firmware_protocol.config_image import default_image
from firmware_protocol.framing import BadFrame, CommandDecoder, Frame, FrameDecoder, StreamCommand, encode_frame
from firmware_protocol.memory_map import BYTE_UNUSED, CAN_ID_EXTENDED, CONFIG_FIELDS, CONFIG_SIZE, MASTER_SIZE
from firmware_protocol.messages import MessageType, Reply, decode_message
from simulator.board import Board
from simulator.can_bus import CanFrame
from simulator.can_node import CanNode
from simulator.eeprom import Eeprom
from simulator.master import VirtualMaster
from simulator.memory import MasterMemory
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


# -- decoders

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
        case Frame():
            return f"frame:{item.type:02x}:{item.sequence:02x}:{item.uptime_ms:08x}:{item.body.hex() or '-'}"
        case BadFrame():
            return f"bad:{item.reason}"
        case StreamCommand():
            return "start" if item.start else "stop"


@given(raw=STREAMS, size=st.sampled_from((1, 3, 64, 5000)), silent=st.booleans())
@settings(max_examples=examples(150))
def test_both_decoders_understand_the_same(driver, raw, size, silent):
    for side, decoder in (("host", FrameDecoder()), ("master", CommandDecoder())):
        items = [item for at in range(0, len(raw), size) for item in decoder.feed(raw[at : at + size])]
        if silent and isinstance(decoder, CommandDecoder):
            items += decoder.idle()
        *words, _ = driver(f"feed {side} {int(silent)} {size} {raw.hex() or '-'}")
        assert words == [in_words(item) for item in items]


# -- the stream

FRAMES = 300


def python_stream(ts_ms):
    """As host_test's `stream`; what is due on the millisecond is due, whatever the last digit of a float says."""
    stream = schedule.StreamSchedule(ts_ms / 1000, 0.0)
    now_ms, looks, out = 0, 0, []
    while len(out) < FRAMES:
        looks += 1
        spans = stream.take(now_ms / 1000 + looks * 1e-9)
        if spans is None:
            now_ms += 1
            continue
        out.append(f"{now_ms}:" + ",".join(f"{offset}+{length}" for offset, length in spans))
        now_ms += (12 + sum(4 + length for _, length in spans)) * 11 * 1000 // 115200 + 1
    return out


@given(ts_ms=st.integers(20, 400))
@settings(max_examples=examples(25))
def test_both_schedules_send_the_same(driver, ts_ms):
    assert driver(f"stream {ts_ms} {FRAMES}") == python_stream(ts_ms)


# -- CAN

OFFSETS = st.lists(st.integers(1884, MASTER_SIZE - 1) | st.just(BYTE_UNUSED), min_size=8, max_size=8).map(tuple)
IDS = st.one_of(st.tuples(st.integers(0, 0x7FF), st.just(False)), st.tuples(st.integers(0, 0x1FFFFFFF), st.just(True)))
PERIODS = st.sampled_from((0, 20, 30, 70, 100))
TIMEOUTS = st.sampled_from((0, 33, 57, 121))  # never on a step, where the last digit of a float would decide
STEP_MS = 10
CHARGES = (None, True, False)  # in the order of `enum vw_charge`


@st.composite
def tables(draw):
    """A configuration with messages both ways, the received ones told apart by their ids."""
    ids = draw(st.lists(IDS, min_size=8, max_size=8, unique=True))
    image = default_image()
    image = with_tx_messages(
        image,
        [
            TxMessage(i, draw(st.booleans()), *draw(IDS), draw(PERIODS), draw(st.integers(0, 8)), draw(OFFSETS))
            for i in range(8)
        ],
    )
    response = st.just((None,)) | st.tuples(st.integers(0, 7), st.booleans())
    rx = [
        RxMessage(
            i, draw(st.booleans()), *ids[i], draw(TIMEOUTS), draw(st.integers(1, 8)), draw(OFFSETS), *draw(response)
        )
        for i in range(8)
    ]
    return with_rx_messages(image, rx), rx


STEPS = st.lists(
    st.one_of(
        st.just(("n",)),
        st.tuples(st.just("o"), st.integers(0, 7)),
        st.tuples(st.just("r"), st.integers(0, 7), st.binary(max_size=8)),
        st.just(("x",)),
        st.tuples(st.just("late"), st.integers(1, 500)),
    ),
    max_size=40,
)


def raw_id(can_id, is_extended):
    return can_id | (CAN_ID_EXTENDED if is_extended else 0)


@given(table=tables(), steps=STEPS)
@settings(max_examples=examples(40))
def test_both_can_nodes_send_and_take_the_same(driver, table, steps):
    config, rx = table
    memory = MasterMemory()
    memory.image[CONFIG_SIZE:] = bytes(7 * i & 0xFF for i in range(CONFIG_SIZE, MASTER_SIZE))
    memory.config = config
    node, words, said, missed_ms = CanNode(memory), [], [], 0
    for index, (kind, *rest) in enumerate(steps):
        missed_ms += rest[0] if kind == "late" else 0
        now_ms = index * STEP_MS + missed_ms
        now_s = now_ms / 1000 + index * 1e-9
        if kind == "o":
            words.append(f"o:{rest[0]}")
            node.send_once(rest[0])
        elif kind == "r":
            message = rx[rest[0]]
            words.append(f"r:{now_ms}:{raw_id(message.can_id, message.is_extended)}:{rest[1].hex() or '-'}")
            node.received(CanFrame(message.can_id, message.is_extended, rest[1]), now_s)
        elif kind == "x":
            words.append(f"x:{now_ms}")
            said += [f"lost:{event.value}" for event in node.expire(now_s)]
            said.append(f"charge:{CHARGES.index(node.take_charge())}")
        words.append(f"n:{now_ms}")
        said += [f"{raw_id(f.can_id, f.is_extended)}:{f.data.hex() or '-'}" for f in node.due(now_s, 0.0)]
    said += [str(node.tx_enabled), str(node.rx_enabled), str(node.rx_active), memory.image[1884:].hex()]
    assert driver(f"can {config.hex()} {' '.join(words)}") == said


# -- requests


class CMaster:
    """`host/master.c` at the other end of a socket."""

    def __init__(self, program):
        ours, theirs = socket.socketpair()
        fd = theirs.fileno()
        command = [program, "--fd", str(fd), "--page-ms", "0"]
        self._process = subprocess.Popen(command, pass_fds=[fd], stdout=subprocess.DEVNULL)
        theirs.close()
        ours.settimeout(10)
        self._socket = ours
        self._decoder = FrameDecoder()

    def ask(self, frame):
        self._socket.sendall(frame)
        while True:
            for item in self._decoder.feed(self._socket.recv(4096)):
                if item.type == MessageType.REPLY:
                    return decode_message(item)

    def close(self):
        self._socket.close()
        self._process.wait(10)


class SimulatedMaster:
    """The virtual master, driven until it replies."""

    def __init__(self):
        self._master = VirtualMaster(Board(Eeprom(), np.random.default_rng(1)), 0.0)
        self._decoder = FrameDecoder()
        self._now_s = 0.0

    def ask(self, frame):
        self._master.receive(frame, self._now_s)
        for _ in range(50):
            while (sent := self._master.next_frame(self._now_s)) is not None:
                for item in self._decoder.feed(sent):
                    if item.type == MessageType.REPLY:
                        return decode_message(item)
            self._now_s += 0.02
            self._master.measure(self._now_s, 0.02, 0.0)
        raise AssertionError("no reply")


def window(offset, data):
    return offset.to_bytes(2, "little") + len(data).to_bytes(2, "little") + data


VALUES = st.sampled_from(CONFIG_FIELDS).flatmap(
    lambda field: st.tuples(
        st.just(field.offset),
        st.sampled_from((field.minimum, field.maximum, field.minimum - 1, field.maximum + 1, 0, 8, 0xFFFF, 3900)).map(
            lambda value: (value % (1 << 8 * field.item_size)).to_bytes(field.item_size, "little")
        ),
    )
)
REQUESTS = st.one_of(
    VALUES.map(lambda value: (int(MessageType.WRITE), window(*value))),
    st.tuples(st.integers(0, 430), st.binary(max_size=8)).map(lambda w: (int(MessageType.WRITE), window(*w))),
    st.sampled_from(((MessageType.STORE, b""), (MessageType.LOAD, b""), (MessageType.STORE, b"\0"))),
    st.tuples(st.integers(0, 421), st.integers(0, 9)).map(
        lambda w: (int(MessageType.READ), w[0].to_bytes(2, "little") + w[1].to_bytes(2, "little"))
    ),
    st.sampled_from((0x8000, 0x8200, 0x83F0, 0xFFFF, 0xFFF0)).map(
        lambda offset: (int(MessageType.READ), offset.to_bytes(2, "little") + b"\x10\0")
    ),
    st.tuples(st.sampled_from((MessageType.WRITE, MessageType.READ, MessageType.IDENT, 0x7F)), st.binary(max_size=9)),
    st.sampled_from((b"\x07\x11\x27\0\0", b"\x05\xfe\xff\xff\xff", b"\x63\0\0\0\0", b"\x09\x08\0\0\0", b"\x01")).map(
        lambda body: (int(MessageType.COMMAND), body)
    ),
)


@given(requests=st.lists(REQUESTS, min_size=1, max_size=25))
@settings(max_examples=examples(40))
def test_both_masters_reply_alike_and_end_with_the_same_configuration(c_master_program, requests):
    c_master, simulated = CMaster(c_master_program), SimulatedMaster()
    whole = (int(MessageType.READ), b"\0\0" + CONFIG_SIZE.to_bytes(2, "little"))
    slots = [(int(MessageType.READ), (0x8000 + at).to_bytes(2, "little") + b"\0\1") for at in range(0, 1024, 256)]
    try:
        for sequence, (kind, body) in enumerate([*requests, whole, *slots]):
            end = sum(struct.unpack("<HH", body[:4].ljust(4, b"\0")))
            if kind == MessageType.READ and CONFIG_SIZE < end <= MASTER_SIZE:
                continue  # what is measured, which each makes up for itself
            frame = encode_frame(kind, sequence, 0, body)
            replies: list[Reply] = [c_master.ask(frame), simulated.ask(frame)]
            if kind == MessageType.IDENT and not body:
                continue
            assert replies[0] == replies[1], (MessageType(kind) if kind != 0x7F else kind, body.hex())
    finally:
        c_master.close()
