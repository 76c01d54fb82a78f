import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.sessions.export.csv_file import texts_of

COUNTS = st.lists(st.none() | st.integers(-(1 << 31), 1 << 32) | st.integers(30_000, 42_000), min_size=2, max_size=40)


@given(COUNTS, st.sampled_from([(1.0, 0), (1e-4, 4), (0.01, 2), (2e-5, 5), (0.025, 2), (0.1, 1), (60.0, 0)]))
def test_every_count_is_written_as_it_would_be_alone(counts: list[int | None], scale: tuple[float, int]) -> None:
    factor, decimals = scale
    values = np.array([np.nan if count is None else count * factor for count in counts])[:, None]
    found = texts_of(np.hstack([values, values[::-1]]), factor)
    texts = [row.tobytes().replace(b"\0", b"").decode() for row in found]
    alone = ["," if count is None else f",{count * factor:.{decimals}f}" for count in counts]
    assert texts == [first + second for first, second in zip(alone, alone[::-1], strict=True)]


def test_values_that_were_never_measured_are_empty() -> None:
    found = texts_of(np.full((3, 2), np.nan), 1e-4)
    assert [row.tobytes().replace(b"\0", b"") for row in found] == [b",,"] * 3


@pytest.mark.parametrize("spread", [10, 1 << 21])
def test_counts_that_lie_close_or_far_apart_read_the_same(spread: int) -> None:
    found = texts_of(np.array([[0.0, float(spread)], [float(spread), 0.0]]), 1.0)
    assert [row.tobytes().replace(b"\0", b"").decode() for row in found] == [f",0,{spread}", f",{spread},0"]
