"""The master's tables of CAN in passes of 20 ms: what it sends when, and what it takes."""

import numpy as np
import pytest

from firmware_protocol.can_tables import RxMessage, TxMessage, with_rx_messages, with_tx_messages
from firmware_protocol.config_image import default_image, with_raw
from firmware_protocol.eeprom import plan_store
from firmware_protocol.framing import FrameDecoder, encode_frame
from firmware_protocol.memory_map import BYTE_UNUSED, CONFIG_SIZE, FIELDS
from firmware_protocol.messages import CommandId, EventCode, EventMessage, Write, decode_message, encode_request
from simulator.board import Board
from simulator.can_bus import CanFrame
from simulator.eeprom import Eeprom
from simulator.master import VirtualMaster
from simulator.vehicle import PASS_S

CHARGER = CanFrame(0x18FF50E5, True, bytes.fromhex("0f9b007800000000"))
SUMMARY = 0x100


class Node:
    """A master alone on its bus, and the time."""

    def __init__(self, config: bytes | None = None) -> None:
        eeprom = Eeprom()
        for page in plan_store(b"\xff" * 32768, config or default_image()):
            eeprom.write(page.offset, page.data)
        self.master = VirtualMaster(Board(eeprom, np.random.default_rng(1)), 0.0)
        self.passes = 0
        self.events: list[EventMessage] = []
        self._decoder = FrameDecoder()

    def run(self, seconds: float) -> list[CanFrame]:
        """Return what is sent meanwhile."""
        sent = []
        for _ in range(round(seconds / PASS_S)):
            self.master.measure(self.now_s, PASS_S, 0.0)
            sent += self.master.can_sent()
            while (frame := self.master.next_frame(self.now_s)) is not None:
                messages = map(decode_message, self._decoder.feed(frame))
                self.events += [message for message in messages if isinstance(message, EventMessage)]
            self.passes += 1
        return sent

    @property
    def now_s(self) -> float:
        return PASS_S * self.passes

    def receive(self, frame: CanFrame) -> None:
        self.master.can_received(frame, self.now_s)

    def value(self, name: str) -> int:
        return FIELDS[name].unpack(self.master.image)[0]


@pytest.fixture
def node() -> Node:
    return Node()


def test_summary_is_sent_ten_times_a_second_from_start_up(node):
    sent = [frame for frame in node.run(2.0) if frame.can_id == SUMMARY]
    assert len(sent) == 20
    assert sent[-1].data[:2] == node.value("soc").to_bytes(2, "big")


def test_periods_shorter_than_a_pass_keep_their_rate():
    node = Node(with_raw(default_image(), "can_tx_msg_timing", [1000, 7, 0, 0, 0, 0, 0, 0]))
    assert 998 <= sum(frame.can_id == SUMMARY for frame in node.run(7.0)) <= 1003


def test_what_comes_late_is_sent_once_and_not_made_up_for(node):
    node.run(1.0)
    node.passes += 1500  # half a minute without one
    assert sum(frame.can_id == SUMMARY for frame in node.run(PASS_S)) == 1
    assert sum(frame.can_id == SUMMARY for frame in node.run(1.0)) in (9, 10)


def test_charger_message_is_stored_answered_and_marked_alive(node):
    assert not any(frame.is_extended for frame in node.run(1.0))
    node.receive(CHARGER)
    assert (node.value("charger.v_out"), node.value("charger.i_out")) == (0x0F9B, 120)
    assert node.value("status.can_rx_msg_active") == 1
    assert [frame.can_id for frame in node.run(PASS_S) if frame.is_extended] == [0x1806E5F4]


def test_silence_ends_the_answer_and_is_reported_once(node):
    node.receive(CHARGER)
    node.run(5.0)
    assert node.value("status.can_rx_msg_active") == 1
    node.run(0.1)
    node.run(4.0)
    lost = [event.value for event in node.events if event.code == EventCode.CAN_RX_TIMEOUT]
    assert lost == [0]
    assert (node.value("status.can_rx_msg_active"), node.value("status.can_tx_msg_en") & 1) == (0, 0)


def test_messages_nobody_listens_for_change_nothing(node):
    before = bytes(node.master.image)
    node.receive(CanFrame(0x0FF50E5, True, bytes(8)))
    node.receive(CanFrame(0x7FF, False, b"\1\2"))
    assert bytes(node.master.image) == before


def test_on_demand_is_sent_once(node):
    node.run(1.0)
    plain = len(node.run(1.0))
    assert node.master.command(CommandId.CAN_SEND, 2, node.now_s)
    assert [len(node.run(1.0)), len(node.run(1.0))] == [plain + 1, plain]


def test_a_changed_table_is_in_force_at_once_and_keeps_what_is_alive(node):
    node.receive(CHARGER)
    soc = FIELDS["soc"].offset
    tx = TxMessage(3, True, 0x321, False, 50, 2, (soc + 1, soc, *[BYTE_UNUSED] * 6))
    rx = RxMessage(4, True, 0x123, False, 100, 1, (FIELDS["charger.fan_duty"].offset, *[BYTE_UNUSED] * 7), None)
    config = with_rx_messages(with_tx_messages(default_image(), [tx]), [rx])
    kind, body = encode_request(Write(0, config))
    node.master.receive(encode_frame(kind, 1, 0, body), node.now_s)
    assert bytes(node.master.image[:CONFIG_SIZE]) == config
    sent = next(frame for frame in node.run(0.1) if frame.can_id == 0x321)
    assert sent.data == node.value("soc").to_bytes(2, "big")
    assert node.value("status.can_rx_msg_active") == 1
    node.receive(CanFrame(0x123, False, b"\x80"))
    assert node.value("charger.fan_duty") == 0x80


def test_several_masters_in_a_process_know_nothing_of_each_other():
    nodes = [Node(with_raw(default_image(), "can_tx_msg_timing", [1000, 100 * k, *[0] * 6])) for k in (1, 2, 5)]
    for _ in range(50):
        sent = [len(node.run(PASS_S)) for node in nodes]
    counts = [sum(frame.can_id == SUMMARY for frame in node.run(2.0)) for node in nodes]
    assert sent
    assert counts == [20, 10, 4]
