import pytest

from app.analysis.drill.days import draw_days
from app.analysis.drill.drill import Drill
from app.analysis.drill.score import Answer
from app.errors import LinkError, NotNow
from app.telemetry import Event
from app.words import Message


class Car:
    """Plays what it is told, at a time that the test sets."""

    def __init__(self):
        self.scenario = "race-day"
        self.played = []
        self.time_s = 0.0
        self.control = self

    def restart(self, scenario):
        self.scenario = scenario
        self.played.append(scenario)

    def ask(self, do):
        assert do == "status"
        if self.time_s is None:
            raise LinkError("starting")
        return {"time_s": self.time_s}


@pytest.fixture
def car():
    return Car()


@pytest.fixture
def drill(car, tmp_path):
    return Drill(car, tmp_path, lambda: round((car.time_s or 0) * 1e9))


def told(at_s, code="trip-v-min", cell=3):
    return Event(round(at_s * 1e9), "trip", code, Message("trip-v-min"), cell=cell)


def test_a_drill_plays_its_days_scores_them_and_gives_the_car_back(car, drill):
    days = draw_days(5, 2)
    state = drill.start(5, 2)
    assert (state.is_on, state.day, state.days) == (True, 1, 2)
    assert days[0].fault not in car.scenario
    first = days[0]
    drill.on_event(told(first.at_s - 5))  # the restart of the car is not of the day
    drill.on_event(told(first.at_s + 2))
    car.time_s = first.at_s + 20
    state = drill.answer(Answer(first.fault, first.pack, first.cell))
    (result,) = state.results
    assert (result.taken_s, result.visible_s, len(result.said)) == (pytest.approx(20), pytest.approx(2), 1)
    assert result.points == result.most == state.points
    assert (state.is_on, state.day) == (True, 2)
    state = drill.answer(Answer("reset"))
    assert not state.is_on
    assert state.results[1].visible_s is None
    assert car.played[-1] == "race-day"


def test_a_drill_that_is_ended_gives_the_car_back_and_keeps_what_was_answered(car, drill):
    drill.start(5, 3)
    drill.answer(Answer("reset"))
    drill.stop()
    assert car.scenario == "race-day"
    assert len(drill.state.results) == 1
    assert not drill.state.is_on


def test_one_drill_at_a_time(drill):
    with pytest.raises(NotNow):
        drill.answer(Answer("reset"))
    drill.start(1, 2)
    with pytest.raises(NotNow):
        drill.start(1, 2)


def test_an_answer_while_the_car_still_starts_counts_from_before_the_fault(car, drill):
    (day,) = draw_days(5, 1)
    drill.start(5, 1)
    car.time_s = None
    (result,) = drill.answer(Answer(day.fault, day.pack, day.cell)).results
    assert result.taken_s == pytest.approx(-day.at_s)
