"""What is left out goes by the recorder's delay where the processor is short, and comes back slower than it went."""

import pytest

from app.live.load_shedding import (
    BOUND_S,
    DELAY_OK_S,
    LATE_S,
    PAUSE_S,
    SHED_AFTER_S,
    SMOOTHED_S,
    STEP_DOWN_S,
    STEP_UP_MAX_S,
    STEP_UP_S,
    LoadShedding,
    ShedLoad,
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
    made = LoadShedding(lambda: recorder["delay_s"], clock, waits.append, waits.append)
    clock.advance(STEP_UP_S)
    return made


def test_nothing_is_left_out_while_frames_reach_the_disk_in_time(load, recorder, clock):
    for delay_s in (None, 0.0, 0.31, BOUND_S):
        recorder["delay_s"] = delay_s
        clock.advance(STEP_UP_S)
        assert load.now(LATE) is ShedLoad.NOTHING
    assert load.problem is None


def test_a_disk_that_takes_nothing_leaves_out_nothing_where_the_processor_is_not_short(load, recorder, clock, waits):
    recorder["delay_s"] = 600.0
    for _ in range(100):
        clock.advance(STEP_DOWN_S)
        assert load.now(0.01) is ShedLoad.NOTHING
        load.shed(0.003)
    assert waits == []
    assert load.problem is None


def test_one_late_item_is_no_lack_of_processor(load, recorder, clock):
    recorder["delay_s"] = 600.0
    for waited_s in (0.01, 0.3, *[0.01] * 50):
        clock.advance(SMOOTHED_S / 10)
        assert load.now(waited_s) is ShedLoad.NOTHING


def test_a_disk_that_stalls_ends_what_was_left_out_before(load, recorder, clock):
    recorder["delay_s"] = 3.0
    assert load.now(LATE) is ShedLoad.PREDICTION
    recorder["delay_s"] = None  # the recorder knows that the disk takes nothing
    clock.advance(STEP_UP_S)
    assert load.now(0.0) is ShedLoad.NOTHING


def test_the_order_is_predictions_pages_and_back(load, recorder, clock):
    recorder["delay_s"] = BOUND_S + 0.01
    found = []
    for _ in range(3):
        found.append(load.now(LATE))
        clock.advance(STEP_DOWN_S)
    assert found == [ShedLoad.PREDICTION, ShedLoad.PAGES, ShedLoad.PAGES]
    recorder["delay_s"] = DELAY_OK_S - 0.01
    found = []
    for _ in range(3):
        clock.advance(STEP_UP_S)
        found.append(load.now(0.0))
    assert found == [ShedLoad.PREDICTION, ShedLoad.NOTHING, ShedLoad.NOTHING]


def test_a_step_has_time_to_help_before_the_next(load, recorder, clock):
    recorder["delay_s"] = 3.0
    assert load.now(LATE) is ShedLoad.PREDICTION
    clock.advance(STEP_DOWN_S / 2)
    assert load.now(LATE) is ShedLoad.PREDICTION


def test_between_the_two_bounds_it_stays_as_it_is(load, recorder, clock):
    recorder["delay_s"] = BOUND_S + 0.01
    assert load.now(LATE) is ShedLoad.PREDICTION
    recorder["delay_s"] = (BOUND_S + DELAY_OK_S) / 2
    clock.advance(10 * STEP_UP_S)
    assert load.now(LATE) is ShedLoad.PREDICTION


def test_what_was_taken_back_too_early_stays_left_out_longer_each_time(load, recorder, clock):
    took_s = []
    for _ in range(6):
        clock.advance(STEP_DOWN_S)
        recorder["delay_s"] = BOUND_S + 0.01
        assert load.now(LATE) is ShedLoad.PREDICTION
        recorder["delay_s"], began_s = 0.0, clock.monotonic_s()
        while load.now(0.0) is ShedLoad.PREDICTION:
            clock.advance(1.0)
        took_s.append(clock.monotonic_s() - began_s)
    assert took_s == [STEP_UP_S, 2 * STEP_UP_S, 4 * STEP_UP_S, 8 * STEP_UP_S, STEP_UP_MAX_S, STEP_UP_MAX_S]


def test_it_forgets_that_once_it_went_well_for_long(load, recorder, clock):
    for _ in range(3):
        recorder["delay_s"] = BOUND_S + 0.01
        load.now(LATE)
        recorder["delay_s"] = 0.0
        clock.advance(STEP_UP_MAX_S)
        assert load.now(0.0) is ShedLoad.NOTHING
    clock.advance(STEP_UP_MAX_S)
    recorder["delay_s"] = BOUND_S + 0.01
    load.now(LATE)
    recorder["delay_s"] = 0.0
    clock.advance(STEP_UP_S)
    assert load.now(0.0) is ShedLoad.NOTHING


def test_recording_goes_first_only_where_something_is_left_out(load, recorder, waits):
    load.now(LATE)
    load.shed(0.003)
    assert waits == []
    recorder["delay_s"] = 3.0
    load.now(LATE)
    load.shed(0.003)
    load.shed(60.0)
    assert waits == [SHED_AFTER_S, 0.003, SHED_AFTER_S, PAUSE_S], "half of the time, and bounded"


def test_while_the_processor_is_short_nothing_is_taken_back(load, recorder, clock):
    recorder["delay_s"] = 3.0
    assert load.now(LATE) is ShedLoad.PREDICTION
    recorder["delay_s"] = 0.2
    for _ in range(100):
        clock.advance(STEP_UP_S)
        assert load.now(LATE) is ShedLoad.PREDICTION
    clock.advance(STEP_UP_S)
    assert load.now(0.0) is ShedLoad.NOTHING


def test_it_says_what_is_left_out_and_why(load, recorder, clock):
    recorder["delay_s"] = 0.62
    codes = []
    for _ in range(2):
        load.now(LATE)
        clock.advance(STEP_DOWN_S)
        codes.append(load.problem.code)
        assert "0.62" in render(load.problem)
    assert codes == ["shed-prediction", "shed-pages"]
