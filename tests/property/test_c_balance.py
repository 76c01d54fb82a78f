"""The C choice of the cells to bleed against the Python one."""

import ctypes
from ctypes import byref, c_uint8, c_uint16, c_uint32
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_protocol.config_image import default_image
from simulator.charging import Balancer
from simulator.memory import Config
from tests.c_programs import slaves_library
from tests.c_slaves import Balance, cells_of, load
from tests.campaign import examples

UNDEFINED = ("-fsanitize=undefined", "-fno-sanitize-recover=all")
SLAVES = st.integers(0, 7)


@pytest.fixture(scope="module")
def library() -> ctypes.CDLL:
    return load(slaves_library(*UNDEFINED))


VOLTAGES = st.lists(
    st.sampled_from((0, 1, 30_000, 36_000, 36_100, 65_535)) | st.integers(35_900, 36_300), min_size=96, max_size=96
)
CHOICES = st.lists(
    st.one_of(
        st.tuples(st.just("choose"), VOLTAGES),
        st.tuples(st.just("hand"), SLAVES, st.integers(0, 0xFFF)),
        st.tuples(st.just("watch"), VOLTAGES),
        st.tuples(st.just("wait"), st.sampled_from((1, 300, 599, 601))),
        st.tuples(st.just("stop")),
    ),
    max_size=12,
)


def test_cells_chosen_by_hand_are_bled_until_their_time_is_over_or_they_are_low(library):
    c, v = Balance(), (c_uint16 * 96)(*[36_000] * 96)
    library.vw_balance_init(byref(c))
    by_hand, watch = library.vw_balance_by_hand, library.vw_balance_watch
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
@given(choices=CHOICES, threshold=st.integers(0, 1000), begin_s=st.sampled_from((0, 4_294_900)))
def test_the_same_cells_are_bled(library, choices, threshold, begin_s):
    python, c = Balancer(), Balance()
    library.vw_balance_init(byref(c))
    config = replace(Config.from_image(default_image()), balance_threshold=threshold)
    now_s = begin_s
    for what, *values in choices:
        now_ms = c_uint32(now_s * 1000 & 0xFFFFFFFF)
        if what in ("choose", "watch"):
            v = np.array(values[0], dtype=np.uint16)
            raw = (c_uint16 * 96)(*values[0])
        match what:
            case "choose":
                python.choose(config, v)
                assert library.vw_balance_choose(byref(c), c_uint16(threshold), raw) == python.is_active
            case "hand":
                python.choose_by_hand(values[0], values[1], now_s)
                library.vw_balance_by_hand(byref(c), c_uint8(values[0]), c_uint16(values[1]), now_ms)
            case "watch":
                python.watch_by_hand(config, v, now_s)
                library.vw_balance_watch(byref(c), c_uint16(config.v_cell_min), raw, now_ms)
            case "wait":
                now_s += values[0]
            case "stop":
                python.stop()
                library.vw_balance_stop(byref(c))
        assert cells_of(c.cells) == python.cells.tolist()
        assert (c.is_active, c.is_by_hand) == (python.is_active, python.is_by_hand)
