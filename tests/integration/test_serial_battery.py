"""Batteries on a serial line by a profile: a real pseudo-terminal, the service, its recording."""

import csv
import struct

import pytest

from tests.serial_line import SerialLine
from tests.unit.app.sources.serial.test_serial_frames import JBD_BASIC, JBD_CELLS, READ

JBD_REQUESTS = {bytes.fromhex("DDA50400FFFC77"): JBD_CELLS, bytes.fromhex("DDA50300FFFD77"): JBD_BASIC}
VOLTS = [3.6 + 0.004 * k for k in range(96)]
CURRENT_A = 41.25


def arrays(_: int) -> bytes:
    volts = [round(1e4 * volt) for volt in VOLTS]
    return struct.pack("<96bi96H", *[31] * 96, round(100 * CURRENT_A), *volts)


def by_pack(_: int) -> bytes:
    """Each pack's temperatures and voltages behind its number, then the current."""
    packs = [
        struct.pack("<BB12b12H", 0xA5, pack, *[31] * 12, *[round(1e4 * v) for v in VOLTS[12 * pack : 12 * pack + 12]])
        for pack in range(8)
    ]
    return b"".join(packs) + struct.pack("<BBi", 0xA5, 0xFF, round(100 * CURRENT_A))


def whole_struct(_: int) -> bytes:
    image = bytearray(2984)
    struct.pack_into("<i96H", image, 1884, round(100 * CURRENT_A), *[0] * 96)
    struct.pack_into("<96H", image, 1896, *[round(1e4 * volt) for volt in VOLTS])
    struct.pack_into("<H96b", image, 2288, round(100 * sum(VOLTS)), *[31] * 96)
    struct.pack_into("<H", image, 2982, 8000)
    return bytes(image)


def hex_line(_: int) -> bytes:
    numbers = [round(100 * CURRENT_A), *[31] * 96, *[round(1e4 * volt) for volt in VOLTS]]
    return (" ".join(f"{number:04X}" for number in numbers) + "\r\n").encode()


HEAD = """
[battery]
name = "as printed"
segments = [12, 12, 12, 12, 12, 12, 12, 12]
[serial]
parity = "even"
start = "x"
stop = "y"
"""
BY_PACK = (
    HEAD
    + """
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
)
HEX_LINE = (
    HEAD
    + """
[[serial.line]]
separator = " "
fields = [
  { signal = "current", column = 0, base = 16, scale = 0.01 },
  { signal = "cells.temperature", columns = [1, 96], base = 16 },
  { signal = "cells.voltage", columns = [97, 192], base = 16, scale = 0.0001 },
]
"""
)


@pytest.mark.parametrize(
    ("profile", "stream"),
    [("thesis-arrays", arrays), (BY_PACK, by_pack), ("thesis-struct", whole_struct), (HEX_LINE, hex_line)],
    ids=["arrays", "pack by pack", "struct", "ASCII hex"],
)
def test_the_thesis_master_shows_all_cells_whatever_its_stream(make_service, tmp_path, profile, stream):
    """'x' starts it, 'y' stops it; the thesis prints no layout, these are the four that it may be."""
    battery = profile
    if "\n" in profile:
        battery = str(tmp_path / "printed.toml")
        (tmp_path / "printed.toml").write_text(profile, encoding="utf-8")
    line = SerialLine(stream=stream, start=b"x", period_s=0.6)
    service = make_service("--serial", line.url, "--battery", battery)
    try:
        snapshot = service.wait_for(
            lambda s: None not in s["cells"]["voltage_v"] and s["accumulator"]["current_a"] is not None
        )
        assert snapshot["cells"]["voltage_v"] == pytest.approx(VOLTS, abs=1e-4)
        assert snapshot["cells"]["temperature_degc"] == [31.0] * 96
        assert snapshot["accumulator"]["current_a"] == pytest.approx(CURRENT_A)
        assert snapshot["links"]["rs232"]["state"] == "live"
        with service.client() as client:
            assert client.get("/battery").json()["can_write"] is False
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
