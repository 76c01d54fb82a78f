"""Links that come and go: processes are killed, lines carry noise, nobody listens."""

import json
import os
import signal
import threading
import tty
from collections.abc import Iterator

import pytest
from websockets.sync.client import connect

from firmware_protocol.framing import encode_frame
from firmware_protocol.memory_map import FIELDS, MASTER_SIZE
from firmware_protocol.messages import Data, MessageType, Window


def live(snapshot: dict) -> bool:
    return snapshot["links"]["rs232"]["state"] == "live" and snapshot["accumulator"]["loaded_cells"] == 96


def test_a_port_that_goes_away_is_said_and_comes_back_by_itself(make_service, simulator, tmp_path):
    link = tmp_path / "master"
    first = simulator("--serial", f"pty:{link}")
    service = make_service("--serial", str(link))
    service.wait_for(live)
    first.stop(signal.SIGKILL)
    link.unlink()  # as the device of an adapter that is unplugged; its number may be another test's soon
    lost = service.wait_for(lambda s: s["links"]["rs232"]["state"] == "lost")
    assert lost["links"]["rs232"]["error"]["text"]
    service.wait_for(lambda s: any(a["code"] == "rs232-lost" for a in s["alarms"]))
    simulator("--serial", f"pty:{link}")
    again = service.wait_for(live)
    assert again["links"]["rs232"]["reconnects"] == 1
    assert again["links"]["rs232"]["lost"] == 0


def test_a_socket_is_as_good_as_a_port(make_service, simulator):
    process = simulator("--serial", "tcp:0")
    service = make_service("--serial", process.urls["serial"])
    assert service.wait_for(live)["source"] == "serial"


def test_a_port_that_does_not_exist_is_said_in_words(make_service, tmp_path):
    service = make_service("--serial", str(tmp_path / "nothing"))
    snapshot = service.wait_for(lambda s: s["links"]["rs232"]["state"] == "lost")
    assert "port not found" in snapshot["links"]["rs232"]["error"]["text"]
    assert snapshot["accumulator"]["voltage_v"] is None
    with service.client() as client:
        health = client.get("/health").json()
        assert health["status"] == "failing"
        assert client.get("/health", params={"strict": True}).status_code == 503
        assert client.get("/config").status_code == 503
        assert "never read" in client.get("/can/dbc").text
        assert (
            client.put("/config", json={"values": {"telemetry_period": 50}}, headers={"If-Match": '"x"'}).status_code
            == 503
        )
        assert client.post("/commands/charge-start").status_code == 503
        assert client.get("/sessions").json() == {"sessions": [], "unreadable": [], "next_cursor": None}


@pytest.fixture
def line() -> Iterator[tuple[int, str]]:
    """A pseudo-terminal whose other end is the test; what the service sends is thrown away."""
    ours, theirs = os.openpty()
    tty.setraw(ours)
    done = threading.Event()

    def drain() -> None:
        try:
            while os.read(ours, 4096) and not done.is_set():
                pass
        except OSError:
            return

    threading.Thread(target=drain, daemon=True).start()
    yield ours, os.ttyname(theirs)
    done.set()
    os.close(theirs)
    os.close(ours)


def frame(sequence: int, uptime_ms: int) -> bytes:
    image = bytearray(MASTER_SIZE)
    FIELDS["v"].pack_into(image, (37000,) * 96)
    FIELDS["t"].pack_into(image, (25,) * 96)
    windows = tuple(Window(o, bytes(image[o : o + n])) for o, n in ((420, 20), (1884, 204), (2280, 116), (2982, 2)))
    return encode_frame(MessageType.DATA, sequence, uptime_ms, Data(windows).to_body())


def test_noise_is_counted_and_good_frames_come_through(make_service, line):
    ours, path = line
    service = make_service("--serial", path)
    service.wait_for(lambda s: s["links"]["rs232"]["state"] == "silent")
    os.write(ours, b"\x00garbage garbage\x00" + frame(0, 1000) + b"\x00\xff\xfe" + frame(1, 1100) + frame(3, 1300))
    snapshot = service.wait_for(lambda s: s["links"]["rs232"]["frames"] == 3)
    assert snapshot["links"]["rs232"]["lost"] == 1
    assert snapshot["links"]["rs232"]["crc_errors"] + snapshot["links"]["rs232"]["resyncs"] >= 2
    assert snapshot["cells"]["voltage_v"] == [3.7] * 96


