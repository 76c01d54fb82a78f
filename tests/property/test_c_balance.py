"""The choice of the cells to bleed, in C."""

import ctypes
from ctypes import byref, c_uint8, c_uint16, c_uint32

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.c_programs import slaves_library
from tests.c_slaves import Balance, cells_of, load
from tests.campaign import examples

UNDEFINED = ("-fsanitize=undefined", "-fno-sanitize-recover=all")


@pytest.fixture(scope="module")
def library() -> ctypes.CDLL:
    return load(slaves_library(*UNDEFINED))


def masks(cells):
    return [sum(1 << at for at in np.flatnonzero(row)) for row in np.reshape(cells, (8, 12))]


def test_cells_chosen_by_hand_are_bled_until_their_time_is_over_or_they_are_low(library):
    c, v = Balance(), (c_uint16 * 96)(*[36_000] * 96)
    library.vw_balance_init(byref(c))
    by_hand, watch = library.vw_balance_set_manual, library.vw_balance_end_manual
    begin_ms = 0xFFFFFFFF - 1000  # the clock goes round meanwhile
    by_hand(byref(c), c_uint8(1), c_uint16(0x801), c_uint32(begin_ms))
    by_hand(byref(c), c_uint8(7), c_uint16(0x002), c_uint32(begin_ms))
    by_hand(byref(c), c_uint8(8), c_uint16(0x002), c_uint32(begin_ms))  # there is no such pack
    assert np.flatnonzero(cells_of(c.cells)).tolist() == [12, 23, 85]
    v[23] = 30_000
    watch(byref(c), c_uint16(30_000), v, c_uint32(begin_ms + 599_999 & 0xFFFFFFFF))
    assert np.flatnonzero(cells_of(c.cells)).tolist() == [12, 85]
    watch(byref(c), c_uint16(30_000), v, c_uint32(begin_ms + 600_000 & 0xFFFFFFFF))
    assert (list(c.cells), c.is_active, c.is_by_hand) == ([0] * 8, False, False)


@settings(max_examples=examples(100), deadline=None)
@given(
    voltages=st.lists(st.sampled_from((0, 1, 30_000, 65_535)) | st.integers(35_900, 36_300), min_size=96, max_size=96),
    bled=st.frozensets(st.integers(0, 95)),
    threshold=st.integers(0, 1000),
)
def test_by_rule_a_cell_is_bled_that_is_far_above_the_lowest_until_it_is_near(library, voltages, bled, threshold):
    v, before = np.array(voltages), np.isin(np.arange(96), [*bled])
    c = Balance(cells=(c_uint16 * 8)(*masks(before)), is_active=bool(bled))
    is_active = library.vw_balance_choose(byref(c), c_uint16(threshold), (c_uint16 * 96)(*voltages))
    above = v - min(v[v > 0], default=0)
    chosen = (v > 0) & ((above > threshold) | (before & (above > 0.8 * threshold)))
    assert cells_of(c.cells) == chosen.tolist()
    assert is_active == c.is_active == chosen.any()
