"""CAN over REST on the simulated bus: tables by name, DBC in and out, monitor, trace files, frames sent."""

import time

import can
import pytest

from firmware_protocol.config_image import default_image
from tests.service_process import WAIT_S, until


@pytest.fixture(scope="module")
def scenario():
    return "in-the-pit"


@pytest.fixture
def client(service):
    service.wait_for(lambda s: s["config_hash"] and s["master"]["map_matches"])
    with service.client() as client:
        yield client


def message(**changes):
    return {"index": 3, "enabled": True, "id": 0x1A0, "extended": False, "period_ms": 50, "length": 8} | changes


def put(client, tx, **query):
    tag = client.get("/can").headers["ETag"]
    return client.put("/can", json={"tx": [tx]}, params=query, headers={"If-Match": tag})


def test_a_message_is_a_list_of_values_picked_by_name(client):
    pick = [
        {"name": "v_tot", "start_byte": 1, "byte_order": "big"},
        {"name": "i_fs", "start_byte": 3},
        {"name": "slave[2].status", "start_byte": 7},
    ]
    assert put(client, message(pick=pick)).json()["verified"]
    sent = client.get("/can").json()["tx"][3]
    assert sent["bytes"] == [0xFFFF, 2289, 2288, 1884, 1885, 1886, 1887, 444 + 2 * 180]
    assert [s["name"] for s in sent["signals"]] == ["v_tot", "i_fs", "slave_2_status"]
    assert 0 < sent["latency_ms"] < 2
    assert sent["load"] == pytest.approx(135 / 0.05 / 500_000)


@pytest.mark.parametrize(
    ("pick", "words"),
    [
        ([{"name": "v[96]", "start_byte": 0}], "v[36]"),
        ([{"name": "i_fs", "start_byte": 5}], "the message has 8"),
        ([{"name": "soc", "start_byte": 0}, {"name": "t[3]", "start_byte": 1}], "is used"),
    ],
)
def test_a_pick_that_cannot_be_is_named(client, pick, words):
    answer = put(client, message(pick=pick), dry_run="true")
    assert answer.status_code == 422
    assert words in answer.json()["detail"]


def test_the_dbc_goes_out_and_comes_back(client):
    text = client.get("/can/dbc").text
    imported = client.post("/can/dbc", content=text, headers={"Content-Type": "text/plain"}).json()
    tables = client.get("/can").json()
    same = ("index", "enabled", "id", "extended", "period_ms", "length", "bytes")
    assert imported["notes"] == []
    assert [[m[k] for k in same] for m in imported["tx"]] == [[m[k] for k in same] for m in tables["tx"]]
    foreign = 'BO_ 512 Dash: 4 BMS\n SG_ soc : 0|16@1+ (0.0001,0) [0|1] "" X\n SG_ rpm : 16|16@1+ (1,0) [0|1] "" X\n'
    taken = client.post("/can/dbc?node=BMS", content=foreign).json()
    dash = next(m for m in taken["tx"] if m["id"] == 512)
    assert dash["bytes"][:4] == [2982, 2983, 0xFFFF, 0xFFFF]
    assert taken["notes"] == ["Dash.rpm: no value of the master's has this name; its bytes stay unused"]
    assert client.post("/can/dbc", content="nothing").status_code == 422


def bus_until(client, condition):
    deadline = time.monotonic() + WAIT_S
    while not condition(bus := client.get("/can/bus").json()):
        assert time.monotonic() < deadline, bus
    return bus


def test_the_monitor_measures_names_and_decodes(client):
    def summary(bus):
        return next((i for i in bus["ids"] if i["id"] == 0x100 and i["count"] > 20), None)

    bus = bus_until(client, summary)
    row = summary(bus)
    assert row["sender"] == "master"
    assert row["configured_ms"] == 100
    assert row["period_ms"] == pytest.approx(100, rel=0.3)
    values = {v["name"]: v["value"] for v in row["values"]}
    assert values["v_tot"] == pytest.approx(client.get("/snapshot").json()["accumulator"]["voltage_v"], rel=0.01)
    assert (row["late"], bus["rs232_live"], bus["disagreements"]) == (False, True, [])
    charger = next(i for i in bus["ids"] if i["id"] == 0x18FF50E5)
    assert (charger["count"], charger["late"], charger["values"]) == (0, False, []), "configured, never there"


