import pytest

from app.analysis.drill.days import Day
from app.analysis.drill.score import Answer, most_points, points, total


def day(fault, pack=None, cell=None):
    return Day(1, fault, pack, cell, None, 30.0, 90.0, "")


@pytest.mark.parametrize(
    ("what", "answer", "worth"),
    [
        (day("loose-joint", 3, 7), Answer("loose-joint", 3, 7), 3),
        (day("loose-joint", 3, 7), Answer("loose-joint", 3, 8), 2),
        (day("loose-joint", 3, 7), Answer("hot-cell", 3, 7), 1),
        (day("loose-joint", 3, 7), Answer("hot-cell", 7, 3), 0),
        (day("open-wire", 3, 7), Answer("open-wire", 3, 8), 3),  # the same wire ends at both
        (day("open-wire", 3, 7), Answer("open-wire", 3, 6), 2),
        (day("lost-slave", 3), Answer("lost-slave", 3), 3),
        (day("lost-slave", 3), Answer("lost-slave", 2), 2),
        (day("reset"), Answer("reset"), 2),
        (day("reset"), Answer("lost-slave", 2), 0),
        (day("reset"), None, 0),
    ],
)
def test_two_points_for_what_failed_and_one_for_where(what, answer, worth):
    assert points(what, answer) == worth
    assert worth <= most_points(what) == (2 if what.pack is None else 3)


def test_the_total_is_of_both():
    assert total([(2, 3), (0, 2)]) == (2, 5)
