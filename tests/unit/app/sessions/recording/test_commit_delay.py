from app.sessions.recording.commit_queue import KEPT_S, MOST_COMMIT_S, CommitDelay, oldest_frame_ns

S = 10**9


def test_the_oldest_frame_counts_and_nothing_else():
    rows = [("clock", (1, 2, None)), ("can_frames", (5 * S, 0, 1, b"")), ("frames", (6 * S, 0, 0, 1, b""))]
    assert oldest_frame_ns(rows) == 5 * S
    assert oldest_frame_ns(rows[:1]) is None


def test_before_the_first_frame_there_is_no_delay():
    delay = CommitDelay()
    delay.committed(None, 5 * S, 0.01)
    assert delay.longest_s is None
    assert delay.now_s(None, 5 * S) is None


def test_the_longest_of_a_minute_is_kept_and_then_forgotten():
    delay = CommitDelay()
    delay.committed(0, 2 * S, 0.01)
    delay.committed(2 * S, 2 * S + S // 4, 0.01)
    assert (delay.longest_s, delay.now_s(None, 3 * S)) == (2.0, 0.25)
    later = round((KEPT_S + 3) * S)
    delay.committed(later - S // 2, later, 0.01)
    assert delay.longest_s == 0.5


def test_a_frame_that_waits_counts_before_it_is_committed():
    delay = CommitDelay()
    delay.committed(0, S // 4, 0.01)
    assert delay.now_s(S, 4 * S) == 3.0


def test_a_long_commit_is_remembered_for_the_next_ones_and_bounded():
    delay = CommitDelay()
    delay.committed(0, S, 0.1)
    delay.committed(0, S, 0.01)
    assert 0.05 < delay.commit_s < 0.1
    delay.committed(0, S, 9.0)
    assert delay.commit_s == MOST_COMMIT_S
