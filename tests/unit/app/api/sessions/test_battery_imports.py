"""A log of another team's battery over HTTP: uploaded with its profile and DBC, imported, looked at."""

import time
from pathlib import Path

import pytest

from tests.peer_batteries import segments_in_fd_frames
from tests.recorded.peer_sessions import write_log, write_profile

API = "/api/v1"


def uploaded(client, path: Path) -> int:
    answer = client.post(f"{API}/imports", params={"filename": path.name}, content=path.read_bytes())
    assert answer.status_code == 201
    return answer.json()["id"]


def done(client) -> dict:
    deadline = time.monotonic() + 60
    while (state := client.get(f"{API}/imports").json()["last"])["is_running"]:
        assert time.monotonic() < deadline
        time.sleep(0.02)
    return state


@pytest.fixture
def session_id(client, tmp_path: Path) -> str:
    profile = write_profile(segments_in_fd_frames(), tmp_path)
    log = uploaded(client, write_log(segments_in_fd_frames(), tmp_path / "their.log", 5.0))
    files = [uploaded(client, path) for path in (profile, tmp_path / "peer.dbc")]
    started = client.post(f"{API}/imports/{log}", json={"battery_uploads": files, "name": "their run"})
    assert started.status_code == 202
    state = done(client)
    assert state["error"] is None
    return state["session_id"]


def test_an_uploaded_log_becomes_a_session_of_its_battery(client, session_id: str) -> None:
    at = f"{API}/sessions/{session_id}"
    battery = client.get(f"{at}/battery").json()
    assert (battery["segments"], battery["source"], battery["can_write"]) == ([28] * 5, "recording", False)
    assert battery["why_not"]["code"] == "a-recording-is-not-written"
    assert len(battery["sensors"]) == 140
    assert {"v", "t", "i_fs", "v_min", "estimate.soc"} <= set(client.get(at).json()["signals"])
    series = client.get(f"{at}/series", params={"signal": ["v[139]", "i_fs"]}).json()
    assert len(series["signals"]) == 2
    assert client.get(f"{at}/series", params={"signal": "v[140]"}).status_code == 422
    report = client.get(f"{at}/report").json()
    assert (report["segments"], len(report["voltage_min_v"])) == ([28] * 5, 140)
    assert client.get(f"{at}/laps").status_code == 200
    assert client.get(f"{at}/blackboxes").status_code == 200
    assert client.get(f"{at}/evidence").status_code == 404
    assert client.get(f"{at}/compare/{session_id}").status_code == 200
    exported = client.get(f"{at}/export", params={"format": "csv", "signal": ["v[0]", "v[139]"]})
    assert exported.text.splitlines()[0] == "time_s,elapsed_s,uptime_s,v[0] (V),v[139] (V),time"
    renamed = client.get(f"{at}/export", params={"format": "csv", "signal": ["v[0]", "v[139]"], "names": "pack"})
    assert renamed.text.splitlines()[0] == "time_s,elapsed_s,uptime_s,pack1_cell1_v,pack5_cell28_v,time"
    refused = client.get(f"{at}/export", params={"format": "mcap", "names": "pack"})
    assert (refused.status_code, "names" in refused.text) == (422, True)


def test_the_battery_of_the_teams_own_session_is_the_teams(client, make_session) -> None:
    session_id = make_session([0.0, 0.1], [10.0, 10.0]).stem
    battery = client.get(f"{API}/sessions/{session_id}/battery").json()
    assert battery["segments"] == [12] * 8
    assert battery["limits"]["cell_voltage_max_v"] == pytest.approx(4.2, abs=0.2)


def test_a_profile_that_is_wrong_and_a_battery_that_is_none_are_refused(client, tmp_path: Path) -> None:
    log = uploaded(client, write_log(segments_in_fd_frames(), tmp_path / "their.log", 1.0))
    (tmp_path / "bad.toml").write_text("[battery]\nname = 'x'\n")
    bad = uploaded(client, tmp_path / "bad.toml")
    refused = client.post(f"{API}/imports/{log}", json={"battery_uploads": [bad]})
    assert refused.status_code == 422
    assert "bad.toml:1: battery.packs" in refused.text
    assert client.post(f"{API}/imports/{log}", json={"battery": "none such"}).status_code == 422
    assert client.post(f"{API}/imports/{log}", json={"battery_uploads": [99]}).status_code == 422
