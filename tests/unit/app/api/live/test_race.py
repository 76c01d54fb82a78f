"""The race's plan and the driver's display over HTTP: limits, who may, what is logged."""

import pytest

from tests.unit.app.api.conftest import ENGINEER, VIEWER

FRAME = {"id": 0x6A0, "start_byte": 0, "length": 2}


def codes(client):
    return [event["code"] for event in client.get("/api/v1/events?limit=20").json()["events"]]


def test_a_plan_is_kept_logged_and_ended(client):
    assert client.put("/api/v1/race-plan", json={"laps_to_go": 22, "reserve_soc": 0.05}).json()["laps_to_go"] == 22
    assert client.delete("/api/v1/race-plan").status_code == 204
    assert codes(client).count("race-plan") == 2


@pytest.mark.parametrize(
    ("body", "field"),
    [({"laps_to_go": 0}, "laps_to_go"), ({"laps_to_go": 5, "reserve_soc": 0.9}, "reserve_soc")],
)
def test_a_plan_that_cannot_be_names_the_field(client, body, field):
    refused = client.put("/api/v1/race-plan", json=body)
    assert refused.status_code == 422
    assert refused.json()["errors"][0]["field"] == field


def test_the_drivers_display_is_off_and_says_what_is_missing(client):
    state = client.get("/api/v1/driver-can").json()
    assert (state["target"], state["message"], state["shown"], state["target_wh"]) == (None, None, "none", None)
    assert state["block_reason"]["code"] == "no-can"
    assert client.post("/api/v1/driver-can/message", json={"message": "box"}).status_code == 409


def test_frames_are_mapped_and_a_message_is_told_and_logged(client):
    state = client.put("/api/v1/driver-can", json={"target": FRAME, "message": FRAME | {"id": 0x6A1}}).json()
    assert (state["target"]["id"], state["message"]["id"], state["message"]["period_ms"]) == (0x6A0, 0x6A1, 200)
    assert client.post("/api/v1/driver-can/message", json={"message": "slow"}).json()["shown"] == "slow"
    assert client.put("/api/v1/driver-can", json={}).json()["target"] is None
    assert {"driver-can", "driver-message"} <= set(codes(client))


@pytest.mark.parametrize("frame", [{"id": 0x800}, {"start_byte": 1}, {"period_ms": 10}, {"length": 9}])
def test_a_frame_that_cannot_be_is_refused(client, frame):
    refused = client.put("/api/v1/driver-can", json={"target": FRAME | frame})
    assert refused.status_code == 422
    assert refused.json()["errors"][0]["field"].startswith("target")


def test_what_the_master_listens_to_is_refused(client):
    charger = FRAME | {"id": 0x18FF50E5, "extended": True}
    refused = client.put("/api/v1/driver-can", json={"target": charger})
    assert refused.status_code == 409
    assert refused.json()["type"] == "urn:voltwall:id-in-use"


def test_a_viewer_may_neither_plan_nor_tell_the_driver(make_client):
    client = make_client(password=ENGINEER, viewer_password=VIEWER)
    viewer = ("ola", VIEWER)
    assert client.get("/api/v1/driver-can", auth=viewer).status_code == 200
    for method, path, body in (
        ("PUT", "race-plan", {"laps_to_go": 3}),
        ("PUT", "driver-can", {"target": FRAME}),
        ("POST", "driver-can/message", {"message": "box"}),
    ):
        assert client.request(method, f"/api/v1/{path}", json=body, auth=viewer).status_code == 403
