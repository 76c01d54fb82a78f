"""What is left out goes by the recorder's delay where the processor is short, and comes back slower than it went."""

import pytest

from app.live.load import (
    BOUND_S,
    EASIER_S,
    GIVE_WAY_S,
    HARDER_S,
    LATE_S,
    MOST_EASIER_S,
    PAUSE_S,
    SMOOTHED_S,
    WELL_S,
    Load,
    Shed,
)
from app.words import render
from tests.fake_clock import FakeClock

LATE = LATE_S + 0.01  # items wait: the processor is short


@pytest.fixture
def clock():
    return FakeClock()


@pytest.fixture
def recorder():
    return {"delay_s": None}


@pytest.fixture
def waits():
    return []


@pytest.fixture
def load(recorder, clock, waits):
    made = Load(lambda: recorder["delay_s"], clock, waits.append, waits.append)
    clock.advance(EASIER_S)
    return made


def test_nothing_is_left_out_while_frames_reach_the_disk_in_time(load, recorder, clock):
    for delay_s in (None, 0.0, 0.31, BOUND_S):
        recorder["delay_s"] = delay_s
        clock.advance(EASIER_S)
        assert load.now(LATE) is Shed.NOTHING
    assert load.problem is None


def test_a_disk_that_takes_nothing_leaves_out_nothing_where_the_processor_is_not_short(load, recorder, clock, waits):
    recorder["delay_s"] = 600.0
    for _ in range(100):
        clock.advance(HARDER_S)
        assert load.now(0.01) is Shed.NOTHING
        load.give_way(0.003)
    assert waits == []
    assert load.problem is None


def test_one_late_item_is_no_lack_of_processor(load, recorder, clock):
    recorder["delay_s"] = 600.0
    for waited_s in (0.01, 0.3, *[0.01] * 50):
        clock.advance(SMOOTHED_S / 10)
        assert load.now(waited_s) is Shed.NOTHING


def test_a_disk_that_stalls_ends_what_was_left_out_before(load, recorder, clock):
    recorder["delay_s"] = 3.0
    assert load.now(LATE) is Shed.PREDICTION
    recorder["delay_s"] = None  # the recorder knows that the disk takes nothing
    clock.advance(EASIER_S)
    assert load.now(0.0) is Shed.NOTHING


def test_the_order_is_predictions_pages_and_back(load, recorder, clock):
    recorder["delay_s"] = BOUND_S + 0.01
    found = []
    for _ in range(3):
        found.append(load.now(LATE))
        clock.advance(HARDER_S)
    assert found == [Shed.PREDICTION, Shed.PAGES, Shed.PAGES]
    recorder["delay_s"] = WELL_S - 0.01
    found = []
    for _ in range(3):
        clock.advance(EASIER_S)
        found.append(load.now(0.0))
    assert found == [Shed.PREDICTION, Shed.NOTHING, Shed.NOTHING]


def test_a_step_has_time_to_help_before_the_next(load, recorder, clock):
    recorder["delay_s"] = 3.0
    assert load.now(LATE) is Shed.PREDICTION
    clock.advance(HARDER_S / 2)
    assert load.now(LATE) is Shed.PREDICTION


def test_between_the_two_bounds_it_stays_as_it_is(load, recorder, clock):
    recorder["delay_s"] = BOUND_S + 0.01
    assert load.now(LATE) is Shed.PREDICTION
    recorder["delay_s"] = (BOUND_S + WELL_S) / 2
    clock.advance(10 * EASIER_S)
    assert load.now(LATE) is Shed.PREDICTION


def test_what_was_taken_back_too_early_stays_left_out_longer_each_time(load, recorder, clock):
    took_s = []
    for _ in range(6):
        clock.advance(HARDER_S)
        recorder["delay_s"] = BOUND_S + 0.01
        assert load.now(LATE) is Shed.PREDICTION
        recorder["delay_s"], began_s = 0.0, clock.monotonic_s()
        while load.now(0.0) is Shed.PREDICTION:
            clock.advance(1.0)
        took_s.append(clock.monotonic_s() - began_s)
    assert took_s == [EASIER_S, 2 * EASIER_S, 4 * EASIER_S, 8 * EASIER_S, MOST_EASIER_S, MOST_EASIER_S]


def test_it_forgets_that_once_it_went_well_for_long(load, recorder, clock):
    for _ in range(3):
        recorder["delay_s"] = BOUND_S + 0.01
        load.now(LATE)
        recorder["delay_s"] = 0.0
        clock.advance(MOST_EASIER_S)
        assert load.now(0.0) is Shed.NOTHING
    clock.advance(MOST_EASIER_S)
    recorder["delay_s"] = BOUND_S + 0.01
    load.now(LATE)
    recorder["delay_s"] = 0.0
    clock.advance(EASIER_S)
    assert load.now(0.0) is Shed.NOTHING


def test_recording_goes_first_only_where_something_is_left_out(load, recorder, waits):
    load.now(LATE)
    load.give_way(0.003)
    assert waits == []
    recorder["delay_s"] = 3.0
    load.now(LATE)
    load.give_way(0.003)
    load.give_way(60.0)
    assert waits == [GIVE_WAY_S, 0.003, GIVE_WAY_S, PAUSE_S], "half of the time, and bounded"


def test_while_the_processor_is_short_nothing_is_taken_back(load, recorder, clock):
    recorder["delay_s"] = 3.0
    assert load.now(LATE) is Shed.PREDICTION
    recorder["delay_s"] = 0.2
    for _ in range(100):
        clock.advance(EASIER_S)
        assert load.now(LATE) is Shed.PREDICTION
    clock.advance(EASIER_S)
    assert load.now(0.0) is Shed.NOTHING


def test_it_says_what_is_left_out_and_why(load, recorder, clock):
    recorder["delay_s"] = 0.62
    codes = []
    for _ in range(2):
        load.now(LATE)
        clock.advance(HARDER_S)
        codes.append(load.problem.code)
        assert "0.62" in render(load.problem)
    assert codes == ["shed-prediction", "shed-pages"]
