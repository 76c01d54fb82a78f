"""The stream of the C library: what it sends when, on a line that is looked at each millisecond."""

import subprocess
from functools import cache
from itertools import pairwise

import pytest

from firmware_protocol import schedule
from firmware_protocol.framing import encode_frame
from firmware_protocol.memory_map import FIELDS, MASTER_SIZE
from firmware_protocol.messages import Data, MessageType, Window
from firmware_protocol.schedule import ALIGNMENT, FAST_WINDOWS, SLOW_LENGTH, SLOW_LENGTH_WORTHWHILE, SLOW_RANGES
from tests.c_programs import build_program


@cache
def run(ts_ms, n=900):
    """Return (start [ms], windows) of n frames."""
    command = [build_program("host_test"), "driver"]
    line = f"stream {ts_ms} {n}\n"
    answer = subprocess.run(command, input=line, capture_output=True, text=True, check=True).stdout
    frames = [frame.partition(":") for frame in answer.split()]
    return [(int(ms), tuple(tuple(map(int, w.split("+"))) for w in windows.split(","))) for ms, _, windows in frames]


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


@pytest.mark.parametrize("ts_ms", [20, 40, 47, 50, 100, 1000])
def test_pieces_split_no_number_and_are_neither_long_nor_shorter_than_worthwhile(ts_ms):
    sent = run(ts_ms)
    assert sent[0] == (0, FAST_WINDOWS)
    pieces = {span for _, span in slow_spans(sent)}
    edges = {edge for offset, length in pieces for edge in (offset, offset + length)}
    for field in FIELDS.values():
        assert all((edge - field.offset) % field.item_size == 0 for edge in edges if field.offset < edge < field.end)
    ends = {offset + length for offset, length in SLOW_RANGES}
    for offset, length in pieces:
        assert length <= SLOW_LENGTH
        assert offset + length in ends or (length >= SLOW_LENGTH_WORTHWHILE and length % ALIGNMENT == 0)


@pytest.mark.parametrize("fill", [0, 0xAA])
def test_frame_bytes_is_never_exceeded(fill):
    for windows in (FAST_WINDOWS, ((0, 200),), ((0, 1),)):
        body = Data(tuple(Window(o, bytes([fill]) * n) for o, n in windows)).to_body()
        frame = encode_frame(MessageType.DATA, 0xAA, 0xAAAAAAAA, body)
        assert len(frame) <= schedule.frame_bytes(len(body)) <= len(frame) + 2
        assert schedule.data_frame_time_s(windows) == pytest.approx(schedule.frame_bytes(len(body)) * 11 / 115_200)


@pytest.mark.parametrize("ts_ms", [50, 100, 500])
def test_fast_set_leaves_every_ts_whatever_the_slow_ones_do(ts_ms):
    starts = fast_starts(run(ts_ms))
    assert max(abs(start - ts_ms * i) for i, start in enumerate(starts)) <= 1, "the line is free within the ms"


@pytest.mark.parametrize("ts_ms", [50, 100])
def test_slow_ranges_go_round_whole_and_in_order_once_a_second(ts_ms):
    pieces = slow_spans(run(ts_ms))
    turns = [i for i, (_, (offset, _)) in enumerate(pieces) if offset == 0]
    assert len(turns) >= 5
    for a, b in pairwise(turns):
        assert 1000 <= pieces[b][0] - pieces[a][0] <= 1300
        covered = [position for _, (offset, length) in pieces[a:b] for position in range(offset, offset + length)]
        assert covered == [position for offset, length in SLOW_RANGES for position in range(offset, offset + length)]


def test_where_ts_asks_for_more_than_the_line_frames_follow_back_to_back_and_slow_ones_do_not_starve():
    sent = run(20)
    for (start, windows), (following, _) in pairwise(sent):
        assert 0 <= following - start - 1000 * schedule.data_frame_time_s(windows) <= 2
    places = [i for i, (_, windows) in enumerate(sent) if windows != FAST_WINDOWS]
    assert {b - a for a, b in pairwise(places)} == {21}, "one piece follows twenty fast frames"


def test_nothing_is_sent_once_the_turn_is_done():
    pieces = slow_spans(run(10_000, 120))
    ends = [start for start, (offset, length) in pieces if offset + length == sum(SLOW_RANGES[-1])]
    starts = [start for start, (offset, _) in pieces if offset == 0]
    assert all(end - start < 500 for start, end in zip(starts, ends, strict=False))


@pytest.mark.parametrize(("body", "line"), [(0, 11), (246, 257), (247, 259), (248, 260), (512, 525)])
def test_the_most_bytes_of_a_frame_on_the_line(body, line):
    assert schedule.frame_bytes(body) == line


def test_times_on_the_line():
    assert schedule.frame_time_s(1152) == pytest.approx(0.11)
    assert schedule.data_frame_time_s(((0, 100), (200, 50))) == pytest.approx(schedule.frame_time_s(11 + 158))
