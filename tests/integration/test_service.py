"""The whole chain with nothing replaced: simulator process, pseudo-terminal, CAN adapter, service, HTTP, files."""

import json
import sqlite3
import time
from contextlib import closing
from pathlib import Path

import httpx
import pytest
from websockets.sync.client import connect

from firmware_protocol.config_image import default_image, image_hash, with_raw
from firmware_protocol.framing import Frame, decode_chunk
from tests.service_process import WAIT_S, until

FIRST_MAP = Path(__file__).parents[1] / "recorded" / "first_map"
OCTETS = {"Accept": "application/octet-stream"}


def test_health_says_what_it_reads(service):
    with service.client() as client:
        assert client.get("/health").json()["source"] == "simulator"
        until(lambda: client.get("/health").json()["status"] == "ok")  # not while a busy disk has something left out


def test_snapshot_has_every_cell_in_plausible_units(service):
    snapshot = service.wait_for(lambda s: s["cells"]["soc"][0] is not None)
    assert len(snapshot["cells"]["voltage_v"]) == 96
    assert all(2.5 < v < 4.21 for v in snapshot["cells"]["voltage_v"])
    assert all(0 <= s <= 1 for s in snapshot["cells"]["soc"])
    assert sum(snapshot["cells"]["voltage_v"]) == pytest.approx(snapshot["accumulator"]["voltage_v"], abs=2)
    assert len(snapshot["packs"]) == 8


def test_both_links_live_and_nothing_lost(service):
    snapshot = service.wait_for(
        lambda s: s["links"]["rs232"]["state"] == "live" and s["links"]["can"]["state"] == "live"
    )
    assert snapshot["links"]["rs232"]["lost"] == 0
    assert snapshot["links"]["rs232"]["crc_errors"] == 0
    assert snapshot["master"]["map_matches"] in (True, None)


def test_live_stream_runs_at_the_masters_rate_and_can_be_slowed(service):
    def count(path, seconds):
        with connect(service.base_url.replace("http", "ws") + path, max_size=1 << 22) as socket:
            socket.recv(timeout=5)
            until, n = time.monotonic() + seconds, 0
            while (left := until - time.monotonic()) > 0:
                try:
                    socket.recv(timeout=left)
                except TimeoutError:
                    break
                n += 1
            return n

    assert count("/api/v1/live", 2.0) >= 12
    assert count("/api/v1/live?rate=2", 2.0) <= 5


def test_a_config_read_as_image_has_its_hash_as_etag(service):
    service.wait_for(lambda s: s["config_hash"])
    with service.client() as client:
        answer = client.get("/config", headers=OCTETS)
    assert len(answer.content) == 420
    assert answer.headers["ETag"].strip('"') == image_hash(answer.content)


def test_dry_run_compares_and_writes_nothing(service):
    with service.client() as client:
        before = client.get("/config", headers=OCTETS)
        answer = client.put(
            "/config?dry_run=true", json={"values": {"t_cell_max": 50}}, headers={"If-Match": before.headers["ETag"]}
        )
        after = client.get("/config", headers=OCTETS)
    assert answer.status_code == 200
    body = answer.json()
    assert (body["written"], body["difference"][0]["field"], body["difference"][0]["to"]) == (False, "t_cell_max", 50)
    assert after.content == before.content


@pytest.mark.parametrize("kind", ["application/octet-stream", "application/json"])
def test_an_image_and_a_profile_of_the_first_map_are_converted(service, kind):
    """Both say 250 by `ts`, as they came out of the program of the day before the map changed."""
    image, profile = json.loads((FIRST_MAP / "values.json").read_text())["configs"][1], FIRST_MAP / "profile.json"
    content = bytes.fromhex(image) if kind == "application/octet-stream" else profile.read_bytes()
    with service.client() as client:
        headers = {"If-Match": client.get("/config").headers["ETag"], "Content-Type": kind}
        answer = client.put("/config?dry_run=true", content=content, headers=headers)
    assert answer.status_code == 200, answer.text
    changes = {change["field"]: (change["from"], change["to"]) for change in answer.json()["difference"]}
    assert changes["telemetry_period"] == (100, 250)
    assert "ts" not in changes


@pytest.mark.parametrize(
    ("values", "field", "words"),
    [
        ({"v_cell_max": 5.5}, "v_cell_max", "4.5"),
        ({"ts": 201}, "ts", "1..200 sample: size of the current sample buffer"),
        ({"telemetry_period": "fast"}, "telemetry_period", "number"),
        ({"telemetry_period": 100.5}, "telemetry_period", "whole number"),
        ({"can_tx_msg_id": [1.5, 0, 0, 0, 0, 0, 0, 0]}, "can_tx_msg_id[0]", "whole number"),
        ({"no_such": 1}, "no_such", ""),
        ({"v_cell_min": 4.0, "v_cell_max": 3.5}, "v_cell_min", "v_cell_max"),
    ],
)
def test_a_bad_value_is_refused_with_field_and_limit(service, values, field, words):
    with service.client() as client:
        etag = client.get("/config", headers=OCTETS).headers["ETag"]
        answer = client.put("/config", json={"values": values}, headers={"If-Match": etag})
    assert answer.status_code == 422
    assert answer.headers["content-type"] == "application/problem+json"
    error = answer.json()["errors"][0]
    assert error["field"] == field
    assert words in error["message"]["text"]


