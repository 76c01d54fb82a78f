"""The page of several cars: three that are told, one of which vanishes and one falls silent."""

import re

import pytest
from playwright.sync_api import expect

from app.service.mqtt.cars import MOST_BYTES
from tests.mosquitto import IS_CI, MOSQUITTO, CarUpdates, Mosquitto
from tests.service_process import Service

pytestmark = pytest.mark.skipif(MOSQUITTO is None and not IS_CI, reason="no mosquitto: apt-get install mosquitto")
HOT = {"code": "cell-overtemperature", "args": {}, "text": "cell overtemperature"}
TRIP = {"severity": "trip", "message": HOT, "cell": 30,
        "active": True}  # fmt: skip


@pytest.fixture(scope="module")
def broker(tmp_path_factory):
    running = Mosquitto(tmp_path_factory.mktemp("broker")).start()
    yield running
    running.kill()


@pytest.fixture(scope="module")
def fleet(tmp_path_factory, broker):
    service = Service(tmp_path_factory.mktemp("fleet"), ["--fleet", f"mqtt://127.0.0.1:{broker.port}"]).start()
    yield service
    service.stop()


@pytest.mark.parametrize("size", ["desktop", "phone"])
def test_before_any_car_the_page_says_how_to_start_one(fleet, open_page, violations, size):
    page = open_page(fleet.base_url, size)
    expect(page.get_by_test_id("hint")).to_contain_text("--car NAME")
    assert violations(page) == {}


def test_cards_tell_cars_apart_and_one_that_vanishes_is_old(fleet, broker, open_page, violations):
    cars = [
        CarUpdates(broker.port, "blue", url="http://127.0.0.1:1"),
        CarUpdates(broker.port, "green", alarms=[TRIP]),
        CarUpdates(broker.port, "red"),
    ]
    page = open_page(fleet.base_url)
    for name in ("blue", "green", "red"):
        expect(page.get_by_test_id(f"car-{name}")).to_have_attribute("data-state", "live")
    blue, green, red = (page.get_by_test_id(f"car-{name}") for name in ("blue", "green", "red"))
    expect(blue.get_by_test_id("weakest")).to_contain_text("pack 3, cell 7")
    expect(blue.get_by_test_id("open")).to_have_attribute("href", "http://127.0.0.1:1")
    expect(green.get_by_test_id("alarms")).to_contain_text("cell overtemperature · pack 3, cell 7")
    cars[2].vanish()
    expect(red).to_have_attribute("data-state", "vanished")
    expect(red.get_by_test_id("trust")).to_contain_text("offline since")
    expect(page.get_by_test_id("counts")).to_contain_text("2 of 3 live, 1 offline")
    assert violations(page) == {}
    cars[0].fall_silent()
    expect(blue).to_have_attribute("data-state", "silent")
    expect(page.get_by_test_id("counts")).to_contain_text("1 of 3 live, 1 silent, 1 offline")
    for line, state in (("rs232", "silent"), ("can", "live")):  # its service speaks: the links are as it says
        expect(blue.get_by_test_id(line)).to_have_attribute("data-state", state)
    expect(blue).to_contain_text("last SOC")
    expect(blue.get_by_test_id("soc")).to_contain_text(re.compile(r"61\s%.*\d\d s ago"))
    expect(blue.get_by_test_id("weakest")).to_contain_text(re.compile(r"3\.651\sV.* ago.*pack 3, cell 7", re.DOTALL))
    expect(blue).not_to_contain_text("41")  # it has no temperature
    expect(red).to_contain_text("last SOC")
    expect(red.get_by_test_id("rs232")).to_have_attribute("data-state", "unknown")
    assert violations(page) == {}
    page.get_by_test_id("language").select_option("nb")
    expect(red.get_by_test_id("trust")).to_contain_text("frakoblet siden")
    expect(green.get_by_test_id("alarms")).not_to_contain_text("cell overtemperature")
    for car in cars[:2]:
        car.vanish()


def test_messages_beyond_the_limits_are_shown_as_left_out(fleet, broker, open_page, violations):
    car = CarUpdates(broker.port, "loud")
    page = open_page(fleet.base_url)
    expect(page.get_by_test_id("car-loud")).to_be_visible()
    expect(page.get_by_test_id("left-out")).to_have_count(0)
    car.publish("alarms", b"[]".ljust(MOST_BYTES + 1))
    expect(page.get_by_test_id("left-out")).to_contain_text("ignored")
    assert violations(page) == {}
    page.get_by_test_id("language").select_option("nb")
    expect(page.get_by_test_id("left-out")).to_contain_text("ignorert")
    car.vanish()
