"""Worst-case latency against cases that can be counted by hand."""

from dataclasses import replace

import pytest

from firmware_protocol.can_latency import Cyclic, worst_latencies_s
from firmware_protocol.can_tables import rx_messages, tx_messages, with_rx_messages, with_tx_messages
from firmware_protocol.config_image import default_image, with_raw

DEFAULT = default_image()
FRAME_8 = 135 / 500_000  # the longest 11-bit frame with 8 bytes [s]
FRAME_8_EXTENDED = 160 / 500_000


def only(*messages):
    silent = with_tx_messages(DEFAULT, [replace(m, enabled=False, length=0) for m in tx_messages(DEFAULT)])
    silent = with_rx_messages(silent, [replace(m, enabled=False) for m in rx_messages(silent)])
    base = tx_messages(DEFAULT)[1]
    return with_tx_messages(silent, [replace(base, index=i, can_id=c, period_ms=p) for i, c, p in messages])


def test_one_message_waits_for_one_frame_that_has_begun():
    assert worst_latencies_s(only((0, 0x100, 100))) == {0: pytest.approx(FRAME_8_EXTENDED + FRAME_8)}


def test_a_lower_priority_waits_for_the_higher_once_more():
    found = worst_latencies_s(only((0, 0x200, 100), (1, 0x100, 100)))
    assert found[1] == pytest.approx(FRAME_8_EXTENDED + FRAME_8)
    assert found[0] == pytest.approx(FRAME_8_EXTENDED + 2 * FRAME_8)


def test_others_on_the_bus_count_by_their_priority():
    config = only((0, 0x200, 100))
    assert worst_latencies_s(config, [Cyclic(0x300, False, 8, 0.01)])[0] == pytest.approx(FRAME_8_EXTENDED + FRAME_8)
    before = worst_latencies_s(config, [Cyclic(0x100, False, 8, 0.01)])
    assert before[0] == pytest.approx(FRAME_8_EXTENDED + 2 * FRAME_8)
    extended = Cyclic(0x200 << 18, True, 8, 0.01)  # same leading bits: the 11-bit frame wins
    assert worst_latencies_s(config, [extended])[0] == pytest.approx(FRAME_8_EXTENDED + FRAME_8)


def test_a_bus_that_is_too_slow_is_told():
    busy = only((0, 0x200, 1), (1, 0x100, 1))
    slow = with_raw(busy, "can_brp", 31)  # 125 kbit/s: a frame takes a millisecond
    assert worst_latencies_s(slow) == {0: None, 1: None}


def test_the_default_tables_wait_less_than_two_milliseconds():
    found = worst_latencies_s(DEFAULT)
    assert set(found) == {0, 1}, "the summary, and the charger command as an answer"
    assert all(0 < latency < 0.002 for latency in found.values())
