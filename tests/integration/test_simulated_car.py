"""The simulated car through the service: scenarios, faults, and the alarms that they lead to."""

import httpx

from tests.service_process import WAIT_S


def test_faults_are_listed_injected_shown_and_cleared(service):
    with service.client() as client:
        body = client.get("/simulator").json()
        assert body["scenario"] in {item["name"] for item in body["scenarios"]}
        assert {"joint-resistance-high", "sense-wire-open"} & {fault["name"] for fault in body["faults"]}
        by_its_old_name = {"fault": "loose-joint", "pack": 3, "cell": 7, "value": 5}
        hot = client.post("/simulator/faults", json=by_its_old_name)
        assert hot.status_code == 201, hot.text
        texts = [event["message"]["text"] for event in client.get("/events").json()["events"]]
        assert "fault injected: joint-resistance-high pack 3, cell 7" in texts
        active = client.get("/simulator").json()["status"]["active"]
        assert [(fault["fault"], fault["pack"], fault["cell"]) for fault in active] == [("joint-resistance-high", 3, 7)]
        assert client.delete("/simulator/faults/joint-resistance-high?pack=3&cell=7").json() == {"active": []}
        refused = client.post(
            "/simulator/faults", json={"fault": "joint-resistance-high", "pack": 3, "cell": 7, "value": 5000}
        )
        assert refused.status_code == 422
        assert "50" in refused.json()["detail"]
        assert client.post("/simulator/faults", json={"fault": "gremlins"}).status_code == 422
        assert client.post("/simulator/faults", json={"fault": "joint-resistance-high", "pack": 9}).status_code == 422


def test_an_unplugged_cable_is_noticed_and_comes_back(service):
    with service.client() as client:
        client.post("/simulator/unplug", json={"for_s": 3})
    service.wait_for(lambda s: s["links"]["rs232"]["state"] == "lost")
    service.wait_for(lambda s: s["links"]["rs232"]["state"] == "live")


def test_another_scenario_starts_another_car_on_the_same_ports(service):
    with service.client() as client:
        assert client.post("/simulator/scenario", json={"name": "no-such"}).status_code == 404
        assert client.post("/simulator/scenario", json={"name": "charging"}).json() == {"scenario": "charging"}
    service.wait_for(lambda s: s["master"]["state"] == "charge", seconds=40)
    with service.client() as client:
        assert client.get("/simulator").json()["scenario"] == "charging"
        client.post("/simulator/scenario", json={"name": "race-day"})
    service.wait_for(lambda s: s["master"]["state"] == "drive", seconds=40)


def test_a_service_on_a_real_port_has_no_simulated_car(make_service, tmp_path):
    service = make_service("--serial", str(tmp_path / "nothing"))
    assert httpx.get(service.base_url + "/api/v1/simulator", timeout=WAIT_S).status_code == 404
