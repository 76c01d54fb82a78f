"""Limits of then judge what happened then."""

import numpy as np
import pytest

from app.analysis.limits import LimitsOverTime, MovingLimit
from app.analysis.report.report import MarginWatch
from app.analysis.survey import SurveyPiece

LIMITS = {"t_cell_max": 45.0, "v_cell_min": 2.5, "v_cell_max": 4.2, "i_disc_max": 200.0, "i_disc_min": -100.0}


def piece(time_s, degc):
    rows = len(time_s)
    table = np.full((rows, 3), 3.7)
    return SurveyPiece(
        np.array(time_s, dtype=float),
        np.full(rows, 20.0),
        table,
        np.array(degc, dtype=float)[:, None] + np.array([0.0, 0.0, 1.0]),
        table * 0.1,
        table * 0.0,
    )


def of(watch, name):
    return next(each for each in watch.nearest() if each.limit == name)


def test_a_limit_raised_afterwards_does_not_take_back_how_near_it_came():
    watch = MarginWatch(3, LimitsOverTime([(0.0, LIMITS), (50.0, LIMITS | {"t_cell_max": 60.0})]))
    watch.add(piece([10.0, 40.0, 60.0], [30.0, 40.0, 41.0]))
    hottest = of(watch, "t_max")
    assert (hottest.margin, hottest.allowed, hottest.cell, hottest.at_s) == (4.0, 45.0, 2, 40.0)


def test_a_limit_lowered_afterwards_does_not_judge_what_was_before():
    watch = MarginWatch(3, LimitsOverTime([(0.0, LIMITS | {"t_cell_max": 60.0}), (50.0, LIMITS)]))
    watch.add(piece([10.0, 40.0], [30.0, 50.0]))
    watch.add(piece([60.0], [35.0]))
    assert of(watch, "t_max").margin == pytest.approx(9.0)
    assert of(watch, "t_max").allowed == 60.0


def test_without_a_configuration_no_limit_is_known():
    watch = MarginWatch(3, LimitsOverTime([]))
    watch.add(piece([10.0], [30.0]))
    assert watch.nearest() == []


def test_a_limit_that_a_signal_carries_judges_each_moment_by_its_value_then():
    moving = {"t_cell_max": MovingLimit(np.array([0.0, 50.0]), np.array([60.0, 40.0]))}
    watch = MarginWatch(3, LimitsOverTime([(0.0, {})], moving))
    watch.add(piece([10.0, 40.0, 60.0], [30.0, 50.0, 35.0]))
    hottest = of(watch, "t_max")
    assert (hottest.seen, hottest.allowed, hottest.margin, hottest.cell, hottest.at_s) == (36.0, 40.0, 4.0, 2, 60.0)


def test_before_the_signal_was_told_no_limit_is_known():
    moving = {"t_cell_max": MovingLimit(np.array([50.0]), np.array([40.0]))}
    watch = MarginWatch(3, LimitsOverTime([(0.0, {})], moving))
    watch.add(piece([10.0], [90.0]))
    assert watch.nearest() == []