def test_a_write_without_the_right_hash_is_refused(service):
    with service.client() as client:
        missing = client.put("/config", json={"values": {"telemetry_period": 100}})
        wrong = client.put(
            "/config", json={"values": {"telemetry_period": 90}}, headers={"If-Match": '"0000000000000000"'}
        )
        weak = {"If-Match": "W/" + client.get("/config").headers["ETag"]}
        assert client.put("/config", json={"values": {"telemetry_period": 90}}, headers=weak).status_code == 412
    assert missing.status_code == 428
    assert wrong.status_code == 412
    assert wrong.json()["difference"][0]["to"] == 90


def test_can_tables_name_their_bytes_and_make_a_dbc(service):
    with service.client() as client:
        tables = client.get("/can").json()
        dbc = client.get("/can/dbc").text
        service.wait_for(lambda s: s["links"]["can"]["frames"] > 3)
        trace = client.get("/can/trace").json()
    assert tables["bit_rate"] == 500_000
    assert [s["name"] for s in tables["tx"][1]["signals"]] == ["soc", "v_tot", "i_fs"]
    assert "BO_ 256 " in dbc
    assert any(entry["id"] == 0x100 for entry in trace["by_id"])


def test_commands_reach_the_master_and_bad_ones_are_named(service):
    with service.client() as client:
        assert client.post("/commands/fan-override", json={"argument": 1.0}).json() == {"done": True}
        service.wait_for(lambda s: s["accumulator"]["fan_duty"] == 1.0)
        client.post("/commands/fan-override")
        service.wait_for(lambda s: s["accumulator"]["fan_duty"] != 1.0)
        assert client.post("/commands/fly").status_code == 404
        refused = client.post("/commands/set-soc", json={"argument": 7})
    assert refused.status_code == 422
    assert "between 0 and 1" in refused.json()["detail"]


def test_metrics_and_openapi(service):
    text = httpx.get(service.base_url + "/metrics", timeout=WAIT_S).text
    assert "voltwall_accumulator_volts" in text
    assert 'voltwall_link_lost_total{link="rs232"} 0.0' in text
    paths = httpx.get(service.base_url + "/api/v1/openapi.json", timeout=WAIT_S).json()["paths"]
    for path in ("/api/v1/snapshot", "/api/v1/config", "/api/v1/can/dbc", "/api/v1/sessions/{session_id}/series"):
        assert path in paths


def test_unknown_routes_answer_with_a_problem(service):
    answer = httpx.get(service.base_url + "/api/v1/nothing", timeout=WAIT_S)
    assert answer.status_code == 404
    assert answer.json()["type"] == "urn:voltwall:not-found"


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1"])
def test_foreign_origins_are_refused(service, origin):
    assert (
        httpx.get(service.base_url + "/api/v1/snapshot", headers={"Origin": origin}, timeout=WAIT_S).status_code == 403
    )
    with (
        connect(service.base_url.replace("http", "ws") + "/api/v1/live", origin=origin) as socket,
        pytest.raises(Exception, match="4403"),
    ):
        socket.recv(timeout=5)


def test_a_foreign_host_name_is_refused_on_loopback(service):
    assert (
        httpx.get(service.base_url + "/api/v1/snapshot", headers={"Host": "evil.example"}, timeout=WAIT_S).status_code
        == 403
    )


def test_a_session_is_recorded_by_itself_listed_marked_and_exported(service):
    snapshot = service.wait_for(lambda s: s["recording"] and s["recording"]["frames"] > 120)
    session_id = snapshot["recording"]["session_id"]
    with service.client() as client:
        assert client.post("/sessions").status_code == 409
        assert client.post(f"/sessions/{session_id}/markers", json={"text": "driver change"}).status_code == 201
        assert client.post(f"/sessions/{session_id}/stop").json() == {"stopped": True}
        listed = next(s for s in client.get("/sessions").json()["sessions"] if s["id"] == session_id)
        assert listed["frames"] >= 30
        series = client.get(f"/sessions/{session_id}/series?signal=v[36]&signal=i_fs&points=50").json()["signals"]
        assert series["v[36]"]["unit"] == "V"
        assert min(v for v in series["v[36]"]["min"] if v is not None) > 2.5
        csv = client.get(f"/sessions/{session_id}/export?format=csv").text.splitlines()
        assert "time" in csv[0]
        assert "v[36]" in csv[0]
        assert len(csv) > 20
        assert client.get(f"/sessions/{session_id}/export?format=parquet").content[:4] == b"PAR1"
        assert [m["text"] for m in client.get(f"/sessions/{session_id}/markers").json()["markers"]] == ["driver change"]
        assert client.get("/sessions/no-such").status_code == 404
        assert client.get(f"/sessions/{session_id}/series?signal=nonsense").status_code == 422
        beyond = client.get(f"/sessions/{session_id}/series?signal=i_fs&signal=v[96]").json()
        assert beyond["detail"] == "signal = v[96]: index 96 is beyond 95"
        restarted = client.post("/sessions", json={"name": "second"}).json()
        assert restarted["id"] in [each["id"] for each in client.get("/sessions").json()["sessions"]]
        assert restarted["name"] == "second"


