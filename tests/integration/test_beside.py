"""Two batteries of one service: each with a bus, pages, alarms and recordings of its own."""

import sqlite3

import httpx
import pytest

from tests.battery_bus import SpeakingBus
from tests.battery_folder import write_profile
from tests.peer_batteries import one_signal_a_cell
from tests.service_process import WAIT_S, Service, until

FRONT_CELLS, REAR_CELLS = 8, 20
WITNESS = """
[[witness]]
name = "second"
bus = 1
dbc = "battery.dbc"
[witness.soc]
signal = "Pack_SOC"
"""
TOO_HIGH = "cell_voltage_max_v = 3.0"  # of the rear one: its alarms are its own


class Two:
    """The service, its two buses, and a client of each battery."""

    def __init__(self, folder):
        self.folder = folder
        front = one_signal_a_cell(FRONT_CELLS, 8, "V{}", "T{}", 0.0001, "V")
        rear = one_signal_a_cell(REAR_CELLS, 20, "U{}", "T{}", 0.0001, "V")
        front.name, rear.name = "front", "rear"
        (folder / "front").mkdir()
        (folder / "rear").mkdir()
        profile = write_profile(folder / "front", front, (8,))
        beside = write_profile(folder / "rear", rear, (5, 5, 5, 5), TOO_HIGH)
        profile.write_text(profile.read_text() + WITNESS)
        self.front_bus, self.rear_bus = SpeakingBus(front.frames(4)), SpeakingBus(rear.frames(4))
        self.witness_bus = SpeakingBus(front.frames(4))
        buses = f"{self.front_bus.url},{self.witness_bus.url}"
        arguments = ["--battery", str(profile), "--can", buses, "--filter", "coulomb"]
        arguments += ["--also", f"{beside}@{self.rear_bus.url}"]
        (folder / "data").mkdir()
        self.service = Service(folder / "data", arguments).start()
        self.front = httpx.Client(base_url=f"{self.service.base_url}/api/v1", timeout=30)
        self.rear = httpx.Client(base_url=f"{self.service.base_url}/beside/rear/api/v1", timeout=30)

    def close(self):
        self.service.stop()
        for each in (self.front, self.rear, self.front_bus, self.rear_bus, self.witness_bus):
            each.close()


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    running = Two(tmp_path_factory.mktemp("two"))
    yield running
    running.close()


def loaded(client):
    answer = client.get("/snapshot")
    return answer.json()["accumulator"]["loaded_cells"] if answer.status_code == 200 else 0


def test_each_is_live_under_its_own_address_with_its_own_alarms(two):
    until(lambda: loaded(two.front) == FRONT_CELLS and loaded(two.rear) == REAR_CELLS)
    assert two.front.get("/battery").json()["name"] == "front"
    assert two.rear.get("/battery").json()["segments"] == [5, 5, 5, 5]
    until(lambda: [alarm["code"] for alarm in two.rear.get("/snapshot").json()["alarms"]])
    (alarm,) = two.rear.get("/snapshot").json()["alarms"]
    assert alarm["code"] == "cell-voltage-high"
    assert two.front.get("/snapshot").json()["alarms"] == []
    told = {each["name"]: (each["path"], each["worst"]) for each in two.front.get("/batteries").json()}
    assert told == {"front": ("/", None), "rear": ("/beside/rear/", "trip")}


def test_each_records_into_its_own_folder(two):
    until(lambda: all(client.get("/snapshot").json()["recording"] for client in (two.front, two.rear)))
    here = two.folder / "data"
    for folder, name in ((here, "front"), (here / "beside" / "rear", "rear")):
        (session,) = (folder / "sessions").glob("*.sqlite")
        with sqlite3.connect(f"file:{session}?mode=ro", uri=True) as connection:
            (profile,) = connection.execute("SELECT data FROM battery_files ORDER BY id LIMIT 1").fetchone()
        assert f'name = "{name}"'.encode() in profile


def test_a_witness_on_a_second_bus_is_compared_and_has_its_own_link(two):
    def agrees():
        (witness,) = two.front.get("/snapshot").json()["witnesses"]
        (reading,) = witness["readings"]
        return witness["link"]["state"] == "live" and reading["quantity"] == "soc" and reading["verdict"]

    until(agrees)
    monitor = {each["name"] for each in two.front.get("/can/bus").json()["ids"]}
    assert {"BMS_PackStatus", "second: BMS_PackStatus"} <= monitor


def test_one_that_is_silent_ages_alone(two):
    until(lambda: loaded(two.front) == FRONT_CELLS and loaded(two.rear) == REAR_CELLS)
    two.front_bus.fall_silent()
    until(lambda: two.front.get("/snapshot").json()["links"]["can"]["state"] == "silent")
    until(lambda: (two.front.get("/batteries").json()[0]["voltage_age_s"] or 99) > 2)
    (witness,) = two.front.get("/snapshot").json()["witnesses"]
    assert witness["link"]["state"] == "live"
    assert witness["age_s"] < 2
    rear = two.rear.get("/snapshot").json()
    assert rear["links"]["can"]["state"] == "live"
    assert rear["age"]["voltage"] < 1.5


def test_the_pages_of_the_second_are_below_its_path(two):
    base = two.service.base_url
    assert httpx.get(f"{base}/beside/rear", timeout=WAIT_S).headers["location"] == "/beside/rear/"
    assert httpx.get(f"{base}/beside/rear/", timeout=WAIT_S).text == httpx.get(f"{base}/").text
    assert 'voltwall_cell_volts{cell="5",pack="4"}' in httpx.get(f"{base}/beside/rear/metrics", timeout=WAIT_S).text
    assert httpx.get(f"{base}/api/v1/snapshot", headers={"Host": "evil.example"}, timeout=WAIT_S).status_code == 403
    assert (
        httpx.get(f"{base}/beside/rear/api/v1/snapshot", headers={"Host": "evil.example"}, timeout=WAIT_S).status_code
        == 403
    )
