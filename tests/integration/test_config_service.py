"""The configuration over REST: conflict, refusal, reason, history, roll back, profiles; two engineers and a viewer."""

import json

import pytest

from firmware_protocol.config_image import default_image, image_hash
from tests.service_process import until

OCTETS = {"Accept": "application/octet-stream"}
ENGINEER, VIEWER = "correct horse battery", "may only look at it"


@pytest.fixture(scope="module")
def resting(make_module_service):
    secrets = {"VOLTWALL_PASSWORD": ENGINEER, "VOLTWALL_VIEWER_PASSWORD": VIEWER}
    service = make_module_service("--scenario", "in-the-pit", **secrets)
    with service.client(auth=("ada", ENGINEER)) as client:
        until(lambda: is_ready(client.get("/snapshot")))
    return service


def is_ready(answer):
    if answer.status_code != 200:
        return False
    snapshot = answer.json()
    return snapshot["config_hash"] and snapshot["master"]["map_matches"]


@pytest.fixture
def ada(resting):
    with resting.client(auth=("ada", ENGINEER)) as client:
        yield client


@pytest.fixture
def bob(resting):
    with resting.client(auth=("bob", ENGINEER)) as client:
        yield client


@pytest.fixture
def eve(resting):
    with resting.client(auth=("eve", VIEWER)) as client:
        yield client


def etag(client):
    return client.get("/config", headers=OCTETS).headers["ETag"]


def put(client, values, tag=None, **more):
    return client.put("/config", json={"values": values} | more, headers={"If-Match": tag or etag(client)})


def test_nothing_stored_is_an_answer_and_no_error(ada):
    assert (ada.get("/config/stored").status_code, ada.get("/config/stored").json()) == (200, None)
    assert ada.get("/config/stored", headers=OCTETS).status_code == 204


def test_two_engineers_and_a_viewer_at_once(ada, bob, eve):
    mine, theirs = etag(ada), etag(bob)
    assert mine == theirs
    assert put(bob, {"t_cell_max": 48}, theirs).json()["verified"]
    conflict = put(ada, {"telemetry_period": 110}, mine)
    assert (conflict.status_code, conflict.json()["type"]) == (412, "urn:voltwall:changed-meanwhile")
    [meanwhile] = conflict.json()["meanwhile"]
    assert (meanwhile["field"], meanwhile["from"], meanwhile["to"]) == ("t_cell_max", 45, 48)
    [mine_now] = conflict.json()["difference"]
    assert (mine_now["field"], mine_now["to"]) == ("telemetry_period", 110)
    assert put(eve, {"telemetry_period": 110}, conflict.headers["ETag"]).status_code == 403
    assert eve.get("/config").json()["values"]["t_cell_max"] == 48
    assert put(ada, {"telemetry_period": 110}, conflict.headers["ETag"]).json()["verified"]
    values = eve.get("/config").json()["values"]
    assert (values["t_cell_max"], values["telemetry_period"]) == (48, 110)


def test_errors_block_and_warnings_need_a_reason(ada):
    hot = put(ada, {"t_cell_max": 65}, reason="it is a hot day")
    assert (hot.status_code, hot.json()["errors"][0]["code"]) == (422, "rules")
    assert hot.json()["errors"][0]["why"]["text"].startswith("rule limit")
    doubtful = put(ada, {"i_disc_max": 210})
    assert (doubtful.status_code, doubtful.json()["type"]) == (422, "urn:voltwall:reason-required")
    dry = ada.put("/config?dry_run=true", json={"values": {"i_disc_max": 210}}, headers={"If-Match": etag(ada)}).json()
    assert [w["field"] for w in dry["warnings"] if not w["standing"]] == ["i_disc_max"]
    assert put(ada, {"i_disc_max": 210}, reason="ten second pulses").status_code == 200
    assert ada.get("/config/history").json()["records"][0]["reason"] == "ten second pulses"


def test_every_write_is_in_the_history_and_one_request_rolls_it_back(ada, bob):
    before = ada.get("/config", headers=OCTETS).content
    put(bob, {"v_cell_max": 4.19, "v_cell_chrg": 4.14})
    record = ada.get("/config/history?limit=1").json()["records"][0]
    assert (record["who"], record["action"], record["result"], record["genuine"]) == ("bob", "write", "done", True)
    assert {c["field"] for c in record["difference"]} == {"v_cell_max", "v_cell_chrg"}
    path = f"/config/history/{record['number']}/rollback"
    assert ada.post(path).status_code == 428
    assert ada.post(path, headers={"If-Match": '"0000000000000000"'}).status_code == 412
    dry = ada.post(path + "?dry_run=true", headers={"If-Match": etag(ada)}).json()
    assert (len(dry["difference"]), dry["written"]) == (2, False)
    assert ada.post(path, headers={"If-Match": etag(ada)}).json()["verified"]
    assert ada.get("/config", headers=OCTETS).content == before
    last = ada.get("/config/history?limit=1").json()["records"][0]
    assert (last["action"], last["source"]) == ("rollback", f"record {record['number']}")