def test_who_stops_a_session_whose_file_was_deleted_is_told_and_the_new_one_goes_on(service):
    with service.client() as client:
        recording = client.get("/snapshot").json()["recording"]
        lost = recording["session_id"] if recording else client.post("/sessions").json()["id"]
        (service.data / "sessions" / f"{lost}.sqlite").unlink()
        following = service.wait_for(lambda s: s["recording"] and s["recording"]["session_id"] != lost)
        answer = client.post(f"/sessions/{lost}/stop")
        assert answer.status_code == 507
        assert f"recording continues as {following['recording']['session_id']}" in answer.json()["detail"]
        assert client.get(f"/sessions/{following['recording']['session_id']}").json()["recording"]


def test_events_are_logged_and_acknowledged(service):
    with service.client() as client:
        events = client.get("/events").json()["events"]
        assert {e["code"] for e in events} >= {"rs232-open", "recording-started"}
        newest = events[0]["id"]
        assert client.post(f"/events/{newest}/acknowledge").json()["acknowledged_by"] == "engineer"
        assert client.post("/events/999999/acknowledge").status_code == 404


def test_replay_shows_the_recorded_session_while_recording_goes_on(service):
    with service.client() as client:
        sessions = client.get("/sessions").json()["sessions"]
        done = next(s for s in sessions if not s["recording"])
        client.post("/replay", json={"session_id": done["id"], "speed": 1})
        snapshot = service.wait_for(lambda s: s["source"] == "replay" and s["accumulator"]["loaded_cells"] == 96)
        assert snapshot["replay"]["session_id"] == done["id"]
        client.post("/replay/control", json={"paused": True})
        paused = service.wait_for(lambda s: s["replay"] and s["replay"]["paused"])
        assert paused["recording"] is not None
        client.post("/replay/stop")
        service.wait_for(lambda s: s["source"] == "simulator")


def test_written_verified_stored_and_still_there_after_a_restart(make_service):
    service = make_service("--scenario", "in-the-pit")
    service.wait_for(lambda s: s["config_hash"] and s["master"]["map_matches"])
    with service.client() as client:
        before = client.get("/config", headers=OCTETS)
        wanted = with_raw(before.content, "t_cell_max", 55)
        written = client.put(
            "/config",
            content=wanted,
            headers={"If-Match": before.headers["ETag"], "Content-Type": "application/octet-stream"},
        )
        assert written.status_code == 200, written.text
        assert written.json()["verified"]
        assert client.get("/config", headers=OCTETS).status_code == 200
        service.wait_for(lambda s: s["config_hash"] == image_hash(wanted))
        stored = client.post("/config/store").json()
        assert stored["stored_hash"] == image_hash(wanted)
    assert service.stop() == 0
    service.start()
    service.wait_for(lambda s: s["config_hash"] == image_hash(wanted) and s["config_stored_hash"] == image_hash(wanted))
    with service.client() as client:
        assert client.get("/config").json()["values"]["t_cell_max"] == 55
        codes = [e["code"] for e in client.get("/events").json()["events"]]
    assert {"config-written", "config-stored"} <= set(codes), "the event log survives the restart"


def test_killed_while_recording_every_frame_older_than_a_second_is_in_the_file(make_service):
    service = make_service()
    service.wait_for(lambda s: s["recording"] and s["recording"]["frames"] > 20)
    received = []
    with connect(service.base_url.replace("http", "ws") + "/api/v1/live", max_size=1 << 22) as socket:
        until = time.monotonic() + 3
        while time.monotonic() < until:
            received.append(json.loads(socket.recv(timeout=5))["uptime_s"])
        service.kill()
    newest = received[-1]
    path = next((service.data / "sessions").glob("*.sqlite"))
    with closing(sqlite3.connect(path)) as database:
        frames = [decode_chunk(raw) for (raw,) in database.execute("SELECT raw FROM frames ORDER BY id")]
    recorded = {round(f.uptime_ms / 1000, 3) for f in frames if isinstance(f, Frame)}
    old = [u for u in received if u <= newest - 1.0]
    assert len(old) > 10
    assert set(old) <= recorded


def test_a_default_master_runs_on_the_documented_defaults(make_service):
    service = make_service()
    service.wait_for(lambda s: s["config_hash"])
    with service.client() as client:
        assert client.get("/config", headers=OCTETS).content == default_image()


def test_can_frames_are_exported_as_candump(service):
    snapshot = service.wait_for(lambda s: s["recording"] and s["links"]["can"]["frames"] > 20)
    with service.client() as client:
        answer = client.get(f"/sessions/{snapshot['recording']['session_id']}/export?format=candump")
    assert answer.status_code == 200, answer.text
    assert "100#" in answer.text
    assert ".log" in answer.headers["content-disposition"]
