"""Commands over REST on a simulated car in the pit: done, told, undone by themselves."""

import pytest


@pytest.fixture(scope="module")
def scenario():
    return "in-the-pit"


@pytest.fixture
def client(service):
    service.wait_for(lambda s: s["config_hash"] and s["master"]["map_matches"])
    with service.client() as client:
        yield client


def test_cells_are_balanced_by_hand(client, service):
    assert client.post("/commands/balance-cells", json={"cells": [3, 61, 71]}).json() == {"done": True}
    bled = service.wait_for(lambda s: sum(b is True for b in s["cells"]["balancing"]) == 3)
    assert [i for i, b in enumerate(bled["cells"]["balancing"]) if b] == [3, 61, 71]
    client.post("/commands/balance-cells", json={"cells": [5]})
    service.wait_for(lambda s: [i for i, b in enumerate(s["cells"]["balancing"]) if b] == [5])
    client.post("/commands/balance-stop")
    service.wait_for(lambda s: not any(s["cells"]["balancing"]))
    texts = [e["text"] for e in client.get("/events").json()["events"]]
    assert "balance-cells pack 6, cells 2, 12" in texts
    for body in ({}, {"cells": [96]}, {"cells": [-1]}, {"cells": [1], "argument": 1}):
        assert client.post("/commands/balance-cells", json=body).status_code == 422


def test_a_fan_is_fixed_for_a_time_and_then_automatic_again(client, service):
    client.post("/commands/fan-override", json={"argument": 0.8, "duration_s": 2})
    service.wait_for(lambda s: s["accumulator"]["fan_duty"] == pytest.approx(0.8, abs=0.01))
    service.wait_for(lambda s: s["accumulator"]["fan_duty"] < 0.5)
    for body in ({"duration_s": 5}, {"argument": 0.5, "duration_s": 3601}, {"argument": 0.5, "duration_s": 0}):
        assert client.post("/commands/fan-override", json=body).status_code == 422
    assert client.post("/commands/reset", json={"duration_s": 5}).status_code == 422


def test_the_count_is_set_and_started_again_from_the_voltage(client, service):
    before = service.wait_for(lambda s: s["master"]["soc"])["master"]["soc"]
    client.post("/commands/set-soc", json={"argument": 0.1})
    service.wait_for(lambda s: s["master"]["soc"] == pytest.approx(0.1, abs=0.01))
    client.post("/commands/soc-from-ocv")
    service.wait_for(lambda s: s["master"]["soc"] == pytest.approx(before, abs=0.02))


def test_the_master_says_who_it_is(client):
    answer = client.post("/identify").json()
    assert answer["is_compatible"]
    assert answer["boots"] >= 1


def test_the_current_sensor_is_zeroed_with_before_and_after(client, service):
    tag = client.get("/config").headers["ETag"]
    off = client.put("/config", json={"raw": {"i_offset": 20540}}, headers={"If-Match": tag})  # 1.2 A
    assert off.status_code == 200
    service.wait_for(lambda s: abs(s["accumulator"]["current_a"]) > 0.5)
    zero = client.post("/calibration/current", json={"what": "zero"}).json()
    before = zero["proposal"]
    assert before["before_raw"] == 20540
    assert abs(before["before_a"]) > 0.5
    etag = client.get("/config").headers["ETag"]
    values = {"raw": {before["field"]: before["after_raw"]}, "reason": "zero taken"}
    assert client.put("/config", json=values, headers={"If-Match": etag}).status_code == 200
    after = client.post("/calibration/current", json={"what": "measure"}).json()
    assert abs(after["measured"]["mean_a"]) < 0.4
    assert after["proposal"] is None
    assert client.post("/calibration/current", json={"what": "gain"}).status_code == 422
    assert client.post("/calibration/current", json={"what": "gain", "reference_a": 20}).status_code == 422


def test_balancing_with_open_relays_is_refused_where_the_rules_forbid_it(make_service):
    strict = make_service("--scenario", "in-the-pit", "--no-balance-open")
    strict.wait_for(lambda s: s["master"]["flags"] is not None)
    with strict.client() as client:
        for name in ("balance-start", "balance-cells"):
            answer = client.post(f"/commands/{name}", json={})
            assert (answer.status_code, answer.json()["type"]) == (409, "urn:voltwall:rules")
            assert "the rules forbid" in answer.json()["detail"]
        assert client.post("/commands/balance-stop").status_code == 200