@pytest.mark.parametrize(("name", "suffix"), [("candump", ".log"), ("asc", ".asc"), ("blf", ".blf")])
def test_the_trace_is_a_file_that_other_tools_read(client, tmp_path, name, suffix):
    bus_until(client, lambda bus: any(i["count"] > 3 for i in bus["ids"]))
    path = tmp_path / f"trace{suffix}"
    path.write_bytes(client.get("/can/trace/export", params={"format": name}).content)
    with can.LogReader(path) as reader:
        frames = [frame for frame in reader if frame.arbitration_id == 0x100]
    assert len(frames) > 3
    assert all(len(frame.data) == 8 for frame in frames)


def test_a_charger_played_by_hand_is_heard_by_the_master(client, service):
    status = {"id": 0x18FF50E5, "extended": True, "data": "0e740000000000ff", "period_ms": 200}
    sent = client.post("/can/transmit", json={"frames": [status]})
    assert sent.json()["running"]
    service.wait_for(lambda s: s["charger"]["voltage_v"] == 370.0 and s["master"]["flags"]["charger"])
    assert client.post("/can/transmit", json={"frames": [status]}).status_code == 409, "one list at a time"
    assert client.delete("/can/transmit").json()["running"] is False
    codes = [e["message"]["text"] for e in client.get("/events").json()["events"]]
    assert "CAN: 0x18ff50e5 sent" in codes


def test_what_the_master_sends_is_not_sent_by_hand(client):
    answer = client.post("/can/transmit", json={"frames": [{"id": 0x100, "data": "00"}]})
    assert (answer.status_code, answer.json()["type"]) == (409, "urn:voltwall:id-in-use")
    for frame in ({"id": 0x800}, {"id": 1, "data": "0"}, {"id": 1, "data": "00" * 9}, {"id": 1, "period_ms": 0}):
        assert client.post("/can/transmit", json={"frames": [frame]}).status_code == 422


def test_a_recorded_session_is_sent_again(client):
    client.post("/can/transmit", json={"frames": [{"id": 0x3F0 + i, "data": f"{i:02x}"} for i in range(3)]})
    session = client.get("/sessions").json()["sessions"][0]["id"]

    def is_sent():
        answer = client.post("/can/transmit/replay", json={"session": session, "speed": 100})
        client.delete("/can/transmit")
        return answer.status_code == 200 and answer.json()["total"] >= 3

    until(is_sent)  # what was sent is on the disk soon
    assert client.post("/can/transmit/replay", json={"session": "none"}).status_code == 404


def test_a_car_is_not_sent_to(make_service):
    car = make_service("--serial", "loop://", "--can", "virtual:a-car")
    bench = make_service("--serial", "loop://", "--can", "virtual:a-bench", "--bench", data=car.data.parent / "bench")
    frames = {"frames": [{"id": 1, "data": "00"}]}
    with car.client() as client:
        assert client.post("/can/transmit", json=frames).json()["type"] == "urn:voltwall:not-on-this-bus"
        assert "--bench" in client.get("/can/transmit").json()["block_reason"]["text"]
    with bench.client() as client:
        assert client.get("/can/transmit").json()["allowed"]


def test_the_defaults_are_what_an_unknown_master_is_taken_for(make_service):
    car = make_service("--serial", "loop://", "--can", "virtual:nobody")
    with car.client() as client:
        tables = client.get("/can").json()
    assert tables["assumed"]
    assert tables["tx"][1]["id"] == int.from_bytes(default_image()[44:48], "little")
