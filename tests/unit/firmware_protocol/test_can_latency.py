"""Worst-case latency against cases that can be counted by hand."""

from dataclasses import replace

import pytest

from firmware_protocol.can_latency import Cyclic, cyclic_messages, worst_latencies_s
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


def test_a_higher_priority_that_is_due_again_meanwhile_counts_again():
    config = only((0, 0x200, 100))
    often = Cyclic(0x100, False, 8, 1.5 * FRAME_8)
    # 160 bits of blocking and one frame of 0x100 last until a second is due, these until a third: 160 + 3 x 135
    assert worst_latencies_s(config, [often])[0] == pytest.approx((160 + 3 * 135 + 135) / 500_000)


def test_length_and_format_of_the_others_count():
    config = only((0, 0x200, 100))
    short = worst_latencies_s(config, [Cyclic(0x100, False, 0, 1.0)])[0]
    assert short == pytest.approx(FRAME_8_EXTENDED + 55 / 500_000 + FRAME_8)
    extended = worst_latencies_s(config, [Cyclic(0x1FF << 18, True, 8, 1.0)])[0]
    assert extended == pytest.approx(2 * FRAME_8_EXTENDED + FRAME_8)


def test_messages_of_others_without_a_period_or_with_our_id_do_not_count_twice():
    config = only((0, 0x200, 100), (1, 0x100, 100))
    own = worst_latencies_s(config)
    assert worst_latencies_s(config, [Cyclic(0x100, False, 8, 0.001), Cyclic(0x50, False, 8, 0.0)]) == own


def test_a_message_that_needs_its_whole_period_is_just_in_time():
    frame_s = 160 / 500_000 + 135 / 500_000
    assert worst_latencies_s(only((0, 0x100, 1)))[0] == pytest.approx(frame_s)
    slower = with_raw(only((0, 0x100, 1)), "can_brp", 12)  # 307.7 kbit/s: 0.96 ms
    assert worst_latencies_s(slower)[0] == pytest.approx(295 / 307_692)
    too_slow = with_raw(only((0, 0x100, 1)), "can_brp", 13)
    assert worst_latencies_s(too_slow) == {0: None}


def test_the_format_of_the_message_itself_counts():
    config = only((0, 0x200, 100))
    config = with_tx_messages(config, [replace(tx_messages(config)[0], is_extended=True)])
    assert worst_latencies_s(config) == {0: pytest.approx(2 * FRAME_8_EXTENDED)}


def test_a_frame_that_becomes_due_in_the_last_bit_of_waiting_goes_first():
    config = only((0, 0x200, 100))
    bit_s = 1 / 500_000
    once = worst_latencies_s(config, [Cyclic(0x100, False, 8, (160 + 135 + 1.5) * bit_s)])[0]
    twice = worst_latencies_s(config, [Cyclic(0x100, False, 8, (160 + 135 + 0.5) * bit_s)])[0]
    assert once == pytest.approx((160 + 135 + 135) * bit_s)
    assert twice == pytest.approx((160 + 2 * 135 + 135) * bit_s)


def test_only_messages_that_are_sent_again_and_again_are_cyclic():
    config = only((0, 0x200, 100), (1, 0x100, 0), (2, 0x300, 50))
    config = with_tx_messages(config, [replace(tx_messages(config)[2], enabled=False)])
    assert cyclic_messages(config) == {0: Cyclic(0x200, False, 8, 0.1)}
    answered = with_rx_messages(config, [replace(rx_messages(config)[1], enabled=True, response=2)])
    assert cyclic_messages(answered) == {0: Cyclic(0x200, False, 8, 0.1), 2: Cyclic(0x300, False, 8, 0.05)}
    empty = with_tx_messages(answered, [replace(tx_messages(answered)[2], length=0)])
    assert list(cyclic_messages(empty)) == [0]


def test_a_bus_that_is_too_slow_is_told():
    busy = only((0, 0x200, 1), (1, 0x100, 1))
    slow = with_raw(busy, "can_brp", 31)  # 125 kbit/s: a frame takes a millisecond
    assert worst_latencies_s(slow) == {0: None, 1: None}


def test_the_default_tables_wait_less_than_two_milliseconds():
    found = worst_latencies_s(DEFAULT)
    assert set(found) == {0, 1}, "the summary, and the charger command as an answer"
    assert all(0 < latency < 0.002 for latency in found.values())
