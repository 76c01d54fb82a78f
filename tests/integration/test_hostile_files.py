"""Hostile files in the folder of a running service: named on the list, and in nobody's way."""

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from app.sessions.catalogue import Catalogue
from tests.service_process import NO_CAR, until
from tests.unit.app.sessions.conftest import recorder_in
from tests.unit.app.sessions.hostile import BATTERIES, DEEP_LIST, HARMLESS, UNREADABLE, hostile


@pytest.fixture
def sessions(tmp_path: Path) -> list[str]:
    """Ids of two sound sessions, the older one first, among files of every kind of hostility."""
    folder = tmp_path / "data" / "sessions"
    recorder = recorder_in(folder)
    ids = []
    for name in ("older", "newer"):
        ids.append(recorder.start(name).id)
        recorder.stop()
    recorder.close()
    for k, change in enumerate((UNREADABLE | BATTERIES | HARMLESS).values()):
        hostile(folder / f"{ids[0]}.sqlite", folder / f"hostile-{k:02}.sqlite", change)
    (folder / "garbage.sqlite").write_bytes(b"\x00garbage" * 1000)
    (folder / "empty.sqlite").touch()
    (folder / "folder.sqlite").mkdir()
    return ids


def test_every_bad_session_is_a_row_with_its_reason_and_all_else_goes_on(make_service, sessions: list[str]) -> None:
    service = make_service("--serial", NO_CAR, "--no-record")
    with service.client() as client:
        found = client.get("/sessions").json()
        names = {each["file"] for each in found["unreadable"]}
        assert {f"hostile-{k:02}.sqlite" for k in range(len(UNREADABLE))} < names
        assert {"garbage.sqlite", "empty.sqlite", "folder.sqlite"} < names
        assert len(names) == len(UNREADABLE) + 3
        assert all(each["reason"] for each in found["unreadable"])
        listed = [each["id"] for each in found["sessions"]]
        assert set(sessions) < set(listed)
        assert len(listed) == 2 + len(BATTERIES) + len(HARMLESS)
        for path in ("/season", "/pieces", "/blackboxes"):
            assert client.get(path).status_code == 200, path
        for file in [*names, *(f"{each}.sqlite" for each in listed)]:
            for path in (
                "",
                "/series?signal=v[0]",
                "/markers",
                "/battery",
                "/blackboxes",
                "/report",
                "/laps",
                "/head",
                "/file",
            ):
                answer = client.get(f"/sessions/{file.removesuffix('.sqlite')}{path}")
                assert answer.status_code < 500, (file, path, answer.text)
            assert client.post("/replay", json={"session_id": file.removesuffix(".sqlite")}).status_code < 500
        client.post("/replay/stop")
        assert client.delete("/sessions/garbage").status_code == 200
        assert len(client.get("/sessions").json()["unreadable"]) == len(UNREADABLE) + 2


DERIVED = ("events.sqlite", "blackboxes.sqlite")


def test_damaged_databases_are_set_aside_and_the_page_says_so(make_service) -> None:
    service = make_service("--serial", NO_CAR, "--no-record", start=False)
    service.data.mkdir()
    for name in DERIVED:
        (service.data / name).write_bytes(b"\x00garbage" * 1000)
    service.start()
    with service.client() as client:
        reasons = [
            each["text"] for each in client.get("/health").json()["reasons"] if each["text"].startswith("damaged ")
        ]
        assert sorted(reason.split()[1] for reason in reasons) == sorted(DERIVED)
        events = client.get("/events").json()["events"]
        assert sorted(each["message"]["text"] for each in events if each["code"] == "file-set-aside") == sorted(reasons)
        assert client.get("/blackboxes").status_code == 200
    for name in DERIVED:
        (kept,) = service.data.glob(f"{name}.damaged-*")
        assert kept.read_bytes().startswith(b"\x00garbage")
    service.stop()
    service.start()
    with service.client() as client:
        assert not [each for each in client.get("/health").json()["reasons"] if each["text"].startswith("damaged ")]
        assert len([each for each in client.get("/events").json()["events"] if each["code"] == "file-set-aside"]) == 2


