"""One car of a fleet as its messages tell it, and how old they are by the listener's clock. No thread, no network.

The car's clock is not ours. What it measured is dated by its own monotonic clock; of all its messages the one that was
least long on its way shows how the two clocks differ. So an age is too small by that shortest way, never by more.
"""

import contextlib
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

import orjson

from app.words import Message, rendered

State = Literal["live", "late", "silent", "vanished"]
LIVE_S = 3.0  # a car tells its state once a second
SILENT_S = 10.0  # values as old as this are no state of a car any more
SETTLED_S = 2.5  # after its first message: until then nothing tells how long that one was on its way
DRIFT = 500e-6  # relative drift of two clocks, at most
NAME_CONFLICT_S = 60.0  # how long two services under one name are reported [s]
MOST_RUNS = 20
MOST_ALARMS = 50
MOST_BYTES = 1 << 18  # bytes of a message
MOST_KEPT_BYTES = 8 << 20  # as JSON, of what all cars' messages leave; of a car with ten alarms it is 5 kB
_MOST_TEXT = 200  # characters
_MOST_MESSAGE_BYTES = 1000  # bytes of an alarm's code and arguments
TOPICS = frozenset({"status", "about", "accumulator", "links", "master", "alarms"})
_NUMBERS = ("soc", "soc_min", "voltage_v", "voltage_at_least_v", "current_a", "voltage_min_v", "temperature_max_degc")
_CELLS = ("soc_min_cell", "voltage_min_cell", "temperature_max_cell")
_AGES = ("voltage", "current")


@dataclass
class CarClock:
    """Difference of a car's clock and ours, by the message that waited least since the car's service started."""

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
    """Values received from one car; times in seconds of our monotonic clock."""

    name: str
    is_online: bool | None = None  # None: unknown
    kept: dict[str, Any] = field(default_factory=dict)  # shown part of each topic's newest message
    kept_bytes: int = 0  # total bytes of `kept` as JSON
    _bytes_of: dict[str, int] = field(default_factory=dict)
    last_contact_s: float | None = None  # the newest message that was no retained one
    waited_s: float = 0.0  # the newest values, on their way
    values_s: float | None = None  # when they came; None: they are retained ones, of whenever
    clock: CarClock = field(default_factory=CarClock)
    runs: list[object] = field(default_factory=list)  # that were received, the newest last
    conflict_s: float | None = None  # when an earlier run spoke again

    def take(
        self, topic: str, body: bytes, now_s: float, *, is_retained: bool, room_bytes: int = MOST_KEPT_BYTES
    ) -> bool:
        """Take a message; one that cannot be understood is left out. False: it is beyond a limit.

        Args:
            topic: its last level, one of TOPICS.
            body: as it came.
            now_s: when it came.
            is_retained: the broker kept it, nobody knows how long.
            room_bytes: by which what is kept may grow.
        """
        if not is_retained:
            self.last_contact_s = now_s
        if topic == "status":
            self.is_online = body == b"online"
            return True
        if len(body) > MOST_BYTES:
            return False
        document = _document(topic, body)
        sent_s = _sent_s(document) if document is not None and topic == "accumulator" else 0.0
        if document is None or sent_s is None:
            return True
        shown = _SHOWN[topic](document)
        size = len(orjson.dumps(shown))
        grown = size - self._bytes_of.get(topic, 0)
        if grown > room_bytes:
            return False
        self.kept[topic], self._bytes_of[topic] = shown, size
        self.kept_bytes += grown
        if topic == "accumulator":
            self._date_values(document.get("sent"), sent_s, now_s, is_retained)
        return True

    def _date_values(self, sent: object, sent_s: float, now_s: float, is_retained: bool) -> None:
        if is_retained:
            self.values_s = None
            return
        run = str(sent.get("run"))[:_MOST_TEXT] if isinstance(sent, dict) else None
        self._note_run(run, now_s)
        self.waited_s = self.clock.waited_s(run, sent_s, now_s)
        self.values_s = now_s

    def _note_run(self, run: object, now_s: float) -> None:
        """Note the run of a service: a restart has a new one for good, one that comes back is a second service's."""
        if self.runs and run == self.runs[-1]:
            return
        if run in self.runs:
            self.runs.remove(run)
            self.conflict_s = now_s
        self.runs = [*self.runs[1 - MOST_RUNS :], run]

    def age_s(self, part: str, now_s: float) -> float | None:
        """Seconds since the car measured a part; None where that is not known."""
        reported_s: float | None = self._values.get("age_s", {}).get(part)
        if reported_s is None or self.values_s is None:
            return None
        return max(0.0, reported_s) + self.waited_s + (now_s - self.values_s)

    def state(self, now_s: float) -> State:
        """Return whether its values are live."""
        if self.is_online is False or self.last_contact_s is None or now_s - self.last_contact_s >= SILENT_S:
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
            **{name: self._values.get(name) for name in (*_NUMBERS, *_CELLS)},
            "last_known": {
                name: self._last(last, now_s, wall_s) for name, last in self._values.get("last", {}).items()
            },
            "links": self.kept.get("links", {}),
            "master": self.kept.get("master"),
            "alarms": self._name_conflict(now_s) + self.kept.get("alarms", []),
            **self.kept.get("about", _about({})),
            "simulated": self._values.get("simulated", False),
        }

    @property
    def _values(self) -> Mapping[str, Any]:
        values: Mapping[str, Any] = self.kept.get("accumulator", {})
        return values

    def _last(self, last: Mapping[str, Any], now_s: float, wall_s: float) -> dict[str, Any]:
        """A value that was missing in the newest message, with its age; None where only the car's clock dates it."""
        age_s, sent_s = None, self._measured_unix_s()
        if self.values_s is not None and sent_s is not None:
            age_s = max(0.0, sent_s - last["time"]) + self.waited_s + (now_s - self.values_s)
        since = last["time"] if age_s is None else wall_s - age_s
        return {"value": last["value"], "cell": last["cell"], "age_s": age_s, "since": since}

    def _name_conflict(self, now_s: float) -> list[dict[str, Any]]:
        if self.conflict_s is None or now_s - self.conflict_s >= NAME_CONFLICT_S:
            return []
        message = asdict(rendered(Message("car-twice", car=self.name)))
        return [{"severity": "warning", "message": message, "cell": None, "active": True}]

    def _measured_unix_s(self) -> float | None:
        """By the car's own clock: nothing was received by which ours could tell."""
        return _number(self._values.get("time"))


