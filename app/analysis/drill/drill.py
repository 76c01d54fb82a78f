"""A drill on the simulated car: plays the bad days one after the other, takes the crew's answers, keeps the score."""

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Protocol

from app.analysis.drill.days import Day, draw_days
from app.analysis.drill.product import TRIP_CAUSE, answer_of_events, answer_of_message, reports_fault
from app.analysis.drill.score import Answer, most_points, points, total
from app.errors import LinkError, NotNow
from app.telemetry import Event
from app.words import Message

MOST_SAID: Final = 8


class Control(Protocol):
    """The simulator's control port."""

    def ask(self, do: str, /) -> dict[str, Any]:
        """Return the answer to a request."""


class Car(Protocol):
    """The simulated car, as far as a drill needs it."""

    @property
    def control(self) -> Control:
        """Where it is asked how it is."""

    @property
    def scenario(self) -> str | None:
        """What it plays, None for its default."""

    def restart(self, scenario: str | None) -> None:
        """Start it anew."""


@dataclass(frozen=True, slots=True)
class Result:
    """A day that was answered; times in seconds since the fault began, negative before it did."""

    day: Day
    answer: Answer
    points: int
    most: int
    taken_s: float
    visible_s: float | None  # first event that told of something
    said: tuple[Message, ...]  # by the product, in order
    product: Answer | None
    product_points: int


@dataclass(frozen=True, slots=True)
class DrillState:
    """A drill as it stands; without one `is_on` is False, and the results are those of the last."""

    is_on: bool = False
    seed: int | None = None
    day: int = 0  # from 1
    days: int = 0
    points: int = 0
    most: int = 0
    results: tuple[Result, ...] = ()


@dataclass
class _Running:
    seed: int
    days: list[Day]
    before: str | None  # what the car played
    events: list[Event] = field(default_factory=list)


class Drill:
    """One drill at a time. Methods may be called from any thread."""

    def __init__(self, car: Car, folder: Path, wall_ns: Callable[[], int]) -> None:
        """Take the car, where its scenario is written, and the clock that events are told by."""
        self._car = car
        self._file = folder / "drill.toml"
        self._wall_ns = wall_ns
        self._lock = threading.Lock()
        self._running: _Running | None = None
        self._state = DrillState()

    @property
    def state(self) -> DrillState:
        """How it stands."""
        return self._state

    def start(self, seed: int, n_days: int) -> DrillState:
        """Begin with the first day.

        Raises:
            NotNow: one is running.
        """
        with self._lock:
            if self._running is not None:
                raise NotNow(Message("drill-is-on"))
            self._running = _Running(seed, draw_days(seed, n_days), self._car.scenario)
            self._state = DrillState(is_on=True, seed=seed, days=n_days)
            self._begin(self._running)
            return self._state

    def answer(self, answer: Answer) -> DrillState:
        """Take the crew's answer and go on to the next day; after the last the car plays what it did before.

        Raises:
            NotNow: no drill is running.
        """
        with self._lock:
            running = self._needed()
            day = running.days[self._state.day - 1]
            since_s = self._car_time_s() - day.at_s
            results = (*self._state.results, self._result(running, day, answer, since_s))
            got, most = total([(each.points, each.most) for each in results])
            is_on = len(results) < len(running.days)
            self._state = DrillState(is_on, running.seed, self._state.day, len(running.days), got, most, results)
            if is_on:
                self._begin(running)
            else:
                self._end(running)
            return self._state

    def stop(self) -> None:
        """End it early: what was answered stays as the last results."""
        with self._lock:
            if self._running is not None:
                self._end(self._running)

    def on_event(self, event: Event) -> None:
        """Take what the service tells."""
        running = self._running
        if running is not None and reports_fault(event.severity, event.code):
            running.events.append(event)

    def _car_time_s(self) -> float:
        """Seconds since the day began; 0 while the car is still starting."""
        try:
            return float(self._car.control.ask("status")["time_s"])
        except LinkError:
            return 0.0

    def _needed(self) -> _Running:
        if self._running is None:
            raise NotNow(Message("drill-is-off"))
        return self._running

    def _begin(self, running: _Running) -> None:
        state = self._state
        day = running.days[state.day]
        self._file.write_text(day.scenario, encoding="utf-8")
        self._state = DrillState(True, state.seed, day.number, state.days, state.points, state.most, state.results)
        running.events.clear()
        self._car.restart(str(self._file))

    def _end(self, running: _Running) -> None:
        state = self._state
        self._state = DrillState(False, state.seed, state.day, state.days, state.points, state.most, state.results)
        self._running = None
        self._file.unlink(missing_ok=True)
        self._car.restart(running.before)

    def _result(self, running: _Running, day: Day, answer: Answer, since_s: float) -> Result:
        """The car runs in real time: what was told before the fault began is not of it."""
        fault_ns = self._wall_ns() - round(since_s * 1e9)
        seen = [event for event in running.events if event.time_ns >= fault_ns]
        causes = (answer_of_message(event.message, event.cell) for event in seen if event.code == TRIP_CAUSE)
        named = next((cause for cause in causes if cause is not None), None)
        product = named or answer_of_events([(event.code, event.cell) for event in seen])
        return Result(
            day=day,
            answer=answer,
            points=points(day, answer),
            most=most_points(day),
            taken_s=round(since_s, 1),
            visible_s=round((seen[0].time_ns - fault_ns) / 1e9, 1) if seen else None,
            said=tuple(event.message for event in seen[:MOST_SAID]),
            product=product,
            product_points=points(day, product),
        )
