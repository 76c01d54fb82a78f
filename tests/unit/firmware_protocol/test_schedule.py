from itertools import pairwise

import pytest

from firmware_protocol import schedule
from firmware_protocol.framing import encode_frame
from firmware_protocol.memory_map import FIELDS, MASTER_SIZE
from firmware_protocol.messages import Data, MessageType, Window
from firmware_protocol.schedule import FAST_WINDOWS, SLOW_RANGES, StreamSchedule


def run(ts_s, duration_s):
    """Return (start, windows) of each frame on a line that is asked whenever it is free."""
    plan, now_s, sent = StreamSchedule(ts_s, 0.0), 0.0, []
    while (now_s := plan.due_s(now_s)) < duration_s:
        windows = plan.take(now_s)
        assert windows is not None
        sent.append((now_s, windows))
        now_s += schedule.data_frame_time_s(windows)
    return sent


def fast_starts(sent):
    return [start for start, windows in sent if windows == FAST_WINDOWS]


def slow_spans(sent):
    return [(start, windows[0]) for start, windows in sent if windows != FAST_WINDOWS]


def test_the_stream_carries_every_field_once():
    carried = [False] * MASTER_SIZE
    for offset, length in FAST_WINDOWS + SLOW_RANGES:
        assert not any(carried[offset : offset + length])
        carried[offset : offset + length] = [True] * length
    for field in FIELDS.values():
        assert all(carried[field.offset : field.end]), field.name


@pytest.mark.parametrize("ts_s", [0.02, 0.04, 0.047, 0.05, 0.1, 1.0])
def test_pieces_split_no_number_and_stay_short(ts_s):
    pieces = {span for _, span in slow_spans(run(ts_s, 20))}
    edges = {edge for offset, length in pieces for edge in (offset, offset + length)}
    for field in FIELDS.values():
        assert all((edge - field.offset) % field.item_size == 0 for edge in edges if field.offset < edge < field.end)
    assert max(length for _, length in pieces) <= 200


@pytest.mark.parametrize("fill", [0, 0xAA])
def test_frame_bytes_is_never_exceeded(fill):
    for windows in (FAST_WINDOWS, ((0, 200),), ((0, 1),)):
        body = Data(tuple(Window(o, bytes([fill]) * n) for o, n in windows)).to_body()
        frame = encode_frame(MessageType.DATA, 0xAA, 0xAAAAAAAA, body)
        assert len(frame) <= schedule.frame_bytes(len(body)) <= len(frame) + 2
        assert schedule.data_frame_time_s(windows) == pytest.approx(schedule.frame_bytes(len(body)) * 11 / 115_200)


@pytest.mark.parametrize("ts_s", [0.04, 0.05, 0.1, 0.5])
def test_fast_set_leaves_every_ts_whatever_the_slow_ones_do(ts_s):
    starts = fast_starts(run(ts_s, 10.5 * ts_s))
    assert starts == pytest.approx([ts_s * i for i in range(11)])


@pytest.mark.parametrize("ts_s", [0.05, 0.1])
def test_slow_ranges_go_round_whole_and_in_order_once_a_second(ts_s):
    pieces = slow_spans(run(ts_s, 6.5))
    turns = [i for i, (_, (offset, _)) in enumerate(pieces) if offset == 0]
    assert len(turns) >= 5
    for a, b in pairwise(turns):
        assert pieces[b][0] - pieces[a][0] == pytest.approx(1.0, abs=0.3)
        assert pieces[b][0] - pieces[a][0] > 1.0 - 1e-9
        covered = [position for _, (offset, length) in pieces[a:b] for position in range(offset, offset + length)]
        assert covered == [position for offset, length in SLOW_RANGES for position in range(offset, offset + length)]


def test_where_ts_asks_for_more_than_the_line_frames_follow_back_to_back():
    for (start, windows), (following, _) in pairwise(run(0.02, 5)):
        assert following == pytest.approx(start + schedule.data_frame_time_s(windows))


def test_slow_ranges_do_not_starve():
    sent = run(0.02, 20)
    assert sum(length for _, (_, length) in slow_spans(sent)) >= sum(length for _, length in SLOW_RANGES)
    assert len(fast_starts(sent)) / 20 > 27


def test_a_line_that_was_late_is_not_flooded_afterwards():
    plan = StreamSchedule(0.1, 0.0)
    assert plan.take(0.0) == FAST_WINDOWS
    assert plan.take(0.73) == FAST_WINDOWS
    assert plan.take(0.73) == FAST_WINDOWS
    assert plan.take(0.75) != FAST_WINDOWS


@pytest.mark.parametrize(("body", "line"), [(0, 11), (246, 257), (247, 259), (248, 260), (512, 525)])
def test_the_most_bytes_of_a_frame_on_the_line(body, line):
    assert schedule.frame_bytes(body) == line


def test_times_on_the_line():
    assert schedule.frame_time_s(1152) == pytest.approx(0.11)
    assert schedule.data_frame_time_s(((0, 100), (200, 50))) == pytest.approx(schedule.frame_time_s(11 + 158))


def test_a_schedule_starts_with_the_fast_set_wherever_its_clock_stands():
    plan = StreamSchedule(0.1, 1000.0)
    assert plan.due_s(999.0) == 1000.0
    assert plan.take(999.0) is None
    assert plan.take(1000.0) == FAST_WINDOWS
    assert plan.take(1000.0) == ((0, 200),)


def test_a_piece_is_cut_to_what_the_line_has_left():
    plan = StreamSchedule(0.1, 0.0)
    assert plan.take(0.0) == FAST_WINDOWS
    # 0.0061 s before the next fast frame are 63 bytes: 15 of overhead, 48 of data
    assert plan.take(0.1 - 0.0061) == ((0, 48),)
    assert plan.take(0.1 - 0.0046) == ((48, 32),), "32 bytes are worthwhile"
    assert plan.take(0.1 - 0.0044) is None, "fewer are not"
    assert plan.due_s(0.1 - 0.0044) == pytest.approx(0.1)


def test_the_end_of_a_range_is_sent_however_short():
    plan = StreamSchedule(10.0, 0.0)
    plan.take(0.0)
    assert [plan.take(0.1), plan.take(0.2)] == [((0, 200),), ((200, 200),)]
    assert plan.take(10.0 - 0.0034) == ((400, 20),)


def test_a_slow_piece_follows_twenty_fast_frames_where_ts_leaves_no_room():
    plan, frames = StreamSchedule(0.001, 0.0), []
    for i in range(43):
        frames.append(plan.take(0.05 * i) == FAST_WINDOWS)
    assert [i for i, is_fast in enumerate(frames) if not is_fast] == [20, 41]


def test_nothing_is_due_once_the_turn_is_done():
    plan, now_s = StreamSchedule(10.0, 0.0), 0.0
    while (windows := plan.take(now_s)) is not None:
        now_s += schedule.data_frame_time_s(windows)
    assert now_s < 0.5
    assert plan.due_s(now_s) == pytest.approx(1.0, abs=0.1)
