"""Batteries on a serial line by a profile: a real pseudo-terminal, the service, its recording."""

import csv
import struct

import pytest

from tests.serial_line import SerialLine
from tests.thesis_streams import DEGC, STREAMS, current_a, hex_line, volts
from tests.unit.app.sources.serial.test_serial_frames import JBD_BASIC, JBD_CELLS, READ

JBD_REQUESTS = {bytes.fromhex("DDA50400FFFC77"): JBD_CELLS, bytes.fromhex("DDA50300FFFD77"): JBD_BASIC}
K = 4  # of the samples of the thesis's streams


def numbered_packs(k: int) -> bytes:
    """Each pack's temperatures and voltages behind its number, then the current."""
    cells = [round(1e4 * volt) for volt in volts(k)]
    packs = [
        struct.pack("<BB12b12H", 0xA5, pack, *DEGC[12 * pack : 12 * pack + 12], *cells[12 * pack : 12 * pack + 12])
        for pack in range(8)
    ]
    return b"".join(packs) + struct.pack("<BBi", 0xA5, 0xFF, round(100 * current_a(k)))


NUMBERED_PACKS = """
[battery]
name = "as printed"
segments = [12, 12, 12, 12, 12, 12, 12, 12]
[serial]
parity = "even"
start = "x"
stop = "y"
[[serial.frame]]
header = "A5 FF"
length = 6
fields = [{ signal = "current", type = "i32", at = 2, scale = 0.01 }]
[[serial.frame]]
header = "A5"
length = 38
fields = [
  { signal = "cells.temperature", type = "i8", at = 2, count = 12, index = { at = 1 } },
  { signal = "cells.voltage", type = "u16", at = 14, count = 12, index = { at = 1 }, scale = 0.0001 },
]
"""


@pytest.mark.parametrize(
    ("profile", "stream"),
    [*STREAMS.items(), (NUMBERED_PACKS, numbered_packs)],
    ids=[*STREAMS, "numbered packs"],
)
def test_the_thesis_master_shows_all_cells_whatever_its_stream(make_service, tmp_path, profile, stream):
    """'x' starts it, 'y' stops it; the thesis prints no layout, these are the four that it may be."""
    battery = profile
    if "\n" in profile:
        battery = str(tmp_path / "printed.toml")
        (tmp_path / "printed.toml").write_text(profile, encoding="utf-8")
    line = SerialLine(stream=lambda _: stream(K), start=b"x", period_s=0.6)
    service = make_service("--serial", line.url, "--battery", battery)
    try:
        snapshot = service.wait_for(
            lambda s: None not in s["cells"]["voltage_v"] and s["accumulator"]["current_a"] is not None
        )
        assert snapshot["cells"]["voltage_v"] == pytest.approx(volts(K), abs=1e-4)
        assert snapshot["cells"]["temperature_degc"] == DEGC
        assert snapshot["accumulator"]["current_a"] == pytest.approx(current_a(K))
        assert snapshot["links"]["rs232"]["state"] == "live"
        with service.client() as client:
            body = client.get("/battery").json()
            assert (body["can_write"], body["has_checksum"]) == (False, False)
            assert client.put("/config", json={"values": {}}, headers={"If-Match": '"x"'}).status_code == 409
        service.stop()
        assert line.received.startswith(b"x")
        assert line.received.endswith(b"y")
    finally:
        service.stop()
        line.close()


def test_a_battery_that_answers_requests_is_live_recorded_and_exported(make_service):
    line = SerialLine(JBD_REQUESTS)
    service = make_service("--serial", line.url, "--battery", "jbd")
    try:
        expected = READ["jbd"]
        snapshot = service.wait_for(
            lambda s: None not in s["cells"]["voltage_v"] and s["accumulator"]["current_a"] is not None
        )
        assert snapshot["cells"]["voltage_v"] == pytest.approx(expected["voltage"])
        with service.client() as client:
            recorded = service.wait_for(lambda s: s["recording"])
            frames = recorded["links"]["rs232"]["frames"]
            service.wait_for(lambda s: s["links"]["rs232"]["frames"] > frames + 8)
            session = recorded["recording"]["session_id"]
            assert client.post(f"/sessions/{session}/stop").is_success
            text = client.get(f"/sessions/{session}/export", params={"format": "csv"}).text
            rows = list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))
            assert [float(rows[-1][f"v[{cell}] (V)"]) for cell in range(15)] == pytest.approx(expected["voltage"])
            assert float(rows[-1]["i_fs (A)"]) == 0.0
            client.post("/replay", json={"session_id": session, "speed": 10})
            replayed = service.wait_for(lambda s: s["source"] == "replay" and None not in s["cells"]["voltage_v"])
            assert replayed["cells"]["voltage_v"] == pytest.approx(expected["voltage"])
    finally:
        service.stop()  # else it opens the terminal's number again, which may be another test's by then
        line.close()


def test_a_profile_is_proposed_from_a_line_that_is_read(voltwall, tmp_path):
    line = SerialLine(JBD_REQUESTS)
    try:
        known = voltwall("battery", "learn", "--serial", line.url, "--baud", "9600", "--ask", "--seconds", "4")
    finally:
        line.close()
    assert known.returncode == 0, known.stderr
    assert "jbd fits" in known.stderr
    line = SerialLine(stream=hex_line, start=b"x", period_s=0.2)
    profile = tmp_path / "lines.toml"
    try:
        words = ("--serial", line.url, "--start", "x", "--seconds", "3", "--out", str(profile))
        assert voltwall("battery", "learn", *words).returncode == 0
    finally:
        line.close()
    checked = voltwall("battery", "check", str(profile))
    assert "96 cells" in checked.stdout
