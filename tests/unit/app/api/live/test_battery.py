"""`GET battery`: the shape that pages draw; what a battery without a master refuses."""

import pytest


def test_the_teams_own_battery_is_served_by_default(client):
    body = client.get("/api/v1/battery").json()
    assert body["segments"] == [12] * 8
    assert body["parallel"] == 10
    assert (body["drawing"]["rows"], sorted(body["drawing"]["order"])) == (2, list(range(8)))
    assert body["sensors"] == [[cell] for cell in range(96)]
    assert (body["source"], body["can_write"], body["why_not"]) == ("master", True, None)


def test_limits_that_nobody_told_are_null_and_rules_are_numbers(client):
    body = client.get("/api/v1/battery").json()
    assert body["limits"]["cell_voltage_max_v"] is None
    assert body["rules"]["segment_voltage_max_v"] == 120


def test_a_battery_by_its_dbc_has_its_own_shape_and_says_why_it_cannot_be_written(make_client):
    body = make_client(battery="foxbms-2").get("/api/v1/battery").json()
    assert body["segments"] == [18] * 12
    assert len(body["sensors"]) == 180
    assert (body["source"], body["can_write"]) == ("dbc", False)
    assert body["why_not"]["code"] == "battery-not-writable"
    assert body["limits"]["discharge_current_max_a"] is None  # a signal that was not received yet


@pytest.mark.parametrize(
    ("method", "path"),
    [
        ("GET", "/config"),
        ("PUT", "/config"),
        ("POST", "/config/store"),
        ("GET", "/config/profiles"),
        ("GET", "/can"),
        ("PUT", "/can"),
        ("GET", "/commands"),
        ("POST", "/commands/charge-start"),
        ("POST", "/identify"),
        ("GET", "/calibration/slave"),
    ],
)
def test_what_needs_a_master_is_refused_with_a_code_in_words(make_client, method, path):
    answer = make_client(battery="one-signal-a-cell").request(method, f"/api/v1{path}", json={})
    assert answer.status_code == 409
    assert answer.json()["type"] == "urn:voltwall:battery-not-writable"
    assert answer.json()["message"]["code"] == "battery-not-writable"


def test_cells_beyond_the_battery_are_refused_by_their_number(make_client):
    client = make_client(battery="orion-bms-2")
    assert client.get("/api/v1/history", params={"cell": 71}).status_code == 200
    refused = client.get("/api/v1/trend", params={"cell": 72})
    assert refused.status_code == 422
    assert refused.json()["errors"][0]["field"] == "cell"
