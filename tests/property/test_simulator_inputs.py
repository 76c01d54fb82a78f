"""Whatever bytes reach the simulated master or its adapters, they keep running and answer sensibly."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_protocol.config_image import check
from firmware_protocol.framing import BadFrame, FrameDecoder, encode_frame
from firmware_protocol.memory_map import CONFIG_SIZE
from firmware_protocol.messages import MessageType, decode_message
from simulator.board import Board
from simulator.can_bus import CanBus, CanFrame
from simulator.eeprom import Eeprom
from simulator.master import VirtualMaster
from simulator.slave import SlaveChain
from simulator.slcan import SlcanAdapter
from tests.campaign import examples

BOARD = Board(Eeprom(), np.random.default_rng(1))
REQUESTS = st.tuples(
    st.one_of(st.sampled_from(list(MessageType)), st.integers(0, 255)),
    st.integers(0, 255),
    st.binary(max_size=40),
)


def everything_sent(master: VirtualMaster) -> list[object]:
    """Return what the master has to say within two seconds, decoded."""
    decoder, out, now_s = FrameDecoder(), [], 0.0
    for _ in range(100):
        now_s += 0.02
        master.measure(now_s, 0.02, 0.0)
        while (frame := master.next_frame(now_s)) is not None:
            out += decoder.feed(frame)
    assert not any(isinstance(item, BadFrame) for item in out)
    return [decode_message(item) for item in out]


@settings(max_examples=examples(25))
@given(st.lists(st.binary(max_size=60), max_size=8))
def test_any_bytes_leave_a_master_that_answers(chunks):
    master = VirtualMaster(BOARD, 0.0)
    for index, chunk in enumerate(chunks):
        master.receive(chunk, index * 0.5)
    master.receive(b"\0\0" + encode_frame(MessageType.IDENT, 200, 0, b""), 10.0)
    replies = [m for m in everything_sent(master) if getattr(m, "request_sequence", None) == 200]
    assert len(replies) == 1


@settings(max_examples=examples(40))
@given(st.lists(REQUESTS, max_size=6))
def test_any_requests_leave_a_configuration_that_passes_the_check(requests):
    master = VirtualMaster(BOARD, 0.0)
    for request in requests:
        master.receive(encode_frame(request[0], request[1], 0, request[2]), 0.01)
    everything_sent(master)
    assert check(bytes(master.image[:CONFIG_SIZE])) == []


@given(st.binary(max_size=200), st.integers(1, 50))
def test_adapter_takes_any_bytes_in_any_chunks_alike(raw, size):
    def played(chunks: list[bytes]) -> tuple[bytes, list[CanFrame]]:
        bus, sent, received = CanBus(), bytearray(), []
        adapter = SlcanAdapter(bus, sent.extend)

        class Node:
            bit_rate = 500_000
            is_listening_only = False

            def can_received(self, frame: CanFrame, now_s: float) -> None:
                received.append(frame)

        node = Node()
        bus.attach(adapter)
        bus.attach(node)
        adapter.feed(b"S6\rO\r", 0.0)
        for chunk in chunks:
            adapter.feed(chunk, 0.0)
        bus.run(1.0)
        return bytes(sent), received

    lines = [line[:32] for line in raw.split(b"\r")]
    short = b"\r".join(lines)
    assert played([short]) == played([short[i : i + size] for i in range(0, len(short), size)])


@given(st.integers(0, 0x1FFFFFFF), st.booleans(), st.binary(max_size=64))
def test_received_can_frames_never_touch_the_configuration(can_id, is_extended, data):
    master = VirtualMaster(BOARD, 0.0)
    before = bytes(master.image[:CONFIG_SIZE])
    master.can_received(CanFrame(can_id, is_extended, data), 0.0)
    master.can_received(CanFrame(0x18FF50E5, True, data), 0.0)
    assert bytes(master.image[:CONFIG_SIZE]) == before


@given(st.binary(max_size=16))
def test_slaves_take_any_packet(packet):
    chain = SlaveChain(8, np.random.default_rng(1))
    assert len(chain.execute(packet, chain.wake(0.0))) in (0, 1, 8)
