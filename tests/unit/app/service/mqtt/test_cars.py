"""A car of a fleet: what is old is never live, whatever the clocks, the way and the messages are."""

import json
import pickle
from itertools import accumulate

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.service.mqtt.cars import DRIFT, LIVE_S, MOST_BYTES, SILENT_S, TOPICS, Car

ALARM = {
    "severity": "trip",
    "message": {"code": "cell-overtemperature", "args": {}, "text": "cell overtemperature"},
    "cell": 7,
    "active": True,
}


def values(sent_s: float, *, age_s: float = 0.1, run: str = "a", soc: float = 0.5) -> bytes:
    ages = {"voltage": age_s, "current": age_s}
    return json.dumps({"time": 1e9, "sent": {"run": run, "s": sent_s}, "age_s": ages, "soc": soc}).encode()


def received(delays_s: list[float], *, offset_s: float = 5000.0, at_s: float = 100.0) -> tuple[Car, float]:
    """A car that told its state once a second over ways of these lengths; return when the last message came."""
    car, now_s = Car("red"), at_s
    car.take("status", b"online", at_s, is_retained=False)
    for second, delay_s in enumerate(delays_s):
        now_s = max(now_s, at_s + second + delay_s)
        car.take("accumulator", values(at_s + second - offset_s), now_s, is_retained=False)
    return car, now_s


def test_a_car_is_live_by_its_own_time_of_measuring():
    car, now_s = received([0.05] * 5)
    assert car.state(now_s) == "live"
    assert car.age_s("voltage", now_s) == pytest.approx(0.1, abs=0.01)
    assert car.age_s("voltage", now_s + 1.0) == pytest.approx(1.1, abs=0.01)


@pytest.mark.parametrize("offset_s", [0.0, 86_400.0, -86_400.0, 1.7e9])
def test_the_difference_of_the_clocks_does_not_count(offset_s):
    car, now_s = received([0.3] * 5, offset_s=offset_s)
    assert car.age_s("voltage", now_s) == pytest.approx(0.1, abs=0.01)


@given(st.lists(st.floats(0, 60), min_size=4, max_size=40), st.floats(-1e6, 1e6))
def test_an_age_is_too_small_by_no_more_than_the_shortest_way(delays_s, offset_s):
    car, now_s = received(delays_s, offset_s=offset_s)
    true_s = now_s - (100.0 + len(delays_s) - 1) + 0.1
    came_s = accumulate((second + delay_s for second, delay_s in enumerate(delays_s)), max)
    shortest_s = min(at_s - second for second, at_s in enumerate(came_s))
    assert true_s - shortest_s - DRIFT * (now_s - 100.0) - 1e-6 <= car.age_s("voltage", now_s) <= true_s + 1e-6


def test_values_that_waited_in_a_cut_link_are_old():
    car, _ = received([0.05] * 10)
    car.take("accumulator", values(110 - 5000.0), 230.0, is_retained=False)
    assert car.age_s("voltage", 230.0) == pytest.approx(120.1, abs=0.2)
    assert car.state(230.0) == "silent"


def test_a_first_message_alone_is_not_live():
    car, now_s = received([0.0])
    assert car.state(now_s) == "late"


def test_a_service_that_starts_again_has_another_clock():
    car, now_s = received([0.05] * 5)
    for second in range(5):
        now_s += 1.0
        car.take("accumulator", values(3.0 + second, run="b"), now_s, is_retained=False)
    assert car.state(now_s) == "live"
    assert car.age_s("voltage", now_s) == pytest.approx(0.1, abs=0.01)


def test_two_services_under_one_name_are_told_and_never_live():
    car, now_s = received([0.05] * 5)
    car.take("accumulator", values(5.0, run="b"), now_s + 1.0, is_retained=False)
    assert car.shown(now_s + 1.0, 1e9)["alarms"] == []  # it was started again, as far as anybody can tell
    for second in range(2, 12):
        car.take("accumulator", values(100.0 + second, run="ab"[second % 2]), now_s + second, is_retained=False)
    (told,) = car.shown(now_s + 11, 1e9)["alarms"]
    assert (told["severity"], told["active"]) == ("warning", True)
    assert "red" in told["message"]["text"]
    assert car.state(now_s + 11) != "live"
    assert car.shown(now_s + 120, 1e9)["alarms"] == []


def test_what_the_broker_kept_is_never_live():
    car = Car("red")
    car.take("status", b"online", 100.0, is_retained=True)
    car.take("accumulator", values(95.0), 100.0, is_retained=True)
    shown = car.shown(100.0, 2e9)
    assert (shown["state"], shown["age_s"], shown["soc"], shown["since"]) == ("vanished", None, 0.5, 1e9)


