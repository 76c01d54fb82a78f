def test_a_replay_can_choose_filter_and_cell_and_what_there_is_not_is_named(client, make_session):
    session_id = make_session([0.0, 0.5, 1.0], [1.0, 1.0, 1.0], soc=0.4).stem
    choices = client.get("/api/v1/replay").json()
    assert choices["replay"] is None
    assert {"fused", "ekf"} <= set(choices["filters"])
    assert "samsung-25r-10p" in choices["cells"]
    started = client.post(
        "/api/v1/replay", json={"session_id": session_id, "filter": "ekf", "cell": choices["cells"][-1]}
    )
    assert started.json()["replay"]["filter"] == "ekf"
    assert started.json()["replay"]["cell"] == choices["cells"][-1]
    assert client.post("/api/v1/replay/control", json={"loop": [0.0, 50.0]}).status_code == 422
    assert client.post("/api/v1/replay/control", json={"step": True, "loop": "off"}).status_code == 200
    for wrong in ({"filter": "none"}, {"cell": "/etc/passwd"}):
        answer = client.post("/api/v1/replay", json={"session_id": session_id} | wrong)
        assert answer.status_code == 422
        assert answer.json()["errors"][0]["field"] == next(iter(wrong))
    assert client.post("/api/v1/replay/stop").json() == {"replay": None}
