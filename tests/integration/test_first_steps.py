"""Choosing what to read on a page: the service starts again in its process, at its address, with what was chosen."""

from tests.service_process import Service


def test_a_choice_takes_effect_and_stays(tmp_path):
    service = Service(tmp_path, ["--scenario", "dying-cell"]).start()
    try:
        with service.client() as client:  # its cell is in pack 6, which the next battery does not have
            first = client.get("/setup").json()
            assert first["needed"]
            assert client.get("/battery").json()["name"] == "built-in master, 96 cells"
            service.choose(battery="5x18")
            assert client.get("/setup").json()["instance"] != first["instance"]
            assert sum(client.get("/battery").json()["segments"]) == 90
            assert not client.get("/setup").json()["needed"]
            refused = client.put("/setup", json={"battery": "one-signal-a-cell", "serial": "COM6"})
            assert refused.status_code == 422
        service.stop()
        service.arguments = []
        service.start()
        with service.client() as client:
            assert sum(client.get("/battery").json()["segments"]) == 90
    finally:
        service.stop()


def test_keeping_what_is_read_ends_nothing(tmp_path):
    service = Service(tmp_path, []).start()
    try:
        with service.client() as client:
            before = service.wait_for(lambda each: each["uptime_s"] is not None)
            instance = client.get("/setup").json()["instance"]
            answer = client.put("/setup", json={"battery": "team"}).json()
            assert (answer["restarts"], answer["needed"], answer["instance"]) == (False, False, instance)
            after = service.wait_for(lambda each: each["seq"] > before["seq"] + 10)
            assert client.get("/setup").json()["instance"] == instance
            assert after["uptime_s"] >= before["uptime_s"]
    finally:
        service.stop()


def test_the_command_line_wins(tmp_path):
    (tmp_path / "connections.json").write_text('{"battery": "one-signal-a-cell"}')
    service = Service(tmp_path, ["--battery", "team"]).start()
    try:
        with service.client() as client:
            assert sum(client.get("/battery").json()["segments"]) == 96
            assert client.get("/setup").json()["fixed"]
            assert client.put("/setup", json={}).status_code == 409
    finally:
        service.stop()
