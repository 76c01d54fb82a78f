"""One car of a fleet as its messages tell it, and how old they are by the listener's clock. No thread, no network.

The car's clock is not ours. What it measured is dated by its own monotonic clock; of all its messages the one that was
least long on its way shows how the two clocks differ. So an age is too small by that shortest way, never by more.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import orjson

from app.words import Message, render

State = Literal["live", "late", "silent", "vanished"]
LIVE_S = 3.0  # a car tells its state once a second
SILENT_S = 10.0  # values as old as this are no state of a car any more
SETTLED_S = 2.5  # after its first message: until then nothing tells how long that one was on its way
DRIFT = 500e-6  # of two clocks against each other, at most
NAME_CONFLICT_S = 60.0  # for so long it is told that two services speak under one name
MOST_RUNS = 20
MOST_ALARMS = 50
MOST_BYTES = 1 << 18  # of a message
TOPICS = frozenset({"status", "about", "accumulator", "links", "master", "alarms"})
_NUMBERS = ("soc", "soc_min", "voltage_v", "current_a", "voltage_min_v", "temperature_max_degc")
_CELLS = ("soc_min_cell", "voltage_min_cell", "temperature_max_cell")


@dataclass
class CarClock:
    """How a car's clock differs from ours, by the message that waited least since the car's service started."""

    run: object = None
    since_s: float = 0.0  # first message of this run, by our clock
    offset_s: float = 0.0
    received_s: float = 0.0

    def waited_s(self, run: object, sent_s: float, received_s: float) -> float:
        """Take a message; return how long it was on its way beyond the shortest way."""
        difference = received_s - sent_s
        if run != self.run or self.received_s == 0.0:
            self.run, self.since_s, self.offset_s = run, received_s, difference
        drifted = self.offset_s + DRIFT * max(0.0, received_s - self.received_s)
        self.offset_s = min(difference, drifted)
        self.received_s = received_s
        return difference - self.offset_s


@dataclass
class Car:
    """What was heard of one car; times in seconds of our monotonic clock."""

    name: str
    is_online: bool | None = None  # None: it never said
    about: Mapping[str, Any] = field(default_factory=dict)
    values: Mapping[str, Any] = field(default_factory=dict)  # of the topic `accumulator`
    links: Mapping[str, Any] = field(default_factory=dict)
    master: Mapping[str, Any] = field(default_factory=dict)
    alarms: tuple[Mapping[str, Any], ...] = ()
    heard_s: float | None = None  # the newest message that was no retained one
    waited_s: float = 0.0  # the newest values, on their way
    values_s: float | None = None  # when they came; None: they are retained ones, of whenever
    clock: CarClock = field(default_factory=CarClock)
    runs: list[object] = field(default_factory=list)  # that were heard, the newest last
    conflict_s: float | None = None  # when an earlier run spoke again

    def take(self, topic: str, body: bytes, now_s: float, *, is_retained: bool) -> None:
        """Take a message; one that cannot be understood is left out.

        Args:
            topic: its last level, one of TOPICS.
            body: as it came.
            now_s: when it came.
            is_retained: the broker kept it, nobody knows how long.
        """
        if not is_retained:
            self.heard_s = now_s
        if topic == "status":
            self.is_online = body == b"online"
            return
        try:
            document = orjson.loads(body) if len(body) <= MOST_BYTES else None
        except orjson.JSONDecodeError:
            return
        if topic == "alarms":
            if isinstance(document, list):
                self.alarms = tuple(each for each in document[:MOST_ALARMS] if isinstance(each, dict))
        elif isinstance(document, dict):
            if topic == "accumulator":
                self._take_values(document, now_s, is_retained)
            else:
                setattr(self, topic, document)

    def _take_values(self, document: Mapping[str, Any], now_s: float, is_retained: bool) -> None:
        sent = document.get("sent")
        sent_s = _number(sent.get("s") if isinstance(sent, dict) else document.get("time"))  # of an earlier version
        if sent_s is None:
            return
        self.values = document
        if is_retained:
            self.values_s = None
            return
        run = sent.get("run") if isinstance(sent, dict) else None
        self._note_run(run, now_s)
        self.waited_s = self.clock.waited_s(run, sent_s, now_s)
        self.values_s = now_s

    def _note_run(self, run: object, now_s: float) -> None:
        """A service that starts again has a new run for good; one that comes back is of another that speaks, too."""
        if self.runs and run == self.runs[-1]:
            return
        if run in self.runs:
            self.runs.remove(run)
            self.conflict_s = now_s
        self.runs = [*self.runs[1 - MOST_RUNS :], run]

    def age_s(self, part: str, now_s: float) -> float | None:
        """Seconds since the car measured a part; None where that is not known."""
        ages = self.values.get("age_s")
        told_s = _number(ages.get(part)) if isinstance(ages, dict) else None
        if told_s is None or self.values_s is None:
            return None
        return max(0.0, told_s) + self.waited_s + (now_s - self.values_s)

    def state(self, now_s: float) -> State:
        """Whether its values may be taken for the present."""
        if self.is_online is False or self.heard_s is None or now_s - self.heard_s >= SILENT_S:
            return "vanished"
        age_s = self.age_s("voltage", now_s)
        if age_s is None or age_s >= SILENT_S:
            return "silent"
        is_settled = now_s - self.clock.since_s >= SETTLED_S
        return "live" if age_s < LIVE_S and is_settled else "late"

    def shown(self, now_s: float, wall_s: float) -> dict[str, Any]:
        """Return what the page shows of it; `since` is the unix time of its last values, `now_s` is `wall_s`."""
        age_s = self.age_s("voltage", now_s)
        state = self.state(now_s)
        return {
            "name": self.name,
            "state": state,
            "since": wall_s - age_s if age_s is not None else self._measured_unix_s(),
            "age_s": age_s,
            **{name: _number(self.values.get(name)) for name in _NUMBERS},
            **{name: _cell(self.values.get(name)) for name in _CELLS},
            "links": {
                name: {"state": str(link.get("state")), "lost": _whole(link.get("lost"))}
                for name, link in self.links.items()
                if name in ("rs232", "can") and isinstance(link, dict)
            },
            "master": _text(self.master.get("state")),
            "alarms": self._name_conflict(now_s)
            + [shown for each in self.alarms if (shown := _alarm(each)) is not None],
            "url": url if (url := _text(self.about.get("url"))) and url.startswith(("http://", "https://")) else None,
            "battery": _text(self.about.get("battery")),
            "segments": _segments(self.about.get("segments")),
            "simulated": self.values.get("simulated") is True,
        }

    def _name_conflict(self, now_s: float) -> list[dict[str, Any]]:
        if self.conflict_s is None or now_s - self.conflict_s >= NAME_CONFLICT_S:
            return []
        message = Message("car-twice", car=self.name)
        words = {"code": message.code, "args": dict(message.args)}
        return [{"severity": "warning", "text": render(message), "text_words": words, "cell": None, "active": True}]

    def _measured_unix_s(self) -> float | None:
        """By the car's own clock: nothing was heard by which ours could tell."""
        return _number(self.values.get("time"))


