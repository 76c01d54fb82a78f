"""The inbox keeps the order, makes the links wait while it is full, and lets go of them when it is closed."""

import threading
import time

from app.service.inbox import STALL_S, Inbox
from app.sources.items import CanItem


def item(number: int) -> CanItem:
    return CanItem(number, number, number, b"")


def test_items_come_out_in_the_order_in_which_they_were_put():
    inbox = Inbox()
    for number in range(3):
        inbox.put(item(number))
    assert [inbox.get(0.0).can_id for _ in range(3)] == [0, 1, 2]


def test_an_empty_inbox_gives_none_after_the_timeout():
    assert Inbox().get(0.0) is None


def test_a_link_waits_while_the_inbox_is_full():
    inbox = Inbox(size=1)
    inbox.put(item(0))
    waiting = threading.Thread(target=inbox.put, args=(item(1),))
    waiting.start()
    assert inbox.get(5.0).can_id == 0
    assert inbox.get(5.0).can_id == 1
    waiting.join(5.0)


def test_closing_takes_no_more_items_and_keeps_those_inside():
    inbox = Inbox()
    inbox.put(item(0))
    inbox.close()
    inbox.put(item(1))
    assert not inbox.is_finished
    assert inbox.get(0.0).can_id == 0
    assert inbox.get(0.0) is None
    assert inbox.is_finished


def test_closing_a_full_inbox_neither_waits_nor_loses_an_item():
    inbox = Inbox(size=2)
    for number in range(2):
        inbox.put(item(number))
    inbox.close()
    inbox.put(item(9))
    assert [inbox.get(0.0).can_id for _ in range(2)] == [0, 1]
    assert inbox.is_finished


def test_a_link_that_waits_is_let_go_when_the_inbox_closes():
    inbox = Inbox(size=1)
    inbox.put(item(0))
    waiting = threading.Thread(target=inbox.put, args=(item(1),))
    waiting.start()
    inbox.close()
    waiting.join(5.0)
    assert not waiting.is_alive()


def test_the_oldest_item_says_since_when_it_waits():
    inbox = Inbox()
    assert inbox.oldest_ns is None
    for number in (5, 6):
        inbox.put(item(number))
    assert inbox.oldest_ns == item(5).t_mono_ns
    inbox.get(0.0)
    inbox.get(0.0)
    assert inbox.oldest_ns is None
    inbox.close()
    assert inbox.oldest_ns is None


def test_an_item_is_recorded_before_it_waits():
    recorded = []
    inbox = Inbox(size=1, record=recorded.append)
    inbox.put(item(0))
    waiting = threading.Thread(target=inbox.put, args=(item(1),))
    waiting.start()
    assert inbox.get(5.0).can_id == 0
    assert inbox.get(5.0).can_id == 1
    waiting.join()
    inbox.close()
    inbox.put(item(2))
    assert [each.can_id for each in recorded] == [0, 1]


def test_what_has_waited_too_long_makes_room_and_is_recorded_all_the_same():
    recorded = []
    inbox = Inbox(size=2, record=recorded.append)
    for seconds in (0, 5, 11, 12):
        inbox.put(CanItem(seconds * 10**9, 0, seconds, b""))
        if seconds == 11:
            assert inbox.get(0.0).can_id == 5
    assert [inbox.get(0.0).can_id for _ in range(2)] == [11, 12]
    assert [each.can_id for each in recorded] == [0, 5, 11, 12]


def test_a_reader_that_stands_still_holds_no_link_up():
    recorded, began_s = [], time.monotonic()
    inbox = Inbox(size=2, record=recorded.append)
    for number in range(100):
        inbox.put(item(number))
    assert time.monotonic() - began_s < 100 * STALL_S / 5
    assert [inbox.get(0.0).can_id for _ in range(2)] == [98, 99]
    assert len(recorded) == 100
