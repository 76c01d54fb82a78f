"""Two nodes that send one CAN id are found and what they say is not believed; a battery that works hard is no such."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from app.sources.dbc.battery_decoder import ChannelValues
from app.sources.dbc.two_senders import FOUND, MOST, TwoSenders
from app.words import render

N_CELLS = 8
OF_TWO = slice(4, 8)  # the cells whose message two nodes send


def feed(watch: TwoSenders, rows: np.ndarray, cells: slice = slice(None)) -> None:
    """(n, m) voltages of some cells, one row after the other, as one batch each."""
    index = np.arange(N_CELLS)[cells]
    for row in rows:
        watch.take(ChannelValues(np.zeros(len(index), np.int64), index, np.asarray(row, float)))


def own(rng: np.random.Generator, n: int) -> np.ndarray:
    return 3.6 + 0.001 * np.arange(N_CELLS) + 0.0012 * rng.standard_normal((n, N_CELLS))


def with_another(rng: np.random.Generator, n: int, lower_v: float) -> np.ndarray:
    rows = own(rng, n)
    rows[1::2, OF_TWO] -= lower_v
    return rows


@given(lower_v=st.floats(0.05, 1.5), seed=st.integers(0, 2**31))
def test_two_senders_are_found_by_the_cells_of_their_message(lower_v, seed):
    watch = TwoSenders(N_CELLS)
    feed(watch, with_another(np.random.default_rng(seed), FOUND + 2, lower_v))
    assert watch.cells.tolist() == [False] * 4 + [True] * 4
    (event,) = watch.events(5)
    assert (event.code, event.cell, event.time_ns) == ("two-senders", 4, 5)
    assert "4 cells" in render(event.message)
    assert watch.events(6) == ()


def test_both_values_are_named():
    watch = TwoSenders(N_CELLS)
    feed(watch, np.array([[3.6], [3.1]] * FOUND), slice(2, 3))
    assert "3.100 V and 3.600 V" in render(watch.events(0)[0].message)


def test_several_frames_of_one_batch_count_like_batches_of_one():
    rows = with_another(np.random.default_rng(1), FOUND + 2, 0.4)
    apart, together = TwoSenders(N_CELLS), TwoSenders(N_CELLS)
    feed(apart, rows)
    index = np.tile(np.arange(N_CELLS), len(rows))
    together.take(ChannelValues(np.zeros(rows.size, np.int64), index, rows.ravel()))
    assert together.cells.tolist() == apart.cells.tolist()


def test_senders_that_swap_their_order_now_and_then_stay_found():
    rng = np.random.default_rng(2)
    watch = TwoSenders(N_CELLS)
    feed(watch, with_another(rng, 2 * MOST, 0.4))
    for _ in range(5):
        feed(watch, with_another(rng, 12, 0.4)[::-1])
        assert watch.cells[OF_TWO].all()
        feed(watch, with_another(rng, 12, 0.4))
        assert watch.cells[OF_TWO].all()


def test_cells_are_believed_again_when_the_other_node_is_silent():
    rng = np.random.default_rng(3)
    watch = TwoSenders(N_CELLS)
    feed(watch, with_another(rng, 100, 0.4))
    feed(watch, own(rng, MOST))
    assert not watch.cells.any()
    feed(watch, with_another(rng, 2 * MOST, 0.4))
    assert len(watch.events(0)) == 1


@given(seed=st.integers(0, 2**31), scale=st.floats(0.001, 0.5))
def test_a_load_that_changes_at_random_is_none(seed, scale):
    rng = np.random.default_rng(seed)
    sag_v = scale * rng.random((200, 1))
    watch = TwoSenders(N_CELLS)
    for row in own(rng, 200) - sag_v * (1 + 0.1 * np.arange(N_CELLS)):
        feed(watch, row[None])
        assert not watch.cells.any()


def test_a_current_that_comes_and_goes_with_each_frame_is_none():
    rng = np.random.default_rng(4)
    rows = own(rng, 100)
    rows[1::2] -= 0.3
    watch = TwoSenders(N_CELLS)
    feed(watch, rows)
    assert not watch.cells.any()


def test_a_missing_value_says_nothing():
    watch = TwoSenders(N_CELLS)
    rows = with_another(np.random.default_rng(5), FOUND + 2, 0.4)
    feed(watch, np.repeat(rows, 2, axis=0) * np.tile([[1.0], [np.nan]], (len(rows), 1)))
    assert watch.cells.tolist() == [False] * 4 + [True] * 4
