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
    texts = [e["message"]["text"] for e in client.get("/events").json()["events"]]
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
            assert "disabled by the setting balance_open" in answer.json()["detail"]
        assert client.post("/commands/balance-stop").status_code == 200
        block_reasons = client.get("/commands").json()["block_reasons"]
        assert {name: why["code"] for name, why in block_reasons.items()} == {
            "balance-start": "no-balancing-open",
            "balance-cells": "no-balancing-open",
            "charge-stop": "blocked-not-charging",
        }


def volts(read):
    return [reading["value"] for reading in read["readings"]]


def test_a_slave_is_checked_against_a_meter_before_and_after_its_repair(client, service):
    asked = {"pack": 4, "quantity": "voltage"}
    meter = volts(client.post("/calibration/slave", json=asked).json())  # the board as it left the factory
    assert all(3.0 < value < 4.3 for value in meter)
    assert client.get("/calibration/slave").json() == {"checks": [], "next_cursor": None}, "reading alone keeps nothing"

    drifting = {
        "fault": "slave-reference-drift",
        "pack": 5,
        "value": 0.3,
    }  # the board's self-test finds it from 0.4 % on
    client.post("/simulator/faults", json=drifting).raise_for_status()
    service.wait_for(lambda s: s["cells"]["voltage_v"][48] < meter[0] * 0.998)
    found = client.post("/calibration/slave", json=asked | {"reference": meter, "meter_error": 0.0005}).json()
    verdict = found["check"]["verdict"]
    assert (verdict["cause"], len(verdict["out"]), found["before"]) == ("reference", 12, None)
    assert verdict["share"] == pytest.approx(-0.003, abs=0.0003)
    assert verdict["limit"] == pytest.approx(0.0017)

    client.delete("/simulator/faults").raise_for_status()
    service.wait_for(lambda s: s["cells"]["voltage_v"][48] > meter[0] * 0.999)
    some = [meter[0], *[None] * 10, meter[11]]
    after = client.post("/calibration/slave", json=asked | {"reference": some, "note": "board replaced"}).json()
    assert after["check"]["verdict"]["cause"] == "none"
    assert [cell["is_good"] for cell in after["check"]["verdict"]["cells"]] == [True, *[None] * 10, True]
    assert after["before"]["number"] == found["check"]["number"]
    kept = client.get("/calibration/slave", params={"pack": 4}).json()["checks"]
    assert [check["note"] for check in kept] == ["board replaced", ""]
    texts = [e["message"]["text"] for e in client.get("/events").json()["events"] if e["code"] == "slave-check"]
    assert "2 cells compared" in texts[0]
    assert texts[0].endswith("all within tolerance")
    assert "out of tolerance: cells 1, 2, 3" in texts[1]


def test_what_would_mislead_a_check_is_refused_with_its_reason(client, service):
    asked = {"pack": 0, "quantity": "voltage", "reference": [3.8] * 12}
    for wrong in ({"pack": 8}, {"quantity": "current"}, {"reference": [3.8]}, {"reference": [380.0] * 12}):
        assert client.post("/calibration/slave", json=asked | wrong).status_code == 422
    blunt = client.post("/calibration/slave", json=asked | {"meter_error": 0.02})
    assert (blunt.status_code, blunt.json()["errors"][0]["field"]) == (422, "meter_error")
    client.post("/commands/balance-cells", json={"cells": [3]}).raise_for_status()
    service.wait_for(lambda s: s["cells"]["balancing"][3])
    bled = client.post("/calibration/slave", json=asked)
    assert (bled.status_code, bled.json()["type"]) == (409, "urn:voltwall:not-now")
    assert "stop balancing first" in bled.json()["detail"]
    client.post("/commands/balance-stop").raise_for_status()
    service.wait_for(lambda s: not any(s["cells"]["balancing"]))
