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
    came, left, lost = [], [], 0
    for step in steps:
        if step == "take":
            queue.take()
        elif isinstance(step, int):
            left += queue.batch[:step]
            queue.finish(step)
        elif queue.offer(step):
            came.append(step)
        else:
            lost += 1
        assert queue.bytes <= LIMIT
        assert (queue.taken, queue.done, queue.lost) == (len(came), len(left), lost)
        assert queue.items == len(came) - len(left)
    queue.take()
    assert left + queue.batch == came
    queue.finish(len(queue.batch))
    assert queue.bytes == queue.items == 0


def test_what_is_never_dropped_waits_in_a_full_queue_too():
    queue = WaitingRows(ROW_BYTES)
    clock = ("clock", (1, 2, None))
    assert queue.offer(clock)
    assert not queue.offer(clock)
    queue.append((STOP, (1, 2, True)))
    queue.take()
    assert queue.batch == [clock, (STOP, (1, 2, True))]
    assert queue.unreported == 1
    queue.finish(2, reported=1)
    assert queue.unreported == 0
    assert queue.offer(clock)


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