def test_a_car_vanishes_by_its_last_will_or_its_silence_and_since_when_is_told():
    car, now_s = received([0.05] * 5)
    assert car.state(now_s + SILENT_S) == "vanished"
    assert car.shown(now_s + 3600, 2e9)["since"] == pytest.approx(2e9 - 3600 - 0.1, abs=0.01)
    car.take("status", b"offline", now_s, is_retained=False)
    assert car.state(now_s) == "vanished"
    car.take("status", b"online", now_s + 1, is_retained=False)
    assert car.state(now_s + 1) == "live"


def test_a_car_whose_own_link_is_gone_is_silent_though_its_service_speaks():
    car, now_s = received([0.05] * 5)
    car.take("accumulator", values(now_s - 5000.0, age_s=SILENT_S + 1), now_s, is_retained=False)
    assert car.state(now_s) == "silent"
    car.take("accumulator", values(now_s - 5000.0, age_s=LIVE_S), now_s, is_retained=False)
    assert car.state(now_s) == "late"


def test_a_link_and_alarms_are_shown_and_an_address_that_is_none_is_not():
    car = Car("red")
    car.take("links", b'{"rs232": {"state": "live", "lost": 3}, "simulated": true, "can": 5}', 0.0, is_retained=False)
    car.take("alarms", json.dumps([ALARM, {"severity": "loud"}, 7]).encode(), 0.0, is_retained=False)
    car.take("about", b'{"url": "javascript:alert(1)", "segments": [12, 12]}', 0.0, is_retained=False)
    shown = car.shown(0.0, 0.0)
    assert shown["links"] == {"rs232": {"state": "live", "lost": 3}}
    assert shown["alarms"] == [ALARM]
    assert (shown["url"], shown["segments"]) == (None, [12, 12])


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=9),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=9), inner, max_size=4),
    max_leaves=8,
)
KEYS = ("sent", "time", "age_s", "soc", "state", "rs232", "can", "url", "segments", "battery", "severity", "message")


@given(
    st.lists(
        st.tuples(
            st.sampled_from(sorted(TOPICS)),
            st.binary(max_size=30)
            | (JSON | st.dictionaries(st.sampled_from(KEYS), JSON)).map(json.dumps).map(str.encode),
            st.booleans(),
        ),
        max_size=12,
    )
)
def test_no_message_breaks_the_page(messages):
    car = Car("red")
    for step, (topic, body, retained) in enumerate(messages):
        car.take(topic, body, float(step), is_retained=retained)
        json.dumps(car.shown(float(step), 1e9), allow_nan=False)


FILLED = "x" * 10_000
DEEP: object = FILLED
for _ in range(500):
    DEEP = [DEEP]


@pytest.mark.parametrize(
    ("topic", "document"),
    [
        ("about", {"url": f"http://{FILLED}", "battery": FILLED, "segments": [1] * 900, FILLED: FILLED}),
        (
            "accumulator",
            {"sent": {"run": FILLED, "s": 1.0}, "age_s": dict.fromkeys(map(str, range(9000)), 1), "x": DEEP},
        ),
        ("links", {"rs232": {"state": FILLED, "lost": 1, "x": DEEP}, FILLED: FILLED}),
        ("master", {"state": FILLED, "x": [FILLED] * 20}),
        ("alarms", [ALARM | {"message": {"code": "a", "args": {"x": FILLED}, "text": FILLED}, "x": FILLED}] * 8),
        ("alarms", [ALARM | {"message": {"code": "a", "args": {"x": DEEP}, "text": ""}}] * 8),
    ],
)
def test_of_a_message_only_what_is_shown_is_kept(topic, document):
    car = Car("red")
    assert car.take(topic, json.dumps(document).encode(), 0.0, is_retained=False)
    assert 0 < car.kept_bytes < 12_000
    assert len(pickle.dumps(car)) < 16_000
    json.dumps(car.shown(1.0, 1e9), allow_nan=False)


def test_a_message_beyond_a_limit_is_left_out_and_the_one_before_it_stays():
    car = Car("red")
    assert car.take("alarms", json.dumps([ALARM]).encode(), 0.0, is_retained=False)
    kept = car.kept_bytes
    many = json.dumps([ALARM] * 20).encode()
    assert not car.take("alarms", many, 0.0, is_retained=False, room_bytes=1000)
    assert not car.take("alarms", many.ljust(MOST_BYTES + 1), 0.0, is_retained=False)
    assert (car.shown(0.0, 0.0)["alarms"], car.kept_bytes) == ([ALARM], kept)
    assert car.take("alarms", b"[]", 0.0, is_retained=False, room_bytes=0)
    assert car.kept_bytes < kept
