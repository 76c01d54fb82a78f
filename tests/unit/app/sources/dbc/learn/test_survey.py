"""What speaks on a bus: rates, ranges, ids that nobody defines."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.frames import frames_of
from app.sources.dbc.learn.survey import Heard, distinct, survey
from tests.peer_messages import HEAD

TEXT = """BO_ 256 Pack: 8 BMS
 SG_ U : 0|16@1+ (0.1,0) [0|0] "V" X
 SG_ I : 16|16@1- (0.1,0) [0|0] "A" X

BO_ 257 Pages: 8 BMS
 SG_ Page M : 0|8@1+ (1,0) [0|3] "" X
 SG_ A m0 : 8|8@1+ (1,0) [0|0] "" X
 SG_ B m1 : 8|8@1+ (1,0) [0|0] "" X
"""
DEFINITIONS = parse_definitions((HEAD + TEXT).encode(), "x.dbc")
PACK, PAGES = DEFINITIONS.messages
S = 1_000_000_000


def surveyed(*frames):
    return survey(DEFINITIONS, frames_of(list(frames)))


def heard(values):
    array = np.array(values, float)
    return Heard(np.arange(len(array)), array, array.astype(np.int64))


def test_a_signal_has_its_range_and_the_times_of_its_frames():
    found = surveyed((1 * S, 256, b"\xa0\x0f\xf6\xff"), (3 * S, 256, b"\x50\x0f\x0a\x00"))
    u, i = found.signal(PACK, "U"), found.signal(PACK, "I")
    assert (u.low, u.high) == pytest.approx((392.0, 400.0))
    assert (i.low, i.high) == pytest.approx((-1.0, 1.0))
    assert i.raw.tolist() == [-10, 10]
    assert u.t_ns.tolist() == [S, 3 * S]


@given(st.integers(2, 50), st.integers(1, 2000))
def test_the_rate_of_a_message_is_frames_a_second(n, period_ms):
    found = surveyed(*((k * period_ms * 1_000_000, 256, bytes(4)) for k in range(n)))
    assert found.of(PACK).rate_hz == pytest.approx(1000 / period_ms)
    assert found.duration_s == pytest.approx((n - 1) * period_ms / 1000)


def test_one_frame_has_no_rate_and_no_duration():
    found = surveyed((5, 256, bytes(4)))
    assert np.isnan(found.of(PACK).rate_hz)
    assert (found.duration_s, found.n_frames) == (0.0, 1)


def test_ids_that_no_message_has_are_counted_apart():
    found = surveyed((0, 0x700, b""), (1, 0x701, b""), (2, 0x700, b"\1"), (3, 256, bytes(4)))
    assert found.unknown == {0x700: 2, 0x701: 1}
    assert list(found.heard) == [256]
    assert found.n_frames == 4


def test_a_29_bit_id_is_not_the_11_bit_one_of_the_same_number():
    found = surveyed((0, 0x80000100, bytes(4)))
    assert found.of(PACK) is None
    assert found.unknown == {0x80000100: 1}


def test_a_signal_under_a_multiplexer_is_heard_in_its_frames_only():
    found = surveyed(*((k, 257, bytes([k % 2, 10 * k])) for k in range(4)))
    assert found.signal(PAGES, "A").values.tolist() == [0, 20]
    assert found.signal(PAGES, "B").values.tolist() == [10, 30]
    assert found.signal(PAGES, "Page").values.tolist() == [0, 1, 0, 1]


def test_what_no_frame_carries_is_not_heard():
    assert surveyed((0, 257, bytes([1, 7]))).signal(PAGES, "A") is None
    assert surveyed((0, 256, bytes(2))).signal(PACK, "I") is None
    assert surveyed((0, 256, bytes(4))).signal(PACK, "Q") is None
    assert surveyed((0, 256, bytes(4))).signal(PAGES, "Page") is None


def test_an_empty_log_is_no_failure():
    found = surveyed()
    assert (found.n_frames, found.duration_s, found.heard, found.unknown) == (0, 0.0, {}, {})


@given(st.lists(st.integers(-50, 50), min_size=1, max_size=40), st.lists(st.integers(-50, 50), max_size=10))
def test_the_distinct_numbers_of_signals_are_sorted_and_each_is_there_once(one, other):
    found = distinct([heard(one), None, *([heard(other)] if other else [])])
    assert found.tolist() == sorted({*one, *other})


def test_numbers_with_a_fraction_number_nothing():
    assert len(distinct([heard([1.0, 2.5])])) == 0
    assert len(distinct([heard(range(5000))])) == 0
    assert len(distinct([None])) == 0
