"""All cars of a real broker, as the service of the fleet's page tells them."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import httpx
import paho.mqtt.client as paho
import pytest
from paho.mqtt.enums import CallbackAPIVersion

from app.api.application import create_fleet_app
from app.errors import ConfigError
from app.service.mqtt.cars import MOST_BYTES
from app.service.settings import Settings
from tests.mosquitto import IS_CI, MOSQUITTO, CarUpdates, Mosquitto
from tests.service_process import WAIT_S, Service, until

pytestmark = pytest.mark.skipif(MOSQUITTO is None and not IS_CI, reason="no mosquitto: apt-get install mosquitto")
PASSWORD = "engineer-pass-1"


@pytest.fixture(scope="module")
def broker(tmp_path_factory) -> Iterator[Mosquitto]:
    running = Mosquitto(tmp_path_factory.mktemp("broker")).start()
    yield running
    running.kill()


@pytest.fixture(scope="module")
def fleet(tmp_path_factory, broker) -> Iterator[httpx.Client]:
    arguments = ["--fleet", f"mqtt://127.0.0.1:{broker.port}"]
    service = Service(tmp_path_factory.mktemp("fleet"), arguments, {"VOLTWALL_PASSWORD": PASSWORD}).start()
    with service.client(auth=("anna", PASSWORD)) as client:
        yield client
    assert service.stop() in (0, -15)


def cars(fleet) -> dict[str, dict]:
    return {car["name"]: car for car in fleet.get("/fleet").json()["cars"]}


def test_a_car_is_live_vanishes_and_comes_back_over_a_restarted_broker(fleet, broker):
    assert cars(fleet) == {}
    told = CarUpdates(broker.port, "red", url="http://car.local:8000")
    until(lambda: cars(fleet).get("red", {}).get("state") == "live")
    red = cars(fleet)["red"]
    assert (red["soc"], red["voltage_min_cell"], red["url"]) == (0.61, 30, "http://car.local:8000")
    assert 0.2 <= red["age_s"] < 3.0
    told.vanish()
    until(lambda: cars(fleet)["red"]["state"] == "vanished")
    assert cars(fleet)["red"]["soc"] == 0.61  # its last, with since when
    assert fleet.get("/health").json()["status"] == "ok"  # a car that is away is no fault of the service
    broker.kill()
    until(lambda: fleet.get("/fleet").json()["problem"])
    health = fleet.get("/health").json()
    assert (health["status"], len(health["reasons"])) == ("degraded", 1)
    broker.start()
    until(lambda: fleet.get("/fleet").json()["problem"] is None)
    again = CarUpdates(broker.port, "red")
    until(lambda: cars(fleet)["red"]["state"] == "live")
    again.vanish()


def test_without_its_password_nothing_is_told(fleet):
    assert httpx.get(f"{fleet.base_url}fleet", timeout=WAIT_S).status_code == 401
    assert httpx.get(f"{fleet.base_url}me", timeout=WAIT_S).json()["role"] is None


def test_a_fleet_has_no_car_of_its_own(fleet):
    assert fleet.get("/snapshot").status_code == 404


def test_what_is_no_broker_or_unsafe_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="host"):
        create_fleet_app(Settings(data=tmp_path, host="0.0.0.0", fleet="mqtt://pit"))
    with pytest.raises(ConfigError, match="fleet"):
        create_fleet_app(Settings(data=tmp_path, fleet="http://pit"))


LARGE_ALARM = {
    "severity": "trip",
    "message": {"code": "cell-overtemperature", "args": {}, "text": "t" * 190},
    "cell": 7,
    "active": True,
    "more": "m" * 5000,
}


def resident_mb(fleet_service) -> float:
    status = Path(f"/proc/{fleet_service.process.pid}/status").read_text()
    return int(next(line for line in status.splitlines() if line.startswith("VmRSS")).split()[1]) / 1024


@pytest.mark.skipif(sys.platform != "linux", reason="reads the memory of the process in /proc")
def test_a_member_of_the_broker_does_not_fill_the_memory(tmp_path):
    """3,000 retained messages of 250 kB under names of their own."""
    broker = Mosquitto(tmp_path).start()
    service = Service(tmp_path / "fleet", ["--fleet", f"mqtt://127.0.0.1:{broker.port}"]).start()
    member = paho.Client(CallbackAPIVersion.VERSION2)
    try:
        with service.client() as client:
            red = CarUpdates(broker.port, "red")
            until(lambda: cars(client).get("red", {}).get("state") == "live")
            before_mb = resident_mb(service)
            member.max_inflight_messages_set(1)
            member.connect("127.0.0.1", broker.port)
            member.loop_start()
            body = json.dumps([LARGE_ALARM] * 48).encode()
            assert 240_000 < len(body) <= MOST_BYTES
            for number in range(3000):
                member.publish(f"voltwall/m{number}/alarms", body, qos=1).wait_for_publish(WAIT_S)
            for size in (MOST_BYTES + 1, 2 << 20):  # the second the broker does not even deliver
                member.publish("voltwall/red/alarms", b"[]".ljust(size), qos=1).wait_for_publish(WAIT_S)
            until(lambda: client.get("/fleet").json()["notice"])
            assert resident_mb(service) - before_mb < 60
            answer = client.get("/fleet").json()
            assert answer["notice"]["code"] == "fleet-left-out"
            assert answer["notice"]["args"]["n"] > 1000
            until(lambda: cars(client)["red"]["state"] == "live")
            red.vanish()
    finally:
        member.loop_stop()
        service.stop()
        broker.kill()
