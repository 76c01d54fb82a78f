import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.estimation.errors import ShapeError
from app.estimation.health.packs import Packs

SIZES = st.lists(st.integers(1, 30), min_size=1, max_size=12).map(tuple)


@st.composite
def measured(draw):
    """Segments of any sizes, and a value of each cell, some missing."""
    sizes = draw(SIZES)
    values = draw(st.lists(st.floats(-10, 10) | st.just(float("nan")), min_size=sum(sizes), max_size=sum(sizes)))
    return sizes, np.array(values)


@given(measured())
def test_a_table_holds_every_cell_in_its_segments_row(battery):
    sizes, values = battery
    segments = Packs(sizes)
    table = segments.table(values)
    assert table.shape == (len(sizes), max(sizes))
    assert np.array_equal(segments.flat(table), values, equal_nan=True)
    for row, size in zip(table, sizes, strict=True):
        assert np.isnan(row[size:]).all()


@given(measured())
def test_the_median_of_a_cell_is_that_of_its_segment(battery):
    sizes, values = battery
    found, at = Packs(sizes).median(values), 0
    for size in sizes:
        mine = values[at : at + size]
        expected = np.nanmedian(mine) if np.isfinite(mine).any() else np.nan
        assert found[at : at + size] == pytest.approx(np.full(size, expected), abs=1e-12, nan_ok=True)
        at += size


@given(measured(), st.floats(0, 0.99))
def test_the_share_of_a_segment_counts_its_own_cells_only(battery, share):
    sizes, values = battery
    known, at = np.isfinite(values), 0
    found = Packs(sizes).has_more_than(share, known)
    for size in sizes:
        assert (found[at : at + size] == (known[at : at + size].sum() > share * size)).all()
        at += size


def test_neighbours_are_the_other_cells_of_the_segment():
    segments = Packs((3, 1, 2))
    assert [segments.neighbours(cell) for cell in range(6)] == [(1, 2), (0, 2), (0, 1), (), (5,), (4,)]


@pytest.mark.parametrize("sizes", [(), (4, 0), (-3, 5)])
def test_a_segment_without_a_cell_is_refused(sizes):
    with pytest.raises(ShapeError, match="packs"):
        Packs(sizes)
