"""All cars of a real broker, as the service of the fleet's page tells them."""

from collections.abc import Iterator

import httpx
import pytest

from app.api.application import create_fleet_app
from app.errors import ConfigError
from app.service.settings import Settings
from tests.mosquitto import IS_CI, MOSQUITTO, Mosquitto, ToldCar
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
    told = ToldCar(broker.port, "red", url="http://car.local:8000")
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
    again = ToldCar(broker.port, "red")
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
