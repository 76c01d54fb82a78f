"""The real service on a car that fails: what it says, and what is in force, when the power or the EEPROM goes."""

import pytest

from firmware_protocol.config_image import default_image, image_hash, with_value
from firmware_protocol.eeprom import plan_store
from tests.failing_car import FailingCar

OCTETS = {"Accept": "application/octet-stream"}
NEW = with_value(default_image(), "v_cell_chrg", 4.12)


@pytest.fixture
def car(tmp_path, make_service):
    """Switch a car on with some options; it and a service on it."""
    failing = FailingCar(tmp_path)

    def on(*options):
        service = make_service("--serial", str(failing.start(*options).link))
        service.wait_for(lambda s: s["config_hash"] and s["master"]["map_matches"] is not None)
        return failing, service

    yield on
    failing.stop()


def write(client, image):
    etag = client.get("/config", headers=OCTETS).headers["ETag"]
    headers = {"If-Match": etag, "Content-Type": "application/octet-stream"}
    return client.put("/config", content=image, headers=headers)


def power_cycle(failing, service, wanted, *options):
    """Off and on; `wanted` is in force then."""
    failing.stop()
    service.wait_for(lambda s: s["links"]["rs232"]["state"] == "lost")
    failing.start(*options)
    with service.client() as client:
        service.wait_for(lambda s: s["links"]["rs232"]["state"] == "live" and in_force(client) == wanted)


def in_force(client):
    return client.get("/config", headers=OCTETS).content


def test_another_memory_map_is_said_and_nothing_is_written(car):
    _, service = car("--other-map")
    assert service.wait_for(lambda s: s["master"]["map_matches"] is not None)["master"]["map_matches"] is False
    with service.client() as client:
        refused = write(client, NEW)
        assert refused.status_code == 409
        assert "memory map" in refused.json()["detail"]
        assert client.post("/config/store").status_code == 409
        assert in_force(client) == default_image()


def test_an_eeprom_that_keeps_nothing_is_an_error_and_the_write_stays_in_force(car):
    _, service = car("--worn")
    with service.client() as client:
        assert write(client, NEW).status_code == 200
        assert client.post("/config/store").status_code in (409, 502, 503)
        assert in_force(client) == NEW


N_WRITTEN = sum(len(page.data) for page in plan_store(b"\xff" * 1024, NEW))


@pytest.mark.parametrize(("cut", "expected"), [(100, "old"), (N_WRITTEN - 40, "new")])
def test_a_power_cut_while_storing_leaves_one_of_the_two(car, cut, expected):
    """The last page is the new header, of which 16 bytes count."""
    failing, service = car()
    with service.client() as client:
        client.post("/config/store").raise_for_status()
        assert write(client, NEW).status_code == 200
    power_cycle(failing, service, default_image(), "--cut-after", str(cut))
    with service.client() as client:
        assert write(client, NEW).status_code == 200
        assert client.post("/config/store").status_code >= 500
    power_cycle(failing, service, default_image() if expected == "old" else NEW)
    with service.client() as client:
        assert write(client, NEW).status_code == 200
        assert client.post("/config/store").json()["stored_hash"] == image_hash(NEW)
