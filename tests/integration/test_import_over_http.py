"""Another team's file through the running service: uploaded, mapped, imported, kept as a profile."""

import time

import httpx
import pytest

from app.words import message_from_json, render


@pytest.fixture(scope="module")
def csv() -> bytes:
    lines = ["t [s],Pack Current [A]," + ",".join(f"Cell {i + 1} [V]" for i in range(12))]
    cells = ",".join(f"{3.6 + c / 1000}" for c in range(12))
    lines += [f"{1_780_000_000 + i / 10},{20 + i % 3},{cells}" for i in range(300)]
    return "\n".join(lines).encode()


def done(client: httpx.Client) -> dict:
    deadline = time.monotonic() + 30
    while (state := client.get("/imports").json()["last"])["is_running"]:
        assert time.monotonic() < deadline
        time.sleep(0.05)
    return state


def test_a_file_becomes_a_session_and_its_mapping_a_profile(service, csv):
    with service.client() as client:
        upload = client.post("/imports", params={"filename": "../their run.csv"}, content=csv).json()
        assert (upload["filename"], upload["is_can"], len(upload["columns"])) == ("their run.csv", False, 14)
        guessed = upload["guessed"]
        assert (guessed["time"], guessed["voltages"]) == ("t [s]", "Cell {n} [V]")
        assert (guessed["current"], guessed["current_unit"]) == ("Pack Current [A]", "A")
        asked = {"profile": guessed, "pick_units": ["voltage", "current"]}
        preview = client.post(f"/imports/{upload['id']}/preview", json=asked).json()
        assert (preview["profile"], preview["error"], preview["understood"]["rows"]) == (guessed, None, 300)
        assert client.get("/imports").json()["last"] is None  # nothing is imported by looking
        body = {"profile": guessed, "save_as": "their bms", "name": "their run"}
        assert client.post(f"/imports/{upload['id']}", json=body).status_code == 202
        state = done(client)
        assert (state["error"], state["done"]) == (None, 300)
        session = client.get(f"/sessions/{state['session_id']}").json()
        assert (session["name"], session["can_frames"], session["closed"]) == ("their run", 0, True)
        assert "estimate.soc" in session["signals"]
        assert "their bms" in client.get("/imports").json()["profiles"]
        again = client.post("/imports", params={"filename": "next.csv"}, content=csv).json()
        client.post(f"/imports/{again['id']}", json={"profile_name": "their bms"})
        assert done(client)["error"] is None
        assert client.post(f"/imports/{again['id']}", json={"profile_name": "their bms"}).status_code == 422


def test_what_was_done_to_read_a_file_is_said_in_either_language(service):
    cells = [f"{'OVERLOAD' if i == 7 else '3,7'};3,8;21" for i in range(40)]
    rows = [f"{i / 10}".replace(".", ",") + f";-{i}" + f";{each}" for i, each in enumerate(cells)]
    text = "\n".join(["Rig 3", "Cell A12", "t;I;V1;V2;T1", *rows])
    profile = {"time": "t", "current": "I", "voltages": "V{n}", "temperatures": "T{n}", "charge_positive": True}
    with service.client() as client:
        upload = client.post("/imports", params={"filename": "rig.csv"}, content=text.encode()).json()
        asked = {"profile": profile}
        found = client.post(f"/imports/{upload['id']}/preview", json=asked).json()["understood"]
        assert [each["text"] for each in found["notes"]] == [
            "decimal commas read as points",
            "2 lines above the table skipped",
            "1 rows do not consist of 5 numbers: read as missing or skipped; line 11: 'OVERLOAD' is not a number",
            "I is positive on charge: sign inverted",
            "1 temperatures for 2 cells: each is used for the nearest cells",
        ]
        norwegian = [
            "desimalkomma er lest som punktum",
            "2 linjer over tabellen hoppet over",
            "1 rader består ikke av 5 tall: lest som manglende eller hoppet over; linje 11: 'OVERLOAD' er ikke et tall",
            "I er positiv ved lading: fortegnet er snudd",
            "1 temperaturer for 2 celler: hver brukes for de nærmeste cellene",
        ]
        assert [render(message_from_json(each), language="nb") for each in found["notes"]] == norwegian
        client.post(f"/imports/{upload['id']}", json=asked | {"started_unix_s": 1.78e9})
        state = done(client)
        assert state["notes"] == found["notes"]


def test_what_is_wrong_is_said(service, csv):
    with service.client() as client:
        nothing = client.post("/imports", params={"filename": "x.csv"}, content=b"no table at all")
        assert (nothing.status_code, nothing.json()["title"]) == (422, "Cannot be imported")
        assert nothing.json()["message"]["args"]["reason"]["code"] == "no-row-of-numbers"
        upload = client.post("/imports", params={"filename": "x.csv"}, content=csv).json()
        unknown = client.post(f"/imports/{upload['id']}", json={"profile": {"wheels": 4}})
        assert "no such field" in unknown.json()["detail"]
        wrong = {"profile": {**upload["guessed"], "current": "Strom"}}
        preview = client.post(f"/imports/{upload['id']}/preview", json=wrong).json()
        assert preview["error"]["code"] == "no-such-column"
        client.post(f"/imports/{upload['id']}", json=wrong)
        failed = done(client)
        assert "no such column" in failed["error"]["text"]
        assert failed["error"]["args"]["reason"]["code"] == "no-such-column"


def test_an_upload_larger_than_other_requests_is_taken(service):
    rows = b"t,I,C1,C2\n" + b"0,1,3.6,3.7\n" * 200_000
    with service.client() as client:
        assert client.post("/imports", params={"filename": "large.csv"}, content=rows).status_code == 201
        assert client.post("/sessions", content=rows).status_code == 413