def _number(value: object) -> float | None:
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e12
    return value if is_number else None  # type: ignore[return-value]


def _cell(value: object) -> int | None:
    return value if isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 1e6 else None


def _whole(value: object) -> int:
    return value if isinstance(value, int) and not isinstance(value, bool) else 0


def _text(value: object) -> str | None:
    return value[:200] if isinstance(value, str) else None


def _segments(value: object) -> list[int]:
    is_list = isinstance(value, list) and len(value) <= 1000 and all(isinstance(n, int) and 0 < n < 1000 for n in value)
    return list(value) if is_list else []  # type: ignore[call-overload]


def _alarm(document: Mapping[str, Any]) -> dict[str, Any] | None:
    severity = document.get("severity")
    if severity not in ("watch", "warning", "trip"):
        return None
    return {
        "severity": severity,
        "text": _text(document.get("text")) or "",
        "text_words": _words(document.get("text_words")),
        "cell": _cell(document.get("cell")),
        "active": document.get("active") is True,
    }


def _words(document: object) -> dict[str, Any] | None:
    """A code with arguments, as far as it is one: the page falls back to the text."""
    if isinstance(document, dict) and isinstance(document.get("code"), str) and isinstance(document.get("args"), dict):
        return {"code": document["code"], "args": document["args"]}
    return None