def test_a_forged_record_is_shown_and_not_rolled_back(ada, resting):
    put(ada, {"balance_threshold": 0.03})
    path = resting.data / "config-history.jsonl"
    kept = path.read_text()
    lines = kept.splitlines(keepends=True)
    path.write_text("".join([*lines[:-1], lines[-1].replace('"ada"', '"eve"')]))
    try:
        record = ada.get("/config/history?limit=1").json()["records"][0]
        assert (record["who"], record["genuine"]) == ("eve", False)
        refused = ada.post(f"/config/history/{record['number']}/rollback", headers={"If-Match": etag(ada)})
        assert (refused.status_code, refused.json()["type"]) == (409, "urn:voltwall:not-genuine")
    finally:
        path.write_text(kept)


def test_a_profile_goes_to_another_car_as_a_file(ada, make_service):
    put(ada, {"t_cell_max": 52, "i_chrg_max": 10})
    assert ada.put("/config/profiles/car-a", json={"comment": "as tuned"}).json()["version"] >= 1
    file = ada.get("/config/profiles/car-a")
    assert json.loads(file.text)["values"]["t_cell_max"]["unit"] == "degC"
    other = make_service("--scenario", "in-the-pit", "--seed", "9")
    other.wait_for(lambda s: s["config_hash"] and s["master"]["map_matches"])
    with other.client() as client:
        assert client.get("/config", headers=OCTETS).content == default_image()
        answer = client.put(
            "/config?reason=clone",
            content=file.content,
            headers={"If-Match": etag(client), "Content-Type": "application/json"},
        )
        cloned = client.get("/config", headers=OCTETS).content
    assert answer.status_code == 200, answer.text
    assert image_hash(cloned) == image_hash(ada.get("/config", headers=OCTETS).content)


def test_any_two_configurations_are_compared(ada):
    put(ada, {"t_cell_max": 44}, reason="a cold day").raise_for_status()
    ada.post("/config/store").raise_for_status()
    put(ada, {"t_cell_max": 43}).raise_for_status()
    session = ada.get("/sessions").json()["sessions"][0]["id"]
    first = ada.get("/config/history?limit=1000").json()["records"][-1]["number"]
    for a, b, expected in (
        ("stored", "in-force", [("t_cell_max", 44, 43)]),
        ("in-force", "in-force", []),
        (f"record:{first}:before", "default", []),
    ):
        answer = ada.get("/config/compare", params={"a": a, "b": b}).json()
        assert [(c["field"], c["from"], c["to"]) for c in answer["difference"]] == expected
    assert ada.get("/config/compare", params={"a": f"session:{session}", "b": "in-force"}).status_code == 200
    assert ada.get("/config/compare", params={"a": "profile:none", "b": "stored"}).status_code == 404
    assert ada.get("/config/compare", params={"a": "session:none", "b": "stored"}).status_code == 404
    assert ada.get("/config/compare", params={"a": "what", "b": "stored"}).status_code == 422


def test_while_the_car_drives_only_what_is_safe_is_written(make_service):
    service = make_service()
    service.wait_for(lambda s: s["master"]["state"] == "drive" and s["master"]["map_matches"] and s["config_hash"])
    with service.client() as client:
        refused = put(client, {"t_cell_max": 50})
        assert (refused.status_code, refused.json()["type"]) == (409, "urn:voltwall:at-work")
        assert refused.json()["fields"] == ["t_cell_max"]
        assert put(client, {"fan_ramp_max": 0.9}).json()["verified"]
        live = {f["name"] for f in client.get("/config/schema").json()["fields"] if f["live"]}
    assert "fan_ramp_max" in live
    assert "t_cell_max" not in live


WORN = """title = "Worn"
description = "An EEPROM that keeps nothing."
loop = true
[[phase]]
load = "rest"
for_s = 3600
[[fault]]
at_s = 0
name = "eeprom-worn"
"""


def test_an_eeprom_that_keeps_nothing_is_an_error_and_the_write_stays_in_force(make_service, tmp_path):
    scenario = tmp_path / "worn.toml"
    scenario.write_text(WORN)
    with make_service("--scenario", str(scenario)).client() as client:
        until(lambda: is_ready(client.get("/snapshot")))
        assert put(client, {"v_cell_chrg": 4.12}).status_code == 200
        assert client.post("/config/store").status_code == 409
        assert client.get("/config").json()["values"]["v_cell_chrg"] == 4.12
