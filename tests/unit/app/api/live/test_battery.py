"""`GET battery`: the shape that pages draw."""


def test_the_teams_own_battery_is_served_by_default(client):
    body = client.get("/api/v1/battery").json()
    assert body["segments"] == [12] * 8
    assert body["parallel"] == 10
    assert body["drawing"] == {"rows": 2, "order": [], "turned": []}
    assert body["sensors"] == [[cell] for cell in range(96)]
    assert (body["source"], body["can_write"], body["why_not"]) == ("master", True, None)


def test_limits_that_nobody_told_are_null_and_rules_are_numbers(client):
    body = client.get("/api/v1/battery").json()
    assert body["limits"]["cell_voltage_max_v"] is None
    assert body["rules"]["segment_voltage_max_v"] == 120