def _number(value: object) -> float | None:
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e12
    return value if is_number else None  # type: ignore[return-value]


def _cell(value: object) -> int | None:
    return value if isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 1e6 else None


def _whole(value: object) -> int:
    return value if isinstance(value, int) and not isinstance(value, bool) else 0


def _text(value: object) -> str | None:
    return value[:_MOST_TEXT] if isinstance(value, str) else None


def _segments(value: object) -> list[int]:
    is_list = isinstance(value, list) and len(value) <= 1000 and all(isinstance(n, int) and 0 < n < 1000 for n in value)
    return list(value) if is_list else []  # type: ignore[call-overload]


def _alarm(document: Mapping[str, Any]) -> dict[str, Any] | None:
    severity = document.get("severity")
    if severity not in ("watch", "warning", "trip"):
        return None
    return {
        "severity": severity,
        "message": _message(document.get("message", document)),
        "cell": _cell(document.get("cell")),
        "active": document.get("active") is True,
    }


def _message(document: object) -> dict[str, Any]:
    """A message as it is sent; without its code where that or the arguments are none or too large."""
    sent = document if isinstance(document, dict) else {}
    text, code, args = _text(sent.get("text")) or "", sent.get("code"), sent.get("args")
    if isinstance(code, str) and isinstance(args, dict):
        with contextlib.suppress(orjson.JSONEncodeError):  # nested too deep
            if len(orjson.dumps([code, args])) <= _MOST_MESSAGE_BYTES:
                return {"code": code, "args": args, "text": text}
    return asdict(rendered(text))


def _document(topic: str, body: bytes) -> Any:
    """A message as JSON of its topic's kind, None where it is none."""
    try:
        document = orjson.loads(body)
    except orjson.JSONDecodeError:
        return None
    return document if isinstance(document, list if topic == "alarms" else dict) else None


def _sent_s(document: Mapping[str, Any]) -> float | None:
    sent = document.get("sent")
    return _number(sent.get("s") if isinstance(sent, dict) else document.get("time"))  # an earlier version has `time`


def _last_known(document: object) -> dict[str, Any]:
    """Numbers that have a value and a time."""
    values = {}
    for name in _NUMBERS:
        last = document.get(name) if isinstance(document, dict) else None
        if isinstance(last, dict):
            value, time = _number(last.get("value")), _number(last.get("time"))
            if value is not None and time is not None:
                values[name] = {"value": value, "time": time, "cell": _cell(last.get("cell"))}
    return values


def _accumulator(document: Mapping[str, Any]) -> dict[str, Any]:
    ages = document.get("age_s")
    return {
        "last": _last_known(document.get("last_known")),
        "time": _number(document.get("time")),
        "age_s": {part: _number(ages.get(part)) for part in _AGES} if isinstance(ages, dict) else {},
        **{name: _number(document.get(name)) for name in _NUMBERS},
        **{name: _cell(document.get(name)) for name in _CELLS},
        "simulated": document.get("simulated") is True,
    }


def _links(document: Mapping[str, Any]) -> dict[str, Any]:
    return {
        name: {"state": str(link.get("state"))[:_MOST_TEXT], "lost": _whole(link.get("lost"))}
        for name, link in document.items()
        if name in ("rs232", "can") and isinstance(link, dict)
    }


def _about(document: Mapping[str, Any]) -> dict[str, Any]:
    url = _text(document.get("url"))
    return {
        "url": url if url and url.startswith(("http://", "https://")) else None,
        "battery": _text(document.get("battery")),
        "segments": _segments(document.get("segments")),
    }


def _alarms(document: list[Any]) -> list[dict[str, Any]]:
    alarms = (_alarm(entry) for entry in document[:MOST_ALARMS] if isinstance(entry, dict))
    return [alarm for alarm in alarms if alarm is not None]


_SHOWN: Mapping[str, Callable[[Any], Any]] = {
    "about": _about,
    "accumulator": _accumulator,
    "alarms": _alarms,
    "links": _links,
    "master": lambda document: _text(document.get("state")),
}
