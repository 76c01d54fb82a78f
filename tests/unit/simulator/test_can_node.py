from dataclasses import replace

import pytest

from firmware_protocol.can_tables import RxMessage, TxMessage, rx_messages, with_rx_messages, with_tx_messages
from firmware_protocol.config_image import default_image, with_raw
from firmware_protocol.memory_map import BYTE_UNUSED, FIELDS
from firmware_protocol.messages import EventCode
from simulator.can_bus import CanFrame
from simulator.can_node import CanNode
from simulator.memory import MasterMemory

CHARGER = CanFrame(0x18FF50E5, True, bytes.fromhex("0f9b007800000000"))


@pytest.fixture
def memory() -> MasterMemory:
    memory = MasterMemory()
    memory.config = default_image()
    return memory


def frames(node: CanNode, until_s: float, step_s: float = 0.02) -> list[CanFrame]:
    return [frame for tick in range(round(until_s / step_s)) for frame in node.due(tick * step_s, step_s)]


def test_summary_is_sent_ten_times_a_second_from_start_up(memory):
    memory.set_charge(0, 0x1234)
    sent = [frame for frame in frames(CanNode(memory), 2.0) if frame.can_id == 0x100]
    assert len(sent) == 20
    assert sent[0].data[:2] == bytes.fromhex("3412")


def test_periods_shorter_than_a_pass_keep_their_rate(memory):
    memory.config = with_raw(memory.config, "can_tx_msg_timing", [1000, 7, 0, 0, 0, 0, 0, 0])
    sent = [frame for frame in frames(CanNode(memory), 7.0) if frame.can_id == 0x100]
    assert 998 <= len(sent) <= 1003


def test_what_comes_late_is_sent_once_and_not_made_up_for(memory):
    node = CanNode(memory)
    frames(node, 1.0)
    assert len([frame for frame in node.due(30.0, 0.02) if frame.can_id == 0x100]) == 1
    late = [frame for tick in range(1, 51) for frame in node.due(30.0 + tick * 0.02, 0.02) if frame.can_id == 0x100]
    assert len(late) in (9, 10)


def test_charger_message_is_stored_answered_and_marked_alive(memory):
    node = CanNode(memory)
    assert not any(frame.is_extended for frame in frames(node, 1.0))
    node.received(CHARGER, 1.0)
    assert node.rx_active == 1
    assert memory.charger("v_out") == 0x0F9B
    assert memory.charger("i_out") == 120
    assert [frame.can_id for frame in node.due(1.02, 0.02) if frame.is_extended] == [0x1806E5F4]


def test_silence_ends_the_answer_and_is_told_once(memory):
    node = CanNode(memory)
    node.received(CHARGER, 0.0)
    assert node.expire(5.0) == []
    events = node.expire(5.1)
    assert [(event.code, event.value) for event in events] == [(EventCode.CAN_RX_TIMEOUT, 0)]
    assert (node.rx_active, node.tx_enabled & 1) == (0, 0)
    assert node.expire(9.0) == []


def test_a_charger_is_told_once_heard_and_once_silent_where_it_is_to_charge_by(memory):
    node = CanNode(memory)
    node.received(CHARGER, 0.0)
    assert node.take_charge() is None  # off by default
    memory.config = with_rx_messages(memory.config, [replace(rx_messages(memory.config)[0], charges=True)])
    node.reload()
    assert node.take_charge() is None  # a change of the configuration begins nothing
    node.received(CHARGER, 1.0)
    assert node.take_charge() is None
    node.expire(6.1)
    assert [node.take_charge(), node.take_charge()] == [False, None]
    node.received(CHARGER, 7.0)
    node.received(CHARGER, 8.0)
    assert [node.take_charge(), node.take_charge()] == [True, None]


def test_messages_nobody_listens_for_change_nothing(memory):
    node = CanNode(memory)
    before = bytes(memory.image)
    node.received(CanFrame(0x0FF50E5, True, bytes(8)), 0.0)
    node.received(CanFrame(0x7FF, False, b"\1\2"), 0.0)
    assert bytes(memory.image) == before


def test_on_demand_is_sent_once(memory):
    node = CanNode(memory)
    node.send_once(2)
    first, second = list(node.due(0.0, 0.02)), list(node.due(0.02, 0.02))
    assert len(first) == len(second) + 2  # the message asked for, and the summary's first


def test_a_changed_table_is_in_force_at_once_and_keeps_what_is_alive(memory):
    node = CanNode(memory)
    node.received(CHARGER, 0.0)
    soc = FIELDS["soc"].offset
    tx = TxMessage(3, True, 0x321, False, 50, 2, (soc + 1, soc, *[BYTE_UNUSED] * 6))
    rx = RxMessage(4, True, 0x123, False, 100, 1, (FIELDS["charger.fan_duty"].offset, *[BYTE_UNUSED] * 7), None)
    memory.config = with_rx_messages(with_tx_messages(memory.config, [tx]), [rx])
    node.reload()
    memory.set_charge(0, 0x1234)
    assert node.rx_active == 1
    assert next(frame for frame in node.due(1.0, 0.02) if frame.can_id == 0x321).data == bytes.fromhex("1234")
    node.received(CanFrame(0x123, False, b"\x80"), 1.0)
    assert memory.charger("fan_duty") == 0x80