def test_damage_met_while_it_runs_stops_nothing(make_service) -> None:
    service = make_service("--serial", NO_CAR, "--no-record")
    with service.client() as client:
        for number in range(50):
            assert client.post("/sessions", json={"name": f"run {number}"}).status_code == 201
            client.post(f"/sessions/{client.get('/sessions?limit=1').json()['sessions'][0]['id']}/stop")
        path = service.data / "events.sqlite"
        with closing(sqlite3.connect(path)) as other:
            other.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        with path.open("r+b") as file:
            file.seek(4096)
            file.write(b"garbage!" * ((path.stat().st_size - 4096) // 8))
        with closing(sqlite3.connect(path)) as other:  # so that the pages in the service's memory are dropped
            other.execute("PRAGMA user_version = 2")
        assert client.get("/events?limit=5000").status_code == 200
        until(
            lambda: [
                each for each in client.get("/health").json()["reasons"] if "damaged events.sqlite" in each["text"]
            ]
        )
        assert "file-set-aside" in [each["code"] for each in client.get("/events").json()["events"]]


def test_damaged_state_files_are_set_aside_and_the_service_starts(make_service, sessions: list[str]) -> None:
    service = make_service("--no-record", start=False)
    folder = service.data / "sessions"
    files = {
        service.data / "connections.json": DEEP_LIST,
        service.data / "recording.json": DEEP_LIST,
        folder / ".index.json": DEEP_LIST,
    }
    for path, content in files.items():
        path.write_text(content)
    (service.data / "config-history.jsonl").write_text(f"{DEEP_LIST}\n")
    (service.data / "slave-checks.jsonl").write_text(f"{DEEP_LIST}\n")
    (service.data / "profiles").mkdir()
    (service.data / "profiles" / "bad.json").write_text(DEEP_LIST)
    service.start()
    with service.client() as client:
        assert set(sessions) < {each["id"] for each in client.get("/sessions").json()["sessions"]}
        assert client.get("/config/history").json()["records"] == []
        assert client.get("/calibration/slave").json()["checks"] == []
        assert len(client.get("/config/profiles").json()["broken"]) == 1
        assert client.get("/recorder").json()["plan"]["event"] == ""
        assert client.get("/setup").json()["chosen"] is None
    for path, content in files.items():
        (kept,) = path.parent.glob(f"{path.name}.damaged-*")
        assert kept.read_text() == content
        assert any(kept.name in line for line in service.lines)
    assert not [line for line in service.lines if "Traceback" in line]


@pytest.mark.parametrize("content", [DEEP_LIST, "{}", '{"accounts": [{"name": 1}], "tokens": []}'])
def test_damaged_accounts_are_refused_by_name_and_open_nothing(voltwall, tmp_path: Path, content: str) -> None:
    path = tmp_path / "accounts.json"
    path.write_text(content)
    done = voltwall("serve", "--port", "0", "--data", str(tmp_path), "--serial", NO_CAR)
    assert done.returncode != 0
    (line,) = done.stderr.splitlines()
    assert "accounts.json" in line
    assert path.read_text() == content


def test_retention_goes_on_among_bad_sessions_and_names_them_once(make_service, sessions: list[str]) -> None:
    service = make_service("--serial", NO_CAR, "--no-record", "--keep-gb", "1e-6")
    folder = service.data / "sessions"
    with service.client() as client:
        until(lambda: not Catalogue(folder).list())
        events = client.get("/events").json()["events"]
    warnings = [text for each in events if "unreadable file" in (text := each["message"]["text"])]
    assert len(warnings) == 1
    assert "hostile-00.sqlite" in warnings[0]
    assert (folder / "garbage.sqlite").exists()