def test_bytes_that_are_no_frames_are_counted_and_shown(make_service, line):
    ours, path = line
    service = make_service("--serial", path)
    service.wait_for(lambda s: s["links"]["rs232"]["state"] == "silent")

    def after_more_bytes(snapshot):
        os.write(ours, b"cell 1: 3.701 V\r\n" * 4)
        return snapshot["links"]["rs232"].get("unframed")

    link = service.wait_for(after_more_bytes)["links"]["rs232"]
    assert (link["state"], link["frames"], link["crc_errors"]) == ("silent", 0, 0)
    assert link["bytes"] > 0
    assert link["bytes_per_s"] > 0
    assert b"3.701 V" in bytes.fromhex(link["unframed"])
    with service.client() as client:
        assert "rs232-unframed" in {event["code"] for event in client.get("/events").json()["events"]}
    os.write(ours, b"\0" + frame(0, 1000))
    service.wait_for(lambda s: s["links"]["rs232"]["frames"] and "unframed" not in s["links"]["rs232"])


def test_silence_ages_and_then_blanks_every_value(make_service, line):
    ours, path = line
    service = make_service("--serial", path)
    service.wait_for(lambda s: s["links"]["rs232"]["state"] == "silent")
    os.write(ours, frame(0, 1000))
    service.wait_for(lambda s: s["accumulator"]["loaded_cells"] == 96)
    stale = service.wait_for(lambda s: s["age"]["voltage"] and s["age"]["voltage"] > 1)
    assert stale["cells"]["voltage_v"] == [3.7] * 96
    assert stale["last_known"] is None
    blank = service.wait_for(lambda s: s["age"]["voltage"] and s["age"]["voltage"] > 10)
    assert blank["cells"]["voltage_v"] == [None] * 96
    assert blank["accumulator"]["voltage_v"] is None


def test_a_silent_cars_last_values_are_in_rest_and_stream_and_in_no_row_of_the_recording(make_service, line):
    ours, path = line
    service = make_service("--serial", path)
    service.wait_for(lambda s: s["links"]["rs232"]["state"] == "silent")
    with service.client() as client:
        session = client.post("/sessions", json={"name": "silence"}).raise_for_status().json()["id"]
        for number in range(3):
            os.write(ours, frame(number, 1000 + 100 * number))
            service.wait_for(lambda s, n=number: s["links"]["rs232"]["frames"] == n + 1)
        with connect(f"{service.base_url.replace('http', 'ws')}/api/v1/live") as stream:
            streamed = json.loads(stream.recv(timeout=30))
            while streamed["last_known"] is None:
                streamed = json.loads(stream.recv(timeout=30))
        asked = client.get("/snapshot").json()
        for snapshot in (streamed, asked):
            assert snapshot["cells"]["voltage_v"] == [None] * 96
            assert snapshot["last_known"]["cells"]["voltage_v"]["values"] == [3.7] * 96
            assert snapshot["time"] - snapshot["last_known"]["cells"]["voltage_v"]["time"] > 9.9
            assert snapshot["accumulator"]["voltage_v"] is None
        history = client.get("/history", params={"seconds": 900}).json()
        client.post(f"/sessions/{session}/stop").raise_for_status()
        rows = client.get(f"/sessions/{session}/export", params={"format": "csv", "signal": "v[0]"}).text.split("\n")
    assert len(history["time"]) == 3
    assert len([row for row in rows[1:] if row.strip()]) == 3


def test_the_last_values_are_none_in_a_service_that_was_restarted(make_service, line):
    ours, path = line
    service = make_service("--serial", path)
    service.wait_for(lambda s: s["links"]["rs232"]["state"] == "silent")
    os.write(ours, frame(0, 1000))
    service.wait_for(lambda s: s["last_known"] is not None)
    service.stop()
    service.start()
    again = service.wait_for(lambda s: s["links"]["rs232"]["state"] in ("silent", "lost"))
    assert (again["last_known"], again["age"]["voltage"]) == (None, None)


def test_can_alone_shows_what_its_messages_carry(make_service, simulator, tmp_path):
    simulator("--can", f"slcan-pty:{tmp_path / 'adapter'}")
    service = make_service("--can", f"slcan:{tmp_path / 'adapter'}?sleep_after_open=0&timeout=0.05")
    snapshot = service.wait_for(lambda s: s["accumulator"]["soc"] is not None)
    total = snapshot["accumulator"]
    assert snapshot["source"] == "can"
    assert total["soc_source"] == "master"
    assert 240 < total["voltage_v"] < 404
    assert total["current_a"] is not None
    assert snapshot["age"]["voltage"] is None
    assert snapshot["cells"]["voltage_v"] == [None] * 96
    assert snapshot["links"]["rs232"]["state"] == "off"
