from collections import Counter

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from app.sessions.recording.waiting_rows import ROW_BYTES, START, STOP, WaitingRows

LIMIT = 20 * ROW_BYTES

rows = st.one_of(
    st.builds(lambda raw: ("frames", (1, 2, 3, 1, raw)), st.binary(max_size=2 * ROW_BYTES)),
    st.builds(lambda text: ("markers", (1, 2, "note", text, None)), st.text(max_size=100)),
    st.just(("clock", (1, 2, None))),
)
steps = st.lists(st.one_of(rows, st.just("take"), st.integers(0, 30)))


@given(steps)
def test_rows_leave_in_the_order_in_which_they_came_and_memory_stays_within_its_limit(steps):
    queue = WaitingRows(LIMIT)
    came, left, lost = [], [], Counter()
    for step in steps:
        if step == "take":
            queue.take()
        elif isinstance(step, int):
            written = queue.begin(max(step, 1))
            left += written
            queue.finish(len(written))
        else:
            came.append(step)
            lost += queue.offer(step)
        assert queue.bytes <= LIMIT
        assert queue.items == len(came) - len(left) - lost.total()
        assert queue.lost == queue.unreported == lost.total()
    queue.take()
    left += queue.batch
    assert Counter(table for table, _ in came) - Counter(table for table, _ in left) == +lost
    rest = iter(came)
    assert all(any(row is each for each in rest) for row in left), "in their order"
    queue.finish(len(queue.batch))
    assert queue.bytes == queue.items == 0


def frame(number):
    return ("frames", (number, 2, 3, 1, b""))


def estimate(number):
    return ("estimates", (number, 2, np.zeros(2), np.zeros(2)))


def test_where_there_is_no_room_the_oldest_is_left_out_estimates_first():
    queue = WaitingRows(8 * ROW_BYTES)
    for number in range(8):
        queue.offer(frame(number))
    assert queue.offer(frame(8)) == {"frames": 1}
    queue.take()
    assert queue.batch == [frame(number) for number in range(1, 9)]
    queue = WaitingRows(8 * ROW_BYTES)
    for number in range(3):
        queue.offer(frame(number))
        queue.offer(estimate(number))
    assert queue.offer(frame(3)) == {}
    assert queue.offer(frame(4))["frames"] == 0
    queue.take()
    assert [row for row in queue.batch if row[0] == "frames"] == [frame(number) for number in range(5)]


def test_what_a_commit_is_writing_is_not_left_out():
    queue = WaitingRows(4 * ROW_BYTES)
    for number in range(4):
        queue.offer(frame(number))
    queue.take()
    assert queue.begin(2) == [frame(0), frame(1)]
    queue.offer(frame(4))
    queue.finish(2)
    queue.take()
    assert queue.batch == [frame(3), frame(4)]


def test_a_sessions_start_and_end_and_its_events_are_never_left_out():
    event = ("markers", (1, 2, "note", "", None))
    queue = WaitingRows(2 * ROW_BYTES)
    queue.append((START, ("first",)))
    queue.append((STOP, (1, 2, True)))
    assert queue.offer(event) == {"markers": 1}, "there is nothing else that could be"
    queue.take()
    assert queue.batch == [(START, ("first",)), (STOP, (1, 2, True))]
    assert queue.unreported == 1
    queue.finish(2, reported=1)
    assert queue.unreported == 0
    assert queue.offer(event) == {}


def test_a_loss_of_the_session_before_is_not_counted_as_this_ones():
    queue = WaitingRows(4 * ROW_BYTES)
    queue.offer(frame(0))
    queue.append((STOP, (1, 2, True)))
    queue.append((START, ("next",)))
    queue.offer(frame(1))
    assert queue.offer(frame(2)) == {}
    assert queue.offer(frame(3)) == {"frames": 1}


def test_rows_of_one_session_end_where_another_begins():
    queue = WaitingRows(LIMIT)
    clock = ("clock", (1, 2, None))
    for row in (clock, clock, (START, ("next",)), clock):
        queue.append(row)
    assert queue.n_of_session == 0
    assert queue.oldest == [clock]
    queue.take()
    assert queue.n_of_session == 2
    queue.append(clock)
    queue.finish(3)
    assert queue.n_of_session == 1
    assert queue.oldest == [clock, clock]
